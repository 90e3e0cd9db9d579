"""The shipped weights vary as people do, and mind each other: a little by what people do, far more by stage 2."""

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
    return {name: outcomes(shipped[name], 1.0) for name in ("pretrained", "refined")}


def test_both_stages_borrow_of_people_and_hold_out_the_same_clips(shipped: dict[str, Weights]) -> None:
    for weights in (shipped["pretrained"], shipped["refined"]):
        assert weights.network.residuals
        assert weights.facts["data"]["people"] == ["cqut", "vci"]
        held_out = weights.facts["data"]["held_out_clips"]
        assert held_out == shipped["pretrained"].facts["data"]["held_out_clips"]
        assert set(shipped["pretrained_deterministic"].facts["data"]["held_out_clips"]) < set(held_out)
        assert {clip.split("/")[1] for clip in held_out if clip.startswith("cqut-pvi")} == {"dev"}


def test_stage_1_of_these_people_collides_less_often_than_their_mean(shipped: dict[str, Weights], rates) -> None:
    assert rates["pretrained"]["collision_rate"] < outcomes(shipped["pretrained"], 0.0)["collision_rate"]


def test_stage_2_leaves_less_than_half_of_the_collisions_and_both_reach_their_goals(rates) -> None:
    assert rates["refined"]["critical_episodes"] > 200
    assert rates["refined"]["collision_rate"] < 0.4 * rates["pretrained"]["collision_rate"]
    assert rates["refined"]["goal_rate"] > 0.812  # the paper's


def test_temperature_0_is_another_behaviour(shipped: dict[str, Weights], rates) -> None:
    assert outcomes(shipped["refined"], 0.0)["least_curvttc_50"] != rates["refined"]["least_curvttc_50"]
