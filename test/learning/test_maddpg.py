import numpy as np
import pytest
import torch

from vpsci_ros.learning.config import AGENTS, TrainingConfig
from vpsci_ros.learning.interactions import from_table
from vpsci_ros.learning.maddpg import Maddpg, Scored, importance
from vpsci_ros.learning.replay import collate, recorded_histories


@pytest.fixture
def batch(near_misses):
    return collate(recorded_histories(from_table(near_misses))[:5])


def test_importance_is_that_of_equation_5_about_a_mean_of_one():
    error = torch.tensor([[1.0, -2.0, 7.0]])
    present = torch.tensor([[True, True, False]])
    omega = importance(error, present, 4.0)
    expected = np.exp(np.array([1.0, 2.0]) / 4.0)
    np.testing.assert_allclose(omega[0, :2], expected / expected.mean(), rtol=1e-6)
    assert omega[0, 2] == 0.0


def test_importance_stays_finite_whatever_the_error():
    omega = importance(torch.tensor([[1e30, 0.0]]), torch.tensor([[True, True]]), 1.0)
    assert torch.isfinite(omega).all()


def scored(batch, reward):
    action = {agent: batch.action[agent] for agent in AGENTS}
    return Scored(action, {agent: torch.full(batch.present.shape, reward) * batch.present for agent in AGENTS})


def test_targets_are_the_bellman_equation_with_nothing_after_the_end(networks, batch):
    made = networks()
    maddpg = Maddpg(made, TrainingConfig(discount=0.9), 1e-3, 1e-3, value_unit=10.0)
    targets = maddpg._targets(batch, scored(batch, 20.0))["vehicle"]
    recorded = {a: batch.observation[a][:1] for a in AGENTS}
    before = {a: torch.cat([torch.zeros(1, 1, 2), batch.action[a][:1]], dim=1) for a in AGENTS}
    curvttc = batch.curvttc[:1]
    actions = {a: made.target_actor[a](recorded[a], before[a], curvttc) for a in AGENTS}
    critic = made.target_critic["vehicle"]
    value = critic.value(critic.encode(recorded["vehicle"], before["vehicle"], curvttc), *(actions[a] for a in AGENTS))[
        0
    ]
    length = int(batch.present[0].sum())
    expected = 2.0 + 0.9 * value[1:length]
    torch.testing.assert_close(targets[0, : length - 1], expected, atol=1e-5, rtol=1e-4)
    assert targets[0, length - 1] == 2.0  # terminal


def test_critics_learn_a_return_that_can_be_known(networks, batch):
    """With no discount of the future and a reward of one everywhere, the value is one everywhere."""
    maddpg = Maddpg(networks(), TrainingConfig(discount=0.0), 1e-3, 1e-2)
    first = maddpg.update(batch, scored(batch, 1.0), None)
    for _ in range(60):
        last = maddpg.update(batch, scored(batch, 1.0), None)
    assert last.critic_loss["vehicle"] < 0.05 < first.critic_loss["vehicle"]
    assert last.actor_loss == {}


def test_actors_move_to_where_the_critic_sees_more_value(networks, batch):
    maddpg = Maddpg(networks(gain=1.0), TrainingConfig(gradient_clip=100.0), 1e-3, 0.0)
    values = [-maddpg.update(batch, scored(batch, 0.0), maddpg.act(batch)).actor_loss["pedestrian"] for _ in range(30)]
    assert values[-1] > values[0]


def test_targets_follow_at_the_soft_update_rate(networks, batch):
    made = networks()
    maddpg = Maddpg(made, TrainingConfig(target_update_rate=0.25), 1e-3, 1e-3)
    before = made.target_critic["vehicle"].state.weight.clone()
    maddpg.update(batch, scored(batch, 1.0), None)
    after, fast = made.target_critic["vehicle"].state.weight, made.critic["vehicle"].state.weight
    torch.testing.assert_close(after, 0.75 * before + 0.25 * fast)


def test_padding_changes_no_loss(networks, near_misses):
    histories = recorded_histories(from_table(near_misses))
    short = min(histories, key=len)
    long = max(histories, key=len)
    alone, padded = collate([short]), collate([short, long])
    errors = []
    for batch in (alone, padded):
        maddpg = Maddpg(networks(), TrainingConfig(), 1e-3, 1e-3)
        errors.append(maddpg.update(batch, scored(batch, 1.0), None).error[0, : len(short)])
    np.testing.assert_allclose(*errors, atol=1e-5)
