"""The shipped weights draw, vary, and mind each other: a little by what people do, far more by stage 2."""

import numpy as np
import pytest

from vpsci_ros.learning.measured import measure_outcomes, rates_with_intervals
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.policy.simulation import SimulationConfig
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.observation import AGENTS

EPISODES = [(scenario, number) for number in range(40) for scenario in range(1, 9)]


@pytest.fixture(scope="module")
def shipped() -> dict[str, Weights]:
    return {name: load_weights(weights_path(name)) for name in ("pretrained", "refined", "pretrained_deterministic")}


def outcomes(weights: Weights, temperature: float) -> dict[str, float]:
    """Rates in the scenes that begin as recorded ones do."""
    policies = {agent: PolicyConfig(temperature=temperature) for agent in AGENTS}
    scenarios = load_scenarios(range(1, 9))
    simulation = SimulationConfig(scenarios, EPISODES, batch=512, seed=20261121, policies=policies)
    return rates_with_intervals(measure_outcomes(weights, simulation))


@pytest.fixture(scope="module")
def rates(shipped: dict[str, Weights]) -> dict[str, dict[str, float]]:
    return {name: outcomes(weights, 1.0) for name, weights in shipped.items()}


def test_both_stages_draw_and_hold_out_the_same_clips(shipped: dict[str, Weights]) -> None:
    held_out = {name: weights.facts["data"]["held_out_clips"] for name, weights in shipped.items()}
    assert held_out["pretrained"] == held_out["refined"] == held_out["pretrained_deterministic"]
    for name in ("pretrained", "refined"):
        assert shipped[name].network.latent == 8
        for agent in AGENTS:
            kept = 1.0 / (1.0 + np.exp(-shipped[name].actor(agent).tensors["persistence_logit"][0]))
            assert 0.5 < kept < 0.99  # the noise lasts for 0.2 to 10 s


def test_who_learned_the_distribution_collides_half_as_often_as_who_learned_the_mean(rates) -> None:
    assert rates["pretrained"]["collision_rate"] < 0.6 * rates["pretrained_deterministic"]["collision_rate"]


def test_stage_2_halves_the_collisions_and_both_reach_their_goals(rates) -> None:
    assert rates["refined"]["critical_episodes"] > 200
    assert rates["refined"]["collision_rate"] < 0.7 * rates["pretrained"]["collision_rate"]
    assert rates["refined"]["goal_rate"] > 0.812  # the paper's


def test_temperature_0_is_another_behaviour(shipped: dict[str, Weights], rates) -> None:
    assert outcomes(shipped["refined"], 0.0)["least_curvttc_50"] != rates["refined"]["least_curvttc_50"]
