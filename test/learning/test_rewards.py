import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import RewardsConfig
from vpsci_ros.learning.rewards import RewardWeights, SimulatedRewards, predicted_velocity, speed_reward
from vpsci_ros.learning.transitions import TRANSITION

STEPS = 10


def test_speed_reward_is_that_of_equation_14():
    """For mu = (4, 0), sigma = (2, 0.5): ((5-4)/2 - (4.6-4)/2)^2 + ((0.1-0)/0.5 - (-0.1-0)/0.5)^2 = 0.04 + 0.16."""
    reward = speed_reward(torch.tensor([5.0, 0.1]), torch.tensor([4.6, -0.1]), torch.tensor([2.0, 0.5]))
    assert reward.item() == pytest.approx(-0.2)


def test_speed_reward_is_zero_where_the_prediction_is_right():
    velocity, action = torch.tensor([3.0, 0.5]), torch.tensor([-2.0, 1.0])
    predicted = predicted_velocity(velocity, action)
    torch.testing.assert_close(predicted, torch.tensor([2.8, 0.6]))
    assert speed_reward(predicted, predicted, torch.ones(2)).item() == 0.0


def test_weights_adapt_as_equation_28_says():
    weights = RewardWeights(RewardsConfig(weight_temperature=0.1))
    components = np.array([[0.0, 100.0, -1.0], [0.0, 0.0, -3.0]])  # means 0, 50 and -2
    weights.episode(components)
    grown = np.exp(0.1 * np.array([0.0, 50.0, 2.0]))
    np.testing.assert_allclose(weights.values, grown / grown.sum())


def test_weights_stay_a_share_of_one_whatever_the_rewards():
    weights = RewardWeights(RewardsConfig(weight_temperature=10.0))
    for _ in range(50):
        weights.episode(np.array([[-200.0, 100.0, -1e4]]))
    assert weights.values.sum() == pytest.approx(1.0)
    assert np.isfinite(weights.values).all()
    assert (weights.values >= 0.0).all()


def test_fixed_weights_do_not_adapt():
    weights = RewardWeights(RewardsConfig(weights=[0.6, 0.2, 0.2]))
    weights.episode(np.array([[-200.0, 100.0, -1e4]]))
    np.testing.assert_allclose(weights.values, [0.6, 0.2, 0.2])
    assert weights.total(np.array([-200.0, 0.0, -1.0])) == pytest.approx(-120.2)


def test_weights_that_do_not_add_up_are_refused():
    with pytest.raises(InvalidInput, match="add up to 1"):
        RewardsConfig(weights=[0.5, 0.2, 0.2])


@pytest.fixture
def rewards(networks):
    return SimulatedRewards(RewardsConfig(), networks())


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
    return rows


def test_the_speed_reward_is_zero_where_the_policy_acts_as_stage_1_did(rewards):
    (history,) = rewards.histories([experienced()])
    assert all(np.all(c[:, 2] < 0.0) for c in rewards.components(history).values())
    for agent in ("vehicle", "pedestrian"):
        velocity = history.observation[agent][:-1, :2]
        history.action[agent] = (history.next_velocity[agent] - velocity) / np.float32(0.1)
        np.testing.assert_allclose(rewards.components(history)[agent][:, 2], 0.0, atol=1e-6)


def test_collisions_and_goals_are_rewarded_as_equations_25_and_26_say(rewards):
    (history,) = rewards.histories([experienced(pedestrian_goal_at=4)])
    components = rewards.components(history)
    assert components["vehicle"][:, 0].tolist() == [0.0] * 9 + [-200.0]
    assert components["vehicle"][:, 1].sum() == 0.0
    assert components["pedestrian"][4, 1] == 100.0
    assert history.terminal


def test_histories_of_several_lengths_are_those_that_each_would_be_alone(rewards):
    long, short = experienced(), experienced()[:4]
    short["next_vehicle_observation"][-1] = 7.0
    for history, rows in zip(rewards.histories([long, short]), (long, short), strict=True):
        (alone,) = rewards.histories([rows])
        assert len(history) == len(rows)
        assert history.observation["vehicle"][-1].tolist() == rows["next_vehicle_observation"][-1].tolist()
        for agent in ("vehicle", "pedestrian"):
            np.testing.assert_allclose(history.next_velocity[agent], alone.next_velocity[agent], atol=1e-6)
