"""Motion is derived from positions: straight lines, circles, standing still, and the fit of lines."""

import numpy as np
import pytest

from vpsci_ros.extras.paper.realism.motion import fitted, motion, smoothed, with_onset

SIZE = np.array([[4.0, 2.0]])


def start(heading: float = 0.0, speed: float = 5.0, ped=(20.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    return np.array([[0.0, 0.0, heading, speed * np.cos(heading), speed * np.sin(heading), *ped]])


def test_a_line_has_its_speed_no_turn_and_the_curvttc_of_its_contact() -> None:
    t = 0.1 * np.arange(1, 31)
    vehicle = np.stack([5.0 * t, 0.0 * t], axis=1)
    pedestrian = np.stack([20.0 + 0.0 * t, 1e-3 * t], axis=1)  # stands in the way
    of = motion(with_onset(np.array([[[vehicle, pedestrian]]]), start(ped=(20.0, 0.0, 0.0, 0.0))), start(), SIZE)
    assert of.speed[0, 0, 0] == pytest.approx(np.full(30, 5.0))
    assert of.acceleration[0, 0, 0] == pytest.approx(np.zeros(29), abs=1e-9)
    assert of.turn_rate[0, 0, 0] == pytest.approx(np.zeros(30), abs=1e-9)
    assert of.clearance[0, 0] == pytest.approx(20.0 - 0.3 - 2.0 - 5.0 * t, abs=1e-2)
    assert of.curvttc[0, 0] == pytest.approx((20.0 - 0.3 - 2.0 - 5.0 * t) / 5.0, abs=1e-2)


def test_a_circle_has_its_yaw_rate() -> None:
    t, rate, radius = 0.1 * np.arange(31), 0.5, 10.0
    circle = radius * np.stack([np.sin(rate * t), 1.0 - np.cos(rate * t)], axis=1)
    walker = np.stack([20.0 + 0.0 * t, t], axis=1)
    of = motion(np.array([[[circle, walker]]]), start(), SIZE)
    assert of.turn_rate[0, 0, 0, 5:] == pytest.approx(np.full(25, rate), rel=1e-6)


def test_who_stands_keeps_its_heading_and_goes_nowhere_aside() -> None:
    shake = 1e-3 * np.random.default_rng(0).normal(size=(1, 1, 2, 30, 2))
    begin = start(heading=2.0, speed=0.0, ped=(5.0, 0.0, 0.0, 0.0))
    of = motion(with_onset(shake + np.array([[0.0, 0.0], [5.0, 0.0]])[:, None], begin), begin, SIZE)
    assert of.heading[0, 0, 0] == pytest.approx(np.full(30, 2.0))
    assert (of.aside == 0.0).all()


def test_smoothing_leaves_lines_alone_and_takes_a_shake_away() -> None:
    t = np.arange(31.0)
    line = np.stack([2.0 * t, 1.0 - t], axis=1)
    assert smoothed(line) == pytest.approx(line)
    assert np.abs(smoothed(line + (-1.0) ** t[:, None]) - line)[4:-4].max() < 0.12


def test_a_slope_that_looks_back_does_not_change_with_what_comes() -> None:
    matrix = fitted(8, 4, 0, slope=True)
    assert np.triu(matrix, 1) == pytest.approx(np.zeros((8, 8)))
    assert matrix[1:] @ (0.3 * 0.1 * np.arange(8)) == pytest.approx(np.full(7, 0.3))
