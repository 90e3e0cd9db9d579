"""Counter-based numbers: Philox4x64-10 to the bit, and a draw that depends on what it is for only."""

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.counter_rng import normals, philox, uniforms

COUNTERS = [(0, 0, 0, 0), (3, 4, 5, 6), (2**64 - 1, 7, 2**63, 1), (2**64 - 1,) * 4]
KEYS = [(0, 0), (1, 2), (2**64 - 1, 0xDEADBEEF)]


@pytest.mark.parametrize("counter", COUNTERS)
@pytest.mark.parametrize("key", KEYS)
def test_philox_gives_the_bits_of_numpys_generator(key, counter):
    # numpy counts up before it draws, so its generator is set one back
    before = (sum(c << 64 * i for i, c in enumerate(counter)) - 1) % 2**256
    words = np.array([before >> 64 * i & 2**64 - 1 for i in range(4)], np.uint64)
    expected = np.random.Philox(key=np.array(key, np.uint64), counter=words).random_raw(4)
    assert philox(*map(np.uint64, key), *map(np.uint64, counter)) == tuple(expected)


def test_uniforms_are_the_doubles_that_numpy_makes_of_the_same_bits():
    counter = np.array([2**64 - 1, 0, 9, 0], np.uint64)  # one before block 0 of stream 1 of episode 9... with carry
    counter[1] = 0
    generator = np.random.Generator(np.random.Philox(key=np.array([5, 3], np.uint64), counter=counter))
    assert np.array_equal(uniforms(5, 3, 9, 1, 4), generator.random(4))


def test_a_draw_does_not_depend_on_what_is_drawn_beside_it():
    together = uniforms(7, np.arange(1, 9)[:, None], np.arange(50)[None], 2, 6)
    assert together.shape == (8, 50, 6)
    assert np.array_equal(together[4, 17], uniforms(7, 5, 17, 2, 6))
    assert np.array_equal(together[4, 17, :3], uniforms(7, 5, 17, 2, 3))


def test_normals_have_the_moments_of_the_standard_normal():
    draws = normals(1, 1, np.arange(20_000), 0, 5).reshape(-1)
    assert abs(draws.mean()) < 5 / np.sqrt(draws.size)
    assert abs(draws.var() - 1.0) < 5 * np.sqrt(2 / draws.size)
    assert abs((draws**4).mean() - 3.0) < 0.15


@pytest.mark.parametrize("bad", [-1, 1.5, [3, -2]])
def test_numbers_that_are_not_whole_or_negative_are_refused(bad):
    with pytest.raises(InvalidInput, match="episode: expected whole numbers"):
        uniforms(1, 1, bad, 0, 1)
