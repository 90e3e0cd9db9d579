"""The distance between rectangle and disc, by hand."""

import math

import pytest

from vpsci_ros.safety import clearance, clearance_pair


@pytest.mark.parametrize(
    ("ped_x", "ped_y", "expected"),
    [
        (5.0, 0.0, 5.0 - 2.345 - 0.3),  # ahead
        (-5.0, 0.5, 5.0 - 2.345 - 0.3),  # behind
        (1.0, 3.0, 3.0 - 0.925 - 0.3),  # beside
        (2.345 + 3.0, 0.925 + 4.0, 5.0 - 0.3),  # off a corner
        (2.345 + 0.3, 0.0, 0.0),  # touching
        (0.0, 0.0, -0.925 - 0.3),  # in the middle: 0.925 below the nearest side, and the disc 0.3 deeper
    ],
)
def test_clearance_is_the_distance_between_the_outlines(ped_x, ped_y, expected):
    assert clearance(0, 0, 0, ped_x, ped_y) == pytest.approx(expected, abs=1e-12)


def test_clearance_turns_with_the_vehicle():
    assert clearance(3, 4, math.pi / 2, 3, 9) == pytest.approx(5.0 - 2.345 - 0.3)
    assert clearance_pair(3.0, 4.0, math.pi / 2, 3.0, 9.0, 4.69, 1.85, 0.3) == clearance(3, 4, math.pi / 2, 3, 9)
