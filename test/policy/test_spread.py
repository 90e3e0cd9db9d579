"""The vehicle's acceleration of its own: a function of its key, as wide as asked for, and the vehicle's alone."""

from dataclasses import replace

import numpy as np
import pytest

from vpsci_ros.data.near_misses import load_corpus
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.simulators import ROLL_OUTS, policy
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.spread import own_acceleration
from vpsci_ros.policy.weights import Weights, weights_from_bytes, weights_to_bytes
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.observation import AGENTS, STEP
from vpsci_ros.world.tick import Tick

SLOTS, SPREAD = 16, 1.0


@pytest.fixture(scope="module")
def weights() -> Weights:
    return Networks(NetworkConfig(hidden=16, layers=1)).weights({}, {})


def with_spread(weights: Weights, spread: float) -> Weights:
    return replace(weights, network=replace(weights.network, vehicle_spread=spread))


def test_it_has_the_spread_at_the_hand_over_and_a_third_of_it_after_one_and_a_half_seconds() -> None:
    episodes = np.arange(20_000)
    at_first, later = (own_acceleration(7, 1, episodes, step, 2.0) for step in (0, round(1.5 / STEP)))
    assert at_first[:, 0].std() == pytest.approx(2.0, rel=0.02)  # 4 standard errors of 20,000 draws
    np.testing.assert_allclose(later, at_first / np.e, rtol=1e-5, atol=1e-6)
    assert not at_first[:, 1].any()


def test_it_depends_on_seed_scenario_and_episode_and_not_on_the_batch() -> None:
    episodes = np.arange(50)
    every = own_acceleration(7, 1, episodes, 3, 2.0)
    np.testing.assert_array_equal(every[20:30], own_acceleration(7, 1, episodes[20:30], 3, 2.0))
    assert np.all(every[:, 0] != own_acceleration(8, 1, episodes, 3, 2.0)[:, 0])
    assert np.all(every[:, 0] != own_acceleration(7, 2, episodes, 3, 2.0)[:, 0])


@pytest.mark.parametrize("agent", AGENTS)
def test_the_vehicle_alone_gets_it_at_its_hand_over_within_the_limit(weights: Weights, agent: str) -> None:
    def first_actions(given: Weights) -> np.ndarray:
        acting = PolicyAgent(agent, 5, explore=False)
        acting.load(given, version=1)
        state = np.zeros(SLOTS, EPISODE)
        state["status"], state["scenario"], state["episode"] = RUNNING, 1, np.arange(SLOTS)
        state["vehicle_speed"], state["pedestrian_x"] = 3.0, 5.0
        every, near = np.ones(SLOTS, bool), np.full(SLOTS, 2.0)
        tick = Tick(number=0, state=state, policy_frame=every)
        return acting.act(tick, tick.assessed(near, near, every))

    plain, drawn = first_actions(weights), first_actions(with_spread(weights, SPREAD))
    own = own_acceleration(5, 1, np.arange(SLOTS), 0, SPREAD) if agent == "vehicle" else 0.0
    np.testing.assert_allclose(drawn, np.clip(plain + own, -5.0, 5.0), atol=1e-6)
    assert np.abs(first_actions(with_spread(weights, 5.0))).max() <= NetworkConfig().action_limit


def test_weights_keep_their_spread_in_the_file_and_are_rolled_out_often(weights: Weights) -> None:
    again = weights_from_bytes(weights_to_bytes(with_spread(weights, SPREAD)))
    assert again.network.vehicle_spread == SPREAD
    onsets = find_onsets(load_corpus(["right_turns/dev"])).take(np.arange(3))
    drawn, plain = policy(again, seed=0)(onsets), policy(weights, seed=0)(onsets)
    assert drawn.shape[1] == ROLL_OUTS
    assert plain.shape[1] == 1
    assert np.all(drawn[:, :, 0, -1].std(axis=1).sum(axis=-1) > 0.3)  # the cars' last positions [m]
    np.testing.assert_array_equal(policy(again, seed=0)(onsets), drawn)
