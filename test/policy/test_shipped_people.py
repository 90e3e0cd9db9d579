"""The shipped stochastic policies: they draw, they vary, and without having met the simulation they mind each other."""

import numpy as np
import pytest

from vpsci_ros.learning.measured import measure_outcomes, rates_with_intervals
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.policy.simulation import SimulationConfig
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS

EPISODES = [(scenario, number) for number in range(25) for scenario in range(1, 9)]


@pytest.fixture(scope="module")
def people() -> Weights:
    return load_weights(weights_path("people"))


def outcomes(weights: Weights, temperature: float) -> dict[str, float]:
    """Rates in the scenes that begin as recorded ones do, with people's own accelerations."""
    policies = {agent: PolicyConfig(temperature=temperature) for agent in AGENTS}
    world = WorldConfig(spawn="human", pedestrian_gain=1.0)
    scenarios = load_scenarios(range(1, 9))
    simulation = SimulationConfig(scenarios, EPISODES, batch=200, seed=20261121, world=world, policies=policies)
    return rates_with_intervals(measure_outcomes(weights, simulation))


def test_people_are_drawn_and_say_what_was_held_out(people: Weights) -> None:
    assert people.network.latent == 8
    assert (
        people.facts["data"]["held_out_clips"]
        == load_weights(weights_path("pretrained")).facts["data"]["held_out_clips"]
    )
    for agent in AGENTS:
        kept = 1.0 / (1.0 + np.exp(-people.actor(agent).tensors["persistence_logit"][0]))
        assert 0.5 < kept < 0.99  # the noise lasts for 0.2 to 10 s


def test_people_who_learned_their_distribution_collide_half_as_often_as_who_learned_the_mean(people: Weights) -> None:
    mean = outcomes(load_weights(weights_path("pretrained")), 1.0)
    drawn, middle = (outcomes(people, temperature) for temperature in (1.0, 0.0))
    assert drawn["collision_rate"] < 0.6 * mean["collision_rate"]
    assert drawn["least_curvttc_50"] != middle["least_curvttc_50"]
