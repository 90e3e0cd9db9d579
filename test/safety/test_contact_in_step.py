"""Contacts within a step, by hand: the car is 4.69 m by 1.85 m, the pedestrian's radius 0.3 m."""

import math

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, contact_in_step, contact_step
from vpsci_ros.world.kinematics import MAX_DECELERATION, drive

FRONT, SIDE = 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS, 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS
SIZES = VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS


def seen(before: tuple[float, float], after: tuple[float, float], turn: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of both, of a car that stands turned by `turn`, for a pedestrian (ahead, aside) [m] of it."""
    cos, sin = math.cos(turn), math.sin(turn)
    places = [(3.0, -2.0, turn, 3.0 + cos * f - sin * s, -2.0 + sin * f + cos * s) for f, s in (before, after)]
    return np.array(places[0]), np.array(places[1])


@pytest.mark.parametrize(
    ("before", "after", "part"),
    [
        ((FRONT + 0.5, 0.0), (FRONT - 0.5, 0.0), 0.5),  # the front runs into the pedestrian
        ((0.0, -SIDE - 0.2), (0.0, SIDE + 0.6), 0.2 / (2.0 * SIDE + 0.8)),  # through the whole car
        (
            (FRONT + 0.3, SIDE - 0.3),
            (FRONT - 0.7, SIDE + 0.1),
            (0.6 - math.sqrt(0.36 - 1.16 * 0.27)) / 1.16,
        ),  # its corner
        ((FRONT + 0.1, 0.0), (FRONT + 0.1, 3.0), math.inf),  # along the front
        ((FRONT + 0.2, SIDE - 0.2), (FRONT - 0.2, SIDE + 0.2), math.inf),  # past the corner, 0.42 m off its point
        ((FRONT - 0.1, 0.0), (FRONT + 0.9, 0.0), 0.0),  # touching as it begins
        ((FRONT + 1.0, 0.0), (FRONT, 0.0), 1.0),  # touching as it ends
    ],
)
def test_the_part_of_a_step_before_contact_is_that_of_geometry(before, after, part):
    assert contact_in_step(*seen(before, after), *SIZES) == pytest.approx(part, abs=1e-5)


def test_no_turning_or_braking_car_of_the_world_is_a_centimetre_off_in_a_step():
    """Sharpest turn and hardest braking at up to 12 m/s, against the true path at 400 instants of the step."""
    rng, tick, worst = np.random.default_rng(5), 0.05, 0.0
    parts = np.linspace(0.0, 1.0, 401)
    for _ in range(300):
        speed, steer, brake = rng.uniform(1.0, 12.0), rng.uniform(-1.0, 1.0), rng.uniform()
        if speed**2 * abs(math.tan(0.52 * steer)) / 2.875 > MAX_DECELERATION:
            continue  # no car corners harder than it brakes
        true = np.array([drive(0.0, 0.0, 0.0, speed, steer, 0.0, brake, max(p, 1e-12) * tick)[:3] for p in parts])
        start, walk = rng.uniform([-3.5, -2.0], [3.5, 2.0]), tick * rng.uniform(-3.0, 3.0, 2)
        people = start + parts[:, None] * walk
        least = clearance(*true.T, *people.T).min()
        ends = np.column_stack([true, people])[[0, -1]]
        grown = contact_in_step(*ends, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS + 0.01) <= 1.0
        shrunk = contact_in_step(*ends, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS - 0.01) <= 1.0
        assert grown or least > 0.0
        assert not shrunk or least <= 0.0
        worst = max(worst, abs(least))
    assert worst > 0.1, "some are far from touching and some deep"


def test_a_path_has_the_step_of_its_first_contact():
    ahead = FRONT + np.array([2.0, 1.0, 0.25, -0.25, 1.0])
    still = np.zeros(5)
    assert contact_step(still, still, still, ahead, still) == pytest.approx(2.5)
    assert contact_step(still, still, still, ahead + 2.0, still) == math.inf
    assert contact_step([0.0], [0.0], [0.0], [1.0], [0.0]) == 0.0
    with pytest.raises(InvalidInput, match=r"ped_x: expected finite numbers, got nan at step 1"):
        contact_step(still, still, still, [9.0, math.nan, 9.0, 9.0, 9.0], still)
    with pytest.raises(InvalidInput, match=r"all of one length, got x \(5,\), y \(5,\), heading \(5,\), ped_x \(1,\)"):
        contact_step(still, still, still, [9.0], still)
