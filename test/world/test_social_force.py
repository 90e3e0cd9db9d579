"""How pedestrians push each other: alike, the more the nearer, and to the side where they would meet."""

import math

import numpy as np
import pytest

from vpsci_ros.world.drivers.social_force import AMONG_RANGE, POTENTIAL, keep_apart, repulsion
from vpsci_ros.world.state import EPISODE


def test_pushes_are_equal_and_opposite():
    state = np.zeros(5, EPISODE)
    draws = np.random.default_rng(1).normal(size=(4, 5))
    state["pedestrian_x"], state["pedestrian_y"], state["pedestrian_vx"], state["pedestrian_vy"] = draws
    pushes = np.zeros((5, 2))
    keep_apart(state, 0, 5, pushes)
    assert np.abs(pushes).min() > 0.0
    assert pushes.sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_two_who_stand_are_pushed_apart_by_the_gradient_of_the_potential():
    ax, ay = repulsion(1.0, 0.0, 0.0, 0.0)
    step = 1e-6
    potential = [POTENTIAL * math.exp(-(1.0 + d) / AMONG_RANGE) for d in (-step, step)]
    assert ax == pytest.approx((potential[0] - potential[1]) / (2.0 * step), rel=1e-6)
    assert ay == 0.0


def test_bodies_that_touch_are_pressed_apart_more_firmly_than_anybody_walks():
    assert repulsion(0.4, 0.0, 0.0, 0.0)[0] > 2.5 + 5.0


def test_two_who_would_meet_are_pushed_to_the_side_and_those_who_part_are_left_alone():
    ax, ay = repulsion(1.2, 0.2, -2.6, 0.0)
    assert ay > 3.0
    assert abs(ax) < 0.1 * ay
    assert math.hypot(*repulsion(1.2, 0.2, 2.6, 0.0)) < 0.15
