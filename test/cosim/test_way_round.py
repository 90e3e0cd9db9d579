"""A pedestrian before a vehicle that stands across its way walks round it."""

import math

import numpy as np
import pytest

from vpsci_ros.cosim import Pedestrian, Vehicle, Walker
from vpsci_ros.cosim.way_round import CORNER, meets, next_point
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.safety import clearance


def crossing(pedestrian: Pedestrian, car: Vehicle, seconds: float) -> tuple[float, float]:
    """Return when the pedestrian arrives [s], infinity if later, and its least clearance to the standing car [m]."""
    now, least = Walker(0.0, -4.0), math.inf
    for k in range(round(seconds / 0.05)):
        walk = pedestrian.step(now, {"car": car})
        now = Walker(walk.x, walk.y, walk.vx, walk.vy)
        least = min(least, float(clearance(car.x, car.y, car.heading, now.x, now.y)))
        if walk.arrived:
            return 0.05 * (k + 1), least
    return math.inf, least


def test_everybody_is_past_a_car_that_stands_across_the_way_within_30_s_without_contact() -> None:
    people = load_policy("people")
    for seed in range(50):
        car = Vehicle(0.0, 0.0, 0.3 * (seed % 3 - 1), 0.0)
        arrives, least = crossing(Pedestrian(people, seed=seed, goal=(0.0, 4.0)), car, 30.0)
        assert arrives <= 30.0, seed
        assert least > 0.0, seed


def test_a_car_that_stands_beside_the_way_changes_nothing() -> None:
    found = []
    for x in (4.5, 500.0):
        pedestrian, now, walked = Pedestrian(seed=3, goal=(0.0, 8.0), speed=1.4), Walker(0.0, -4.0), []
        for _ in range(160):
            walk = pedestrian.step(now, {"car": Vehicle(x, 0.0, 0.0, 0.0)})
            now = Walker(walk.x, walk.y, walk.vx, walk.vy)
            walked.append(now)
        found.append(walked)
    assert found[0] == found[1]


BOX = np.array([0.0, 0.0, 0.0, 4.0, 2.0])


@pytest.mark.parametrize(("x", "side"), [(0.5, 1.0), (-0.5, -1.0)])
def test_the_way_leads_by_the_nearer_corner(x: float, side: float) -> None:
    corner = side * (2.0 + CORNER), -(1.0 + CORNER)
    assert next_point((x, -3.0), (x, 3.0), [BOX]) == pytest.approx(corner)
    assert next_point(corner, (x, 3.0), [BOX]) == pytest.approx((corner[0], -corner[1]))


def test_a_segment_meets_a_box_that_it_passes_too_near() -> None:
    assert meets((-3.0, 1.5), (3.0, 1.5), BOX, 0.6)
    assert not meets((-3.0, 1.5), (3.0, 1.5), BOX, 0.4)
    assert meets((0.0, 0.0), (0.0, 0.0), BOX, 0.1), "a point within"
    assert next_point((-3.0, 1.7), (3.0, 1.7), [BOX]) == (3.0, 1.7)
