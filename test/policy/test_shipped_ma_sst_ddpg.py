"""The shipped `ma_sst_ddpg` is learned by the paper's own algorithm, and does what the model card says."""

import pytest

from vpsci_ros.evaluation.outcomes import measure_outcomes, rates_with_intervals
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import WorldConfig, load_scenarios

# the scenes in which they learned in every other episode: control ends half a second after the danger, and nothing but
# (18) steers
PAPER = WorldConfig(spawn="paper", episode_time=10.0, pedestrian_gain=0.5, release_time=0.5, lane_following=False)
EPISODES = [(scenario, number) for number in range(25) for scenario in range(1, 9)]


@pytest.fixture(scope="module")
def weights():
    return load_weights(weights_path("ma_sst_ddpg"))


def test_it_was_learned_with_the_papers_networks_and_numbers_of_episodes_and_by_its_policy_gradient_alone(weights):
    network, first, second = (
        weights.configuration[name] for name in ("NetworkConfig", "PretrainConfig", "RefineConfig")
    )
    assert (network["hidden"], network["layers"], network["heads"], network["attention_window"]) == (256, 2, 8, 10)
    assert network["risk_input"] is False
    assert first["objective"] == second["objective"] == "ddpg"
    assert first["episodes"] == 3000


def outcomes(weights, world):
    """Rates of 200 episodes with the weights and, as the control, without any acceleration."""
    simulation = SimulationConfig(load_scenarios(range(1, 9)), EPISODES, batch=256, seed=20261121, world=world)
    return (rates_with_intervals(measure_outcomes(of, simulation)) for of in (weights, None))


def test_in_the_papers_scenes_it_collides_less_than_the_papers_and_reaches_more_goals(weights):
    learned, control = outcomes(weights, PAPER)
    assert learned["critical_episodes"] == control["critical_episodes"] > 100
    assert learned["collision_high"] < 0.083 < 0.6 < control["collision_low"]
    assert learned["goal_low"] > 0.812 > control["goal_high"]


def test_in_default_scenes_few_collide_where_half_would_without_a_reaction(weights):
    learned, control = outcomes(weights, WorldConfig())
    assert learned["collision_high"] < 0.09 < 0.35 < control["collision_low"]
