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


def test_nearly_collinear_positions_are_a_line():
    x, bend = np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.01, 0.0])
    assert curvature_from_positions(x, bend)[2] == pytest.approx(-1.0 / 12.505, rel=1e-6)
    assert curvature_from_positions(x, bend, collinear=0.02)[2] == 0.0


def test_a_standing_vehicle_has_a_straight_path():
    assert not curvature_from_positions(np.full(5, 2.0), np.full(5, 1.0)).any()
    assert curvature_from_yaw_rate(0.5, 0.0) == 0.0
    np.testing.assert_array_equal(curvature_from_yaw_rate([0.5, 0.5], [0.05, 0.2]), [0.0, 2.5])


def test_positions_further_apart_see_through_noise():
    rng = np.random.default_rng(3)
    angle = np.arange(60) * 0.4 / 12.0  # 4 m/s on a circle of 12 m, 0.1 s a step
    x, y = 12 * np.sin(angle) + rng.normal(0, 0.01, 60), 12 * (1 - np.cos(angle)) + rng.normal(0, 0.01, 60)
    error = {spacing: np.abs(curvature_from_positions(x, y, spacing=spacing)[10:] - 1 / 12) for spacing in (1, 5)}
    assert error[5].max() < 0.02 < error[1].max()


def test_batches_of_trajectories_are_trajectories_one_by_one():
    rng = np.random.default_rng(4)
    x, y = np.cumsum(rng.random((2, 3, 4, 9)), axis=-1)
    whole = curvature_from_positions(x, y, spacing=2)
    assert whole.shape == (3, 4, 9)
    np.testing.assert_array_equal(whole[1, 2], curvature_from_positions(x[1, 2], y[1, 2], spacing=2))
    assert not curvature_from_positions(x[..., :3], y[..., :3], spacing=2).any()  # fewer than three positions


def test_yaw_rate_over_speed_is_the_curvature_of_the_circle():
    np.testing.assert_allclose(curvature_from_yaw_rate([0.5, -0.5], 5.0), [0.1, -0.1])
