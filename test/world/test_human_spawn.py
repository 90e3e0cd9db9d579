"""Scenes that begin as recorded ones do; the numbers are of benchmarks/onsets.py, 180 onsets of 34 clips."""

import numpy as np
import pytest
from world.helpers import SCENARIOS, frames, run

from vpsci_ros.world import RUNNING, World, WorldConfig, calibration
from vpsci_ros.world.kinematics import MAX_DECELERATION, RUNNING_SPEED
from vpsci_ros.world.monitor import assess

HUMAN = WorldConfig(spawn="human", vehicle_driver="autopilot", pedestrian_driver="autopilot")
PAIRS = [(scenario, number) for number in range(60) for scenario in range(1, 9)]
LOOK_BACK = 40  # ticks: 2 s


def brake_and_stop(state):
    """Actions float64[B, 2] of policies that brake as firmly as they can and turn back."""
    full = np.tile([-MAX_DECELERATION, 0.0], (len(state), 1))
    return full, full


@pytest.fixture(scope="module")
def approaches():
    """Episodes of the rule-based pair up to the first critical frame, EPISODE[T], of those that become critical."""
    found = []
    for rows in run(PAIRS, batch=480, config=HUMAN).values():
        critical = np.flatnonzero(assess(rows)[2])
        if len(critical):
            found.append(rows[: critical[0] + 1])
    return found


def at_onset(approaches, name):
    return np.array([rows[name][-1] for rows in approaches])


def walking(rows):
    return np.hypot(rows["pedestrian_vx"], rows["pedestrian_vy"])


def test_four_in_five_meetings_become_critical_and_few_at_once(approaches):
    assert 0.7 * len(PAIRS) < len(approaches) < 0.95 * len(PAIRS)
    begun = np.array([len(rows) - 1 for rows in approaches]) * HUMAN.tick
    assert np.mean(begun < 0.3) < 0.06
    assert 0.7 < np.median(begun) < 2.5


def test_cars_come_as_fast_as_recorded_ones(approaches):
    speed = at_onset(approaches, "vehicle_speed")
    assert np.percentile(speed, (25, 50, 75)) == pytest.approx((1.44, 1.93, 2.70), abs=0.4)
    assert np.mean(speed > 3.0) < 0.4
    assert speed.max() < 5.7


def test_walkers_walk_as_fast_as_recorded_ones_and_nobody_runs(approaches):
    pace = np.array([walking(rows)[-1] for rows in approaches])
    assert np.percentile(pace, (25, 50, 75)) == pytest.approx((1.10, 1.23, 1.34), abs=0.08)
    assert max(walking(rows).max() for rows in approaches) < 2.0


def test_nobody_leaps_off_the_kerb(approaches):
    stood = [walking(rows)[-LOOK_BACK:].min() < 0.3 for rows in approaches]
    assert 0.0 < np.mean(stood) < 0.10
    for rows in approaches:
        velocity = np.stack([rows["pedestrian_vx"], rows["pedestrian_vy"]], axis=1)
        change = np.hypot(*np.diff(velocity, axis=0).T) / HUMAN.tick
        assert (change < rows["stride"][0] + 1e-9).all()


def test_accelerations_never_jump_though_the_policies_brake_at_once_when_they_take_over():
    config = WorldConfig(spawn="human")
    world = World(config, SCENARIOS, PAIRS[:160], 160, 1)
    allowed = calibration.JERK * config.tick + 1e-9
    before, held = None, 0
    for state, _ in frames(world, brake_and_stop):
        if before is not None:
            same = (state["status"] == RUNNING) & (state["frame"] == before["frame"] + 1)
            moving = same & (state["vehicle_speed"] > 0.0)  # where it stops, its deceleration ends
            jump = np.abs(state["vehicle_acceleration"] - before["vehicle_acceleration"])
            assert (jump[moving] <= allowed).all()
            change = [state[f"pedestrian_{axis}"] - before[f"pedestrian_{axis}"] for axis in ("ax", "ay")]
            free = same & (walking(state) < RUNNING_SPEED - 0.5)  # at that speed it stays
            assert (np.hypot(*change)[free] <= allowed).all()
            held += int((moving & (state["controlled"] > 0)).sum())
        before = state
    assert held > 1000
