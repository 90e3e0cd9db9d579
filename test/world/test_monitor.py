"""The monitor's core: the same bits as `curvttc`, whatever the batch, and idle slots are never critical."""

import numpy as np
import pytest
from world.helpers import SCENARIOS, frames

from vpsci_ros.safety import curvttc
from vpsci_ros.world import ENDED, IDLE, World, WorldConfig
from vpsci_ros.world.monitor import assess

NAMES = ("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature")
NAMES += ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy")


@pytest.fixture(scope="module")
def states():
    world = World(WorldConfig(), SCENARIOS, [(s, e) for e in range(4) for s in range(1, 9)], 20, 1)
    return [state for state, _ in frames(world)]


def test_the_monitor_gives_the_bits_of_curvttc(states):
    for state in states[::7]:
        present = state["status"] != IDLE
        ttc, distance, critical = assess(state)
        assert np.array_equal(ttc[present], curvttc(*(state[n][present] for n in NAMES)))
        assert np.isinf(ttc[~present]).all()
        assert np.array_equal(critical, (ttc < 5.0) & (state["status"] == 1))
        apart = np.hypot(state["vehicle_x"] - state["pedestrian_x"], state["vehicle_y"] - state["pedestrian_y"])
        assert np.allclose(distance, apart)


def test_the_last_frame_of_an_episode_has_a_curvttc_but_is_not_critical(states):
    last = np.concatenate([state[state["status"] == ENDED] for state in states])
    ttc, _, critical = assess(last)
    assert (ttc[last["outcome"] == 1] == 0.0).all()
    assert not critical.any()
