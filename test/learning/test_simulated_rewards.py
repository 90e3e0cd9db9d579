import numpy as np
import pytest

from vpsci_ros.learning.assembly import HistoryAssembler
from vpsci_ros.learning.config import RefineConfig
from vpsci_ros.learning.simulated_rewards import SimulatedRewards
from vpsci_ros.learning.transitions import TRANSITION

STEPS = 10


@pytest.fixture
def rewards(networks):
    return SimulatedRewards(RefineConfig(), networks())


def experienced(pedestrian_goal_at=None):
    """Ten steps of noise that end in a collision."""
    rng = np.random.default_rng(0)
    rows = np.zeros(STEPS, TRANSITION)
    rows["number"] = rows["step"] = np.arange(STEPS)
    rows["scenario"] = 1
    for name in ("vehicle_observation", "pedestrian_observation", "vehicle_action", "pedestrian_action"):
        rows[name] = rng.normal(size=rows[name].shape)
    rows["collision"][-1] = rows["terminal"][-1] = rows["last"][-1] = 1
    if pedestrian_goal_at is not None:
        rows["pedestrian_goal"][pedestrian_goal_at] = 1
    config = RefineConfig()
    (history,) = HistoryAssembler(config.collision_reward, config.goal_reward).add(rows)
    return history


def test_the_speed_reward_is_zero_where_the_policy_acts_as_stage_1_did(rewards):
    history = experienced()
    rewards.refer([history])
    assert all(np.all(c[:, 2] < 0.0) for c in rewards.components(history).values())
    for agent in ("vehicle", "pedestrian"):
        velocity = history.observation[agent][:-1, :2]
        history.action[agent] = (history.next_velocity[agent] - velocity) / np.float32(0.1)
        np.testing.assert_allclose(rewards.components(history)[agent][:, 2], 0.0, atol=1e-6)


def test_collisions_and_goals_are_rewarded_as_equations_25_and_26_say(rewards):
    history = experienced(pedestrian_goal_at=4)
    rewards.refer([history])
    components = rewards.components(history)
    assert components["vehicle"][:, 0].tolist() == [0.0] * 9 + [-200.0]
    assert components["vehicle"][:, 1].sum() == 0.0
    assert components["pedestrian"][4, 1] == 100.0
