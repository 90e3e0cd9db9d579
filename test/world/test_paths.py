"""Lines to follow: sampled evenly, curved as the points mean, searched locally."""

import math

import numpy as np
import pytest

from vpsci_ros.world.paths import resample


def arc(radius, step, angle=math.pi / 2):
    s = np.append(np.arange(0, radius * angle, step), radius * angle)
    return np.stack([radius * np.sin(s / radius), radius * (1 - np.cos(s / radius))], axis=1)


def test_points_two_metres_apart_describe_a_turn_to_a_centimetre():
    path = resample(arc(13.0, 2.0))
    assert np.abs(np.hypot(path.points[:, 0], path.points[:, 1] - 13.0) - 13.0).max() < 0.01
    assert path.length == pytest.approx(13.0 * math.pi / 2, rel=1e-3)
    assert np.median(path.curvature()) == pytest.approx(1 / 13.0, rel=0.02)


def test_a_long_straight_beside_a_curve_is_not_bulged_by_it():
    straight_then_arc = np.concatenate([[[-30.0, 0.0]], arc(13.0, 2.0)])
    path = resample(straight_then_arc)
    straight = path.points[path.points[:, 0] < -3.0]
    assert np.abs(straight[:, 1]).max() < 0.01


def test_a_point_is_located_by_arc_length_and_distance_to_the_left():
    path = resample(np.array([[0.0, 0.0], [10.0, 0.0]]))
    assert path.locate(4.0, 1.5) == pytest.approx((4.0, 1.5))
    assert path.locate(4.0, -1.5) == pytest.approx((4.0, -1.5))


def test_location_undoes_the_point_at_an_arc_length():
    path = resample(arc(9.0, 1.5))
    for s in np.linspace(0.0, path.length, 23):
        found, left = path.locate(*path.at(s))
        assert found == pytest.approx(s, abs=1e-6)
        assert left == pytest.approx(0.0, abs=1e-6)
