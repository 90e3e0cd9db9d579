"""A policy at work: explores as its parameters say, and never beyond the limit of an action."""

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.policy_config import NetworkConfig, NoiseConfig
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.tick import Tick

SLOTS = 64


@pytest.fixture(scope="module")
def weights() -> Weights:
    return Networks(NetworkConfig()).weights({}, {})


def first_actions(weights: Weights, noise: NoiseConfig | None) -> np.ndarray:
    """Actions, float32[SLOTS, 2], of the first step after a hand-over in episodes 0, 1, ...; None: no exploration."""
    agent = PolicyAgent("vehicle", 1, explore=noise is not None, noise=noise)
    agent.load(weights, version=1)
    state = np.zeros(SLOTS, EPISODE)
    state["status"], state["scenario"], state["episode"] = RUNNING, 1, np.arange(SLOTS)
    state["vehicle_speed"], state["pedestrian_x"] = 3.0, 5.0
    every, near = np.ones(SLOTS, bool), np.full(SLOTS, 2.0)
    tick = Tick(number=0, state=state, policy_frame=every)
    return agent.act(tick, tick.assessed(near, near, every))


def test_the_noise_that_is_added_is_the_noise_that_is_set(weights: Weights) -> None:
    plain = first_actions(weights, None)
    none = first_actions(weights, NoiseConfig(start=0.0, floor=0.0))
    little = first_actions(weights, NoiseConfig(start=0.0, floor=0.02))
    twice = first_actions(weights, NoiseConfig(start=0.0, floor=0.04))
    assert none.tobytes() == plain.tobytes()
    np.testing.assert_allclose(twice - plain, 2 * (little - plain), atol=1e-5)
    assert np.std(little - plain) > 0.01


def test_people_are_named_of_a_bank_alone(weights: Weights) -> None:
    agent = PolicyAgent("pedestrian", 1, explore=False, people="cqut")
    with pytest.raises(InvalidInput, match="people: expected a bank for 'cqut', got weights of networks"):
        agent.load(weights, version=1)
    agent.load(load_policy("people"), version=1)
    assert agent.version == 1


def test_an_exploring_action_stays_within_the_limit(weights: Weights) -> None:
    wild = first_actions(weights, NoiseConfig(start=2.0, floor=2.0))
    assert np.abs(wild).max() == NetworkConfig().action_limit
