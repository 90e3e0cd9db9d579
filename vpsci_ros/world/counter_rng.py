"""Counter-based random numbers: a draw is a function of its key, not of earlier draws.

Philox4x64-10, the generator of `numpy.random.Philox`: 256 bits of counter and 128 bits of key become 256 random bits.
Here the key is (seed, scenario) and the counter (block, stream, episode, pedestrian), so that an episode's draws do not
depend on the batch, its order or the process, nor a pedestrian's on how many others there are. What belongs to the
episode or its driver is drawn as pedestrian 0.

See 'Parallel random numbers: as easy as 1, 2, 3' by Salmon, Moraes, Dror and Shaw, SC 2011
(https://doi.org/10.1145/2063384.2063405).
"""

import numpy as np
from numba import uint64
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.compiled import kernel

STREAM_SPAWN = 0  # where an episode begins
STREAM_EXPLORATION = 1  # add the policy step shifted left by 8, so that each step is a stream of its own
STREAM_KIND = 2  # of which kind a pedestrian is
STREAM_CROWD = 3  # how many pedestrians there are, and what each is to the first
STREAM_PERCEPTION = 20  # errors of the objects that a driving system gets; add the frame shifted left by 8
STREAM_REACTION = 21  # which recorded reaction is chosen; add the frame shifted left by 8

_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MANTISSA = np.uint64(11)
_ULP = 2.0**-53


@kernel
def _high(a: np.uint64, b: np.uint64) -> np.uint64:
    """Return the upper 64 bits of the 128-bit product of two uint64."""
    a0, a1, b0, b1 = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    middle = a1 * b0 + ((a0 * b0) >> _HALF)
    carry = a0 * b1 + (middle & _LOW)
    return a1 * b1 + (middle >> _HALF) + (carry >> _HALF)


@kernel
def philox(
    key0: np.uint64, key1: np.uint64, c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four uint64 that Philox4x64-10 makes of a key and a counter (all uint64)."""
    for _ in range(10):
        h0, l0 = _high(_MULTIPLIER_0, c0), _MULTIPLIER_0 * c0
        h1, l1 = _high(_MULTIPLIER_1, c2), _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = h1 ^ c1 ^ key0, l1, h0 ^ c3 ^ key1, l0
        key0, key1 = key0 + _WEYL_0, key1 + _WEYL_1
    return c0, c1, c2, c3


@kernel
def draw(episode, seed, stream, block):  # type: ignore[no-untyped-def]
    """Return four random uint64 for the pedestrian of an EPISODE record; the driver uses those of pedestrian 0."""
    key, number, person = uint64(episode.scenario), uint64(episode.episode), uint64(episode.pedestrian)
    return philox(uint64(seed), key, uint64(block), uint64(stream), number, person)


@kernel
def unit(bits: np.uint64) -> float:
    """Return the double in [0, 1) of 64 random bits, as numpy makes it: the upper 53 bits."""
    return float(bits >> _MANTISSA) * _ULP


@kernel
def _fill(seed, scenario, episode, stream, person, out):  # type: ignore[no-untyped-def]
    for i in range(out.shape[0]):
        for block in range((out.shape[1] + 3) // 4):
            bits = philox(seed[i], scenario[i], uint64(block), stream[i], episode[i], person[i])
            for k in range(4):
                if 4 * block + k < out.shape[1]:
                    out[i, 4 * block + k] = unit(bits[k])


def uniforms(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, stream: ArrayLike, n: int, pedestrian: ArrayLike = 0
) -> NDArray[np.float64]:
    """Return `n` numbers uniform in [0, 1) for each (seed, scenario, episode, stream, pedestrian), as float64[..., n].

    All arguments but `n` are whole numbers in [0, 2^64) that broadcast to the leading shape.

    :raises InvalidInput: a negative number or one that is not whole.
    """
    names = ("seed", "scenario", "episode", "stream", "pedestrian")
    keys = np.broadcast_arrays(*map(_as_uint64, names, (seed, scenario, episode, stream, pedestrian)))
    out = np.empty((keys[0].size, n))
    _fill(*(key.copy().reshape(-1) for key in keys), out)  # a view of what was broadcast cannot be relied on
    return out.reshape(*keys[0].shape, n)


def normals(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, stream: ArrayLike, n: int, pedestrian: ArrayLike = 0
) -> NDArray[np.float64]:
    """Return `n` standard normal numbers for each (seed, scenario, episode, stream, pedestrian), as float64[..., n].

    By the transform of Box and Muller on `uniforms`, with the same errors.
    """
    pairs = uniforms(seed, scenario, episode, stream, 2 * ((n + 1) // 2), pedestrian)
    out = np.empty_like(pairs)
    _box_muller(pairs.reshape(-1), out.reshape(-1))
    return out[..., :n]


@kernel
def normal_pair(first: float, second: float) -> tuple[float, float]:
    """Return two independent standard normal numbers, made from two uniform numbers in [0, 1)."""
    radius = np.sqrt(-2.0 * np.log(1.0 - first))
    return radius * np.cos(2.0 * np.pi * second), radius * np.sin(2.0 * np.pi * second)


@kernel
def _box_muller(u, out):  # type: ignore[no-untyped-def]
    for i in range(0, u.size, 2):
        out[i], out[i + 1] = normal_pair(u[i], u[i + 1])


def _as_uint64(name: str, value: ArrayLike) -> NDArray[np.uint64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iu" or (array.dtype.kind == "i" and (array < 0).any()):
        raise InvalidInput(f"{name}: expected whole numbers from 0 to 2^64 - 1, got {value!r}")
    return array.astype(np.uint64)
