"""A history from each hand-over to its hand-back: the same where a policy acts and where it is learned."""

import numpy as np
import pytest
import torch

from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.rewards import controlled
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2)
PAPER = WorldConfig(spawn="paper", episode_time=10.0, release_time=0.0, lane_following=False)
EPISODES = [(scenario, number) for number in range(3) for scenario in (1, 2, 5, 7)]


@pytest.fixture(scope="module")
def networks() -> Networks:
    torch.manual_seed(5)
    made = Networks(SMALL)
    with torch.no_grad():
        for agent in AGENTS:
            made.actor[agent].head[-1].weight.normal_(0.0, 0.5)
    return made


def histories(networks: Networks) -> list[np.ndarray]:
    """Simulate; return the transitions of each episode."""
    scenarios = load_scenarios([1, 2, 5, 7])
    world, builder = World(PAPER, scenarios, EPISODES, 8, 3), TransitionBuilder(PAPER, scenarios)
    agents = policies(networks.weights({}, {}), world)
    return [whole for step in Loop(world, agents=agents) for whole in builder.observe(step)[1]]


def test_a_policy_acts_by_the_history_that_is_learned_from(networks):
    """What the network says of a history from a hand-over on is what was done at every step until the hand-back."""
    again, came = 0, 0.0
    for whole in histories(networks):
        parts = controlled(whole)
        again += len(parts) - 1
        for begin, end in parts:
            own = whole[begin:end]
            for agent in AGENTS:
                names = (f"{agent}_{name}" for name in ("observation", "action", "came"))
                seen, done, motion = (torch.from_numpy(own[name].copy())[None] for name in names)
                curvttc = torch.from_numpy(own["curvttc"].copy())[None]
                with torch.no_grad():
                    said = networks.actor[agent](seen, previous(done, motion[:, 0]), curvttc)[0]
                np.testing.assert_allclose(said.numpy(), own[f"{agent}_action"], atol=1e-4)
                came = max(came, float(motion[:, 0].abs().max()))
    assert again > 3, "the policies were handed over to again, and began anew"
    assert came > 0.5, "agents come with an acceleration"
