"""Scenes that begin as recorded right turns do; the numbers are of `people.RIGHT_TURNS`, 238 onsets of 214 clips."""

import numpy as np
import pytest
from world.helpers import run

from vpsci_ros.world import WorldConfig, people
from vpsci_ros.world.monitor import MonitorConfig, assess

TURNS = WorldConfig(spawn="right_turns", vehicle_driver="autopilot", pedestrian_driver="autopilot", episode_time=4.0)
PAIRS = [(scenario, number) for number in range(40) for scenario in range(1, 9)]


@pytest.fixture(scope="module")
def approaches():
    """Episodes of the rule-based pair up to the first critical frame, EPISODE[T], of those that become critical."""
    found = []
    for rows in run(PAIRS, batch=len(PAIRS), config=TURNS).values():
        critical = np.flatnonzero(assess(rows, MonitorConfig())[2])
        if len(critical):
            found.append(rows[: critical[0] + 1])
    return found


def recorded(column):
    return np.percentile(people.RIGHT_TURNS[:, column], (25, 50, 75))


def test_nearly_all_become_critical_and_few_at_once(approaches):
    assert len(approaches) > 0.9 * len(PAIRS)
    begun = np.array([len(rows) - 1 for rows in approaches]) * TURNS.tick
    assert np.mean(begun < 0.5) < 0.2
    assert 0.8 < np.median(begun) < 1.5


def test_cars_brake_into_the_bend_as_recorded_ones_do(approaches):
    seen = [rows for rows in approaches if len(rows) > 20]
    speeds = np.array([(rows["vehicle_speed"][-21], rows["vehicle_speed"][-1]) for rows in seen])
    assert np.percentile(speeds[:, 1], (25, 50, 75)) == pytest.approx(recorded(people.CAR), abs=0.35)
    assert np.percentile(speeds[:, 1] - speeds[:, 0], (25, 50, 75)) == pytest.approx(recorded(people.BRAKES), abs=0.35)


def test_walkers_walk_as_recorded_ones_and_some_stand(approaches):
    paces = np.array([np.hypot(rows["pedestrian_vx"][-1], rows["pedestrian_vy"][-1]) for rows in approaches])
    assert np.percentile(paces, (25, 50, 75)) == pytest.approx(recorded(people.WALK), abs=0.15)
    assert 0.01 < np.mean(paces < 0.3) < 0.15


def test_it_becomes_critical_as_late_as_recorded_and_not_at_five_seconds(approaches):
    ttc = np.array([assess(rows[-1:], MonitorConfig())[0][0] for rows in approaches])
    assert np.percentile(ttc, (25, 50, 75)) == pytest.approx(recorded(people.TTC), abs=0.45)


def test_speed_and_curvttc_go_together_as_recorded(approaches):
    speed = np.array([rows["vehicle_speed"][-1] for rows in approaches])
    ttc = np.array([assess(rows[-1:], MonitorConfig())[0][0] for rows in approaches])
    real = np.corrcoef(people.RIGHT_TURNS[:, [people.CAR, people.TTC]].T)[0, 1]
    assert real == pytest.approx(-0.38, abs=0.01)
    assert np.corrcoef(speed, ttc)[0, 1] == pytest.approx(real, abs=0.2)
