"""Scenes that begin as recorded right turns do; the numbers are of `calibration.right_turns`, 215 onsets."""

import numpy as np
import pytest
from world.helpers import episodes, run

from vpsci_ros.world import PARKED_COLLISION, World, WorldConfig, calibration, load_scenarios
from vpsci_ros.world.monitor import assess

TURNS = WorldConfig(spawn="right_turns", vehicle_driver="autopilot", pedestrian_driver="autopilot", episode_time=4.0)
PAIRS = [(scenario, number) for number in range(40) for scenario in range(1, 9)]
ONSET = calibration.TRACK + calibration.COLUMNS * calibration.HISTORY


@pytest.fixture(scope="module")
def approaches():
    """Episodes of the rule-based pair up to the first critical frame, EPISODE[T], of those that become critical."""
    found = []
    for rows in run(PAIRS, batch=len(PAIRS), config=TURNS).values():
        critical = np.flatnonzero(assess(rows)[2])
        if len(critical):
            found.append(rows[: critical[0] + 1])
    return found


def recorded_of(rows):
    """The recorded onset that an episode was drawn from."""
    number = int(rows["driver_onset"][0]) - 1
    return calibration.right_turns()[number]


def test_nearly_all_become_critical_when_the_recorded_ones_did(approaches):
    assert len(approaches) > 0.97 * len(PAIRS)
    late = np.array([(len(rows) - 1) * TURNS.tick - 0.1 * recorded_of(rows)[calibration.BEFORE] for rows in approaches])
    assert np.mean(np.abs(late) < 0.16) > 0.95


def test_both_come_to_the_onset_as_recorded_there(approaches):
    speed = np.array([[rows["vehicle_speed"][-1], recorded_of(rows)[ONSET + calibration.CAR]] for rows in approaches])
    assert np.quantile(np.abs(speed[:, 0] - speed[:, 1]), 0.9) < 0.5
    walk = [np.hypot(rows["pedestrian_vx"][-1], rows["pedestrian_vy"][-1]) for rows in approaches]
    real = [
        np.hypot(*recorded_of(rows)[ONSET + calibration.WALK_ALONG : ONSET + calibration.COLUMNS])
        for rows in approaches
    ]
    assert np.quantile(np.abs(np.array(walk) - real), 0.9) < 0.2


def test_curvttc_at_the_onset_is_near_the_recorded_one(approaches):
    ttc = np.array([assess(rows[-1:])[0][0] for rows in approaches])
    real = np.array([recorded_of(rows)[calibration.TTC] for rows in approaches])
    assert np.median(np.abs(ttc - real)) < 0.3
    assert np.corrcoef(ttc, real)[0, 1] > 0.7


def test_no_car_begins_in_a_parked_one():
    world = World(TURNS, load_scenarios([104]), [(104, number) for number in range(200)], 200, 1)
    crashed = [rows for rows in episodes(world).values() if rows["outcome"][-1] == PARKED_COLLISION]
    assert not any(len(rows) < 10 for rows in crashed), "of the spawns of before, 12 did"
