from dataclasses import replace

import numpy as np

from vpsci_ros.evaluation.outcomes import Outcomes, measure_outcomes, rates_with_intervals
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.world import COLLISION, GOAL, TIMEOUT, WorldConfig, load_scenarios


def test_rates_add_up_and_carry_their_intervals():
    outcomes = Outcomes(outcomes=[COLLISION, GOAL, GOAL, TIMEOUT], least_curvttc=[0.0, 1.0, 2.0, 3.0])
    row = rates_with_intervals(outcomes)
    assert (row["collision_rate"], row["goal_rate"], row["timeout_rate"]) == (0.25, 0.5, 0.25)
    assert (row["goal_low"], row["goal_high"]) == wilson_interval(2, 4)
    assert row["least_curvttc_50"] == 1.5
    assert row["critical_episodes"] == 4


def test_without_critical_episodes_rates_are_not_numbers_and_intervals_say_nothing():
    row = rates_with_intervals(Outcomes())
    assert np.isnan(row["collision_rate"])
    assert (row["collision_low"], row["collision_high"]) == (0.0, 1.0)


def test_measuring_is_a_function_of_its_seed_and_whoever_does_not_accelerate_goes_on(networks):
    simulation = SimulationConfig(load_scenarios([1]), [(1, e) for e in range(8)], batch=8, seed=5)
    weights = networks().weights({}, {})
    first, second = (measure_outcomes(weights, replace(simulation, batch=batch)) for batch in (8, 3))
    assert first.outcomes
    assert sorted(zip(first.outcomes, first.least_curvttc, strict=True)) == sorted(
        zip(second.outcomes, second.least_curvttc, strict=True)
    )
    idle = measure_outcomes(None, simulation)
    held = measure_outcomes(None, replace(simulation, world=WorldConfig(release_time=0.5)))
    assert idle.outcomes
    assert idle.rates()["critical_episodes"] == held.rates()["critical_episodes"]
