from dataclasses import replace

import numpy as np

from vpsci_ros.evaluation.outcomes import Outcomes, measure_outcomes
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.extras.paper.rates import rates_with_intervals
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.world import COLLISION, EPISODE, GOAL, RUNNING, TIMEOUT, WorldConfig, load_scenarios
from vpsci_ros.world.state import EVENT, FINISHED, HANDED_OVER
from vpsci_ros.world.tick import NO_ACTIONS, Step, Tick

ONE = load_scenarios([1])


def test_a_car_that_left_its_lane_by_half_its_width_has_no_goal():
    """Two episodes with a hand-over end with both goals; in one the car was 1.8 m off while the policy drove it."""
    outcomes = Outcomes(WorldConfig(), ONE)
    lane = outcomes._tables.lane[0]
    along = (lane[21] - lane[20]) / np.linalg.norm(lane[21] - lane[20])
    state = np.zeros(2, EPISODE)
    state["scenario"], state["episode"], state["status"], state["controlled"] = 1, [4, 5], RUNNING, 1
    for row, aside in zip(state, (1.7, 1.8), strict=True):
        row["vehicle_x"], row["vehicle_y"] = lane[20] + aside * np.array([-along[1], along[0]])
        row["route_s"] = outcomes._tables.rows[0]["lane_step"] * 20
    nothing, events = np.zeros(0, EVENT), np.zeros(4, EVENT)
    events["scenario"], events["episode"], events["outcome"] = 1, [4, 5, 4, 5], GOAL
    events["kind"] = [HANDED_OVER, HANDED_OVER, FINISHED, FINISHED]
    tick = Tick(0, state, np.ones(2, bool))
    step = Step(tick, tick.assessed(np.ones(2), np.ones(2), np.ones(2, bool)), NO_ACTIONS, nothing)
    outcomes.note(step)
    outcomes.note(step._replace(events=events))
    assert outcomes.outcomes == [GOAL, TIMEOUT]


def test_rates_add_up_and_carry_their_intervals():
    outcomes = Outcomes(
        WorldConfig(), ONE, outcomes=[COLLISION, GOAL, GOAL, TIMEOUT], least_curvttc=[0.0, 1.0, 2.0, 3.0]
    )
    row = rates_with_intervals(outcomes)
    assert (row["collision_rate"], row["goal_rate"], row["timeout_rate"]) == (0.25, 0.5, 0.25)
    assert (row["goal_low"], row["goal_high"]) == wilson_interval(2, 4)
    assert row["least_curvttc_50"] == 1.5
    assert row["critical_episodes"] == 4


def test_without_critical_episodes_rates_are_not_numbers_and_intervals_say_nothing():
    row = rates_with_intervals(Outcomes(WorldConfig(), ONE))
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
