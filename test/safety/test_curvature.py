"""Curvature of recorded paths."""

import numpy as np
import pytest

from vpsci_ros.safety import curvature_from_positions, curvature_from_yaw_rate


@pytest.mark.parametrize("radius", [3.0, 10.0, 80.0])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_positions_on_a_circle_have_its_curvature_positive_to_the_left(radius, turn):
    angle = np.cumsum(np.array([0.0, 0.5, 0.3, 0.7, 0.5, 0.4])) / radius  # half a metre a step, unevenly
    curvature = curvature_from_positions(7 + radius * np.sin(angle), turn * radius * (1 - np.cos(angle)))
    np.testing.assert_allclose(curvature[2:], turn / radius, rtol=1e-6)
    np.testing.assert_array_equal(curvature[:2], 0.0)


def test_the_last_three_positions_are_used_and_none_of_the_future():
    x, y = np.array([0.0, 1.0, 2.0, 3.0, 3.9]), np.array([0.0, 0.0, 0.0, 0.0, 0.4])
    curvature = curvature_from_positions(x, y)
    np.testing.assert_array_equal(curvature[:4], 0.0)
    assert curvature[4] > 0.3


def test_a_standing_vehicle_has_a_straight_path():
    assert not curvature_from_positions(np.full(5, 2.0), np.full(5, 1.0)).any()
    assert curvature_from_yaw_rate(0.5, 0.0) == 0.0
    np.testing.assert_array_equal(curvature_from_yaw_rate([0.5, 0.5], [0.05, 0.2]), [0.0, 2.5])
