"""Predictors of trajectories, and the single agent: their losses, and what their critics see."""

import numpy as np
import pytest
import torch
from synthetic import synthetic_near_misses
from torch.distributions import Independent, MultivariateNormal, Normal

from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.kinematics.scene import scene_at
from vpsci_ros.learning.config import ImitationConfig, PretrainConfig, UpdatesConfig
from vpsci_ros.learning.maddpg import Maddpg, Scored
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.prediction import Prediction, bivariate_nll, mixture_nll, ways
from vpsci_ros.learning.replay import collate, recorded_histories
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import network_of
from vpsci_ros.world.observation import AGENTS

pytestmark = pytest.mark.usefixtures("one_thread")
SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(interactions=16, seed=3).table, whole_tracks=True)


def test_the_mixture_is_scored_by_the_density_of_the_nearest_plan_and_its_probability():
    torch.manual_seed(0)
    mean, log_sigma, logits = torch.randn(2, 3, 5, 2), 0.3 * torch.randn(2, 3, 5, 2), torch.randn(2, 3)
    truth = mean[torch.arange(2), torch.tensor([2, 0])] + 0.01
    expected = 0.0
    for row, k in enumerate((2, 0)):
        density = Independent(Normal(mean[row, k], log_sigma[row, k].exp()), 2).log_prob(truth[row])
        expected -= (density + torch.log_softmax(logits[row], dim=0)[k]) / 2
    torch.testing.assert_close(mixture_nll(logits, mean, log_sigma, truth), expected)


def test_the_bivariate_normal_agrees_with_its_covariance():
    torch.manual_seed(0)
    mean, sigma, rho, truth = (
        torch.randn(7, 2),
        torch.rand(7, 2) + 0.2,
        0.9 * (2 * torch.rand(7) - 1),
        torch.randn(7, 2),
    )
    across = rho * sigma[:, 0] * sigma[:, 1]
    covariance = torch.stack([sigma[:, 0] ** 2, across, across, sigma[:, 1] ** 2], dim=1).view(7, 2, 2)
    expected = -MultivariateNormal(mean, covariance).log_prob(truth)
    torch.testing.assert_close(bivariate_nll(mean, sigma, rho, truth), expected)


@pytest.mark.parametrize("agent", AGENTS)
def test_the_way_of_recorded_actions_is_the_recorded_way(interactions, agent):
    motion, at = torch.from_numpy(interactions.motion), torch.from_numpy(interactions.first)
    begin, rows = scene_at(motion, at), torch.arange(len(motion))
    steps = at[:, None] + torch.arange(5)
    done = {a: torch.from_numpy(interactions.action[a]).double()[rows[:, None], steps] for a in AGENTS}
    other = done[AGENTS[1 - AGENTS.index(agent)]]
    both = torch.stack([done[agent], torch.zeros_like(done[agent])], dim=1)
    way = ways(agent, both, begin, other)
    columns = slice(0, 2) if agent == "vehicle" else slice(5, 7)
    apart = (motion[rows[:, None], steps + 1][..., columns] - getattr(begin, agent)[:, None]).norm(dim=2)
    torch.testing.assert_close(
        way[:, 0].norm(dim=2), apart, atol=0.03, rtol=0.0
    )  # the recording is not these kinematics
    assert not torch.allclose(way[:, 1], way[:, 0])


@pytest.mark.parametrize("name", ["multipath", "densetnt", "social_lstm"])
def test_a_predictor_learns_what_it_is_shown(interactions, name):
    config = PretrainConfig(episodes=60, imitation=ImitationConfig(rollouts=8, learning_rate=5e-4))
    torch.manual_seed(1)
    networks, rng = Networks(network_of(name, SMALL)), np.random.default_rng(1)
    networks.set_statistics(*interactions.samples(), 0.3)
    learning = Prediction(networks, interactions, config)
    losses = [sum(v for k, v in learning.update(rng, i).items() if k.endswith("_loss")) for i in range(60)]
    assert np.mean(losses[-10:]) < np.mean(losses[:10]) - 0.3


def test_a_network_that_is_no_predictor_is_refused(interactions):
    with pytest.raises(InvalidInput, match="encoder sst: a predictor's loss needs a predictor's network"):
        Prediction(Networks(SMALL), interactions, PretrainConfig())


@pytest.mark.parametrize("alone", [True, False])
def test_the_critic_of_a_single_agent_does_not_see_what_the_other_does(interactions, alone):
    batch = collate(recorded_histories(interactions)[:4])
    learned = []
    for other in (0.0, 3.0):  # what the other does, in whatever place
        torch.manual_seed(1)
        maddpg = Maddpg(Networks(SMALL), UpdatesConfig(critic_learning_rate=1e-2, gradient_clip=1e9), 1e-2)
        maddpg.alone = alone
        actions = maddpg.act(batch)
        scored = {agent: action.detach() for agent, action in actions.items()}
        scored["pedestrian"] = scored["pedestrian"] + other
        reward = dict.fromkeys(AGENTS, -torch.ones_like(batch.curvttc[:, 1:]))
        maddpg.update(batch, Scored(scored, reward), actions)
        learned.append(maddpg.networks.critic["vehicle"].head[0].weight.detach().clone())
    assert torch.equal(*learned) == alone
