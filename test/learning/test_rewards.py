import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import RefineConfig
from vpsci_ros.learning.rewards import RewardWeights, predicted_velocity, speed_reward


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
    weights = RewardWeights(RefineConfig(weight_temperature=0.1))
    components = np.array([[0.0, 100.0, -1.0], [0.0, 0.0, -3.0]])  # means 0, 50 and -2
    weights.episode(components)
    grown = np.exp(0.1 * np.array([0.0, 50.0, 2.0]))
    np.testing.assert_allclose(weights.values, grown / grown.sum())


def test_weights_stay_a_share_of_one_whatever_the_rewards():
    weights = RewardWeights(RefineConfig(weight_temperature=10.0))
    for _ in range(50):
        weights.episode(np.array([[-200.0, 100.0, -1e4]]))
    assert weights.values.sum() == pytest.approx(1.0)
    assert np.isfinite(weights.values).all()
    assert (weights.values >= 0.0).all()


def test_fixed_weights_do_not_adapt():
    weights = RewardWeights(RefineConfig(reward_weights=[0.6, 0.2, 0.2]))
    weights.episode(np.array([[-200.0, 100.0, -1e4]]))
    np.testing.assert_allclose(weights.values, [0.6, 0.2, 0.2])
    assert weights.total(np.array([-200.0, 0.0, -1.0])) == pytest.approx(-120.2)


def test_weights_that_do_not_add_up_are_refused():
    with pytest.raises(InvalidInput, match="add up to 1"):
        RefineConfig(reward_weights=[0.5, 0.2, 0.2])
