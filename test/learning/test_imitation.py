from dataclasses import replace

import numpy as np
import pytest
import torch

from vpsci_ros.learning.config import AGENTS, PretrainConfig
from vpsci_ros.learning.imitation import Start, draw, recorded
from vpsci_ros.learning.interactions import from_table
from vpsci_ros.learning.sst import range_and_rate, residual


@pytest.fixture(scope="module")
def interactions(near_misses):
    return from_table(near_misses)


def start(interactions, mirror=False, scale=1.0):
    count = len(interactions)
    none = np.zeros(count, np.int64)
    return Start(np.arange(count), none, none, np.full(count, mirror), np.full(count, scale, np.float32))


def test_most_roll_outs_begin_near_the_first_critical_step_and_all_have_a_step_to_predict(interactions):
    drawn = draw(interactions, PretrainConfig(rollouts=4000), np.random.default_rng(0))
    near = np.abs(drawn.at - interactions.first[drawn.row]) <= 3
    assert near.mean() > 0.7
    assert not near.all()
    assert (drawn.at >= drawn.begin).all()
    assert (drawn.begin >= 0).all()
    assert (drawn.at <= interactions.length[drawn.row] - 2).all()
    assert np.log(drawn.scale).std() == pytest.approx(0.2, abs=0.02)
    plain = draw(interactions, PretrainConfig(rollouts=50, scaling=0.0, mirror=False), np.random.default_rng(0))
    assert (plain.scale == 1.0).all()
    assert not plain.mirror.any()


def test_a_scaled_near_miss_has_scaled_lengths_speeds_and_accelerations_and_the_same_headings(interactions):
    steps = int(interactions.length.max())
    plain = recorded(interactions, start(interactions), steps)
    larger = recorded(interactions, start(interactions, scale=1.5), steps)
    torch.testing.assert_close(larger.motion[..., 2], plain.motion[..., 2])
    others = [0, 1, 3, 4, 5, 6, 7, 8]
    torch.testing.assert_close(larger.motion[..., others], 1.5 * plain.motion[..., others])
    for agent in AGENTS:
        torch.testing.assert_close(larger.observation[agent], 1.5 * plain.observation[agent])
        torch.testing.assert_close(larger.action[agent], 1.5 * plain.action[agent])


def test_a_mirrored_near_miss_shows_the_same_range_rate_residual(interactions):
    steps = int(interactions.length.max())
    residuals = []
    for mirror in (False, True):
        seen = range_and_rate(recorded(interactions, start(interactions, mirror), steps).observation["vehicle"])
        residuals.append(residual(seen[:, 1:], seen[:, :-1]))
    torch.testing.assert_close(*residuals)


def test_roll_outs_are_taken_in_any_order(interactions):
    drawn = draw(interactions, replace(PretrainConfig(), rollouts=6), np.random.default_rng(0))
    rows = np.array([4, 0, 2])
    taken = drawn.take(rows)
    assert all(np.array_equal(part, whole[rows]) for part, whole in zip(taken, drawn, strict=True))
