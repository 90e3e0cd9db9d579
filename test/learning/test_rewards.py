import numpy as np
import pytest
import torch

from vpsci_ros.data.interactions import from_table
from vpsci_ros.learning.replay import draw_recorded
from vpsci_ros.learning.rewards import RecordedRewards, RewardWeights, SimulatedRewards, speed_reward
from vpsci_ros.learning.training_config import RewardsConfig, SpeedRewardsConfig
from vpsci_ros.world.observation import AGENTS, STEP
from vpsci_ros.world.transition import TRANSITION

STEPS = 10


def test_speed_reward_is_that_of_equation_14():
    """For mu = (4, 0), sigma = (2, 0.5): ((5-4)/2 - (4.6-4)/2)^2 + ((0.1-0)/0.5 - (-0.1-0)/0.5)^2 = 0.04 + 0.16."""
    reward = speed_reward(torch.tensor([5.0, 0.1]), torch.tensor([4.6, -0.1]), torch.tensor([2.0, 0.5]))
    assert reward.item() == pytest.approx(-0.2)


def test_weights_adapt_as_equation_28_says_each_agents_by_its_own_rewards():
    weights = RewardWeights(RewardsConfig(weight_temperature=0.1))
    weights.episode(np.array([[0.0, 50.0, -2.0], [-20.0, 0.0, -2.0]]))
    for own, means in zip(weights.values, ([0.0, 50.0, 2.0], [20.0, 0.0, 2.0]), strict=True):
        grown = np.exp(0.1 * np.array(means))
        np.testing.assert_allclose(own, grown / grown.sum())


@pytest.fixture
def rewards(networks):
    return SimulatedRewards(RewardsConfig(), networks())


def experienced(pedestrian_goal_at=None):
    """Ten steps of noise that end in a collision."""
    rng = np.random.default_rng(0)
    rows = np.zeros(STEPS, TRANSITION)
    rows["number"] = rows["step"] = np.arange(STEPS)
    rows["scenario"], rows["acting"] = 1, 1
    for name in ("vehicle_observation", "pedestrian_observation", "vehicle_action", "pedestrian_action"):
        rows[name] = rng.normal(size=rows[name].shape)
    rows["collision"][-1] = rows["terminal"][-1] = rows["last"][-1] = 1
    if pedestrian_goal_at is not None:
        rows["pedestrian_goal"][pedestrian_goal_at] = 1
    return rows


def test_the_speed_reward_is_zero_where_the_policy_acts_as_stage_1_did(rewards):
    (history,) = rewards.histories([experienced()], 0.9)
    assert (rewards.components(history)[:, :, 2] < 0.0).all()
    for index, agent in enumerate(AGENTS):
        velocity = history.observation[agent][:-1, :2]
        history.action[agent] = (history.next_velocity[agent] - velocity) / np.float32(0.1)
        np.testing.assert_allclose(rewards.components(history)[index, :, 2], 0.0, atol=1e-6)


def test_collisions_and_goals_are_rewarded_as_equations_25_and_26_say(rewards):
    (history,) = rewards.histories([experienced(pedestrian_goal_at=4)], 0.9)
    vehicle, pedestrian = rewards.components(history)
    assert vehicle[:, 0].tolist() == [0.0] * 9 + [-200.0]
    assert vehicle[:, 1].sum() == 0.0
    assert pedestrian[4, 1] == 100.0
    assert history.terminal


def test_each_time_in_control_is_a_history_and_what_comes_of_it_is_discounted_by_the_time_until_then(rewards):
    """The policies act at steps 0 to 2 and 5 to 6; the walker's goal is reached at step 4, a collision ends step 9."""
    rows = experienced(pedestrian_goal_at=4)
    rows["acting"][[3, 4, 7, 8, 9]] = 0
    first, second = rewards.histories([rows], 0.9)
    assert (len(first), len(second)) == (3, 2)
    for history, begin in ((first, 0), (second, 5)):
        assert np.array_equal(history.observation["vehicle"][-1], rows["vehicle_observation"][begin + len(history)])
        assert history.terminal, "nothing follows but what was added"
    (vehicle, pedestrian), (later, _) = rewards.components(first), rewards.components(second)
    assert vehicle[-1, 0] == pytest.approx(-200.0 * 0.9**7)
    assert pedestrian[-1, 1] == pytest.approx(100.0 * 0.9**2)
    assert later[-1, 0] == pytest.approx(-200.0 * 0.9**3)
    assert not vehicle[:-1, :2].any()
    assert rewards.events(rows).tolist() == [[-200.0, 0.0], [-200.0, 100.0]]


def test_the_successor_of_an_explored_action_is_what_it_leads_to_by_the_kinematics(networks, near_misses):
    """An agent that brakes by 1 m/s2 more than the recorded one is 0.1 m/s slower at the next step."""
    interactions = from_table(near_misses)
    batch = draw_recorded(interactions, 64, np.random.default_rng(0))
    rewards, rows, last = RecordedRewards(SpeedRewardsConfig(), networks()), torch.arange(64), batch.length - 1
    scored = rewards.score(batch, {a: torch.zeros(64, 10, 2) for a in AGENTS}, np.random.default_rng(1))
    assert (scored.batch.observation["vehicle"] != batch.observation["vehicle"]).any(dim=2).sum() == 64
    tried, walked = scored.action["pedestrian"][rows, last], batch.observation["pedestrian"][rows, last, :2]
    after, turned = scored.batch.observation["pedestrian"][rows, last + 1, :2], walked + STEP * tried
    torch.testing.assert_close(after.norm(dim=1), turned.norm(dim=1), atol=1e-4, rtol=1e-4)  # its frame has turned
    assert torch.equal(scored.batch.action["pedestrian"][rows, last], tried), "and its history has that action"
