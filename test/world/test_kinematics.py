"""Equations (8), (9) and (18)-(24) by hand, and what a car and a person can do."""

import math

import pytest

from vpsci_ros.world.kinematics import (
    MAX_DECELERATION,
    MAX_STEERING_ANGLE,
    WHEELBASE,
    brake_for,
    drive,
    next_velocity,
    steer_for,
    throttle_for,
    walk,
)

TICK = 0.05


def test_equations_8_and_9_by_hand():
    assert next_velocity(3.0, -2.0, 0.1) == pytest.approx(2.8)


def test_equation_18_by_hand():
    # a = 1.5, v = 5: arctan(2.875 * 1.5 / 25) = arctan(0.1725) = 0.1708193, over 0.52 rad
    assert steer_for(1.5, 5.0) == pytest.approx(0.170819 / 0.52, rel=1e-4)
    assert steer_for(-1.5, 5.0) == -steer_for(1.5, 5.0)


def test_equation_18_saturates_at_the_steering_lock():
    # at a crawl the arctangent tends to pi / 2, three times the lock
    assert steer_for(1.0, 0.0) == 1.0
    assert steer_for(-1.0, 0.1) == -1.0
    assert steer_for(0.0, 0.0) == 0.0


def test_equations_19_and_20_by_hand():
    assert throttle_for(1.85) == pytest.approx(0.2)  # 1.85 / 9.25
    assert throttle_for(20.0) == 1.0
    assert throttle_for(-1.0) == 0.0
    assert brake_for(-2.22) == pytest.approx(0.25)  # 2.22 / 8.88
    assert brake_for(-20.0) == 1.0
    assert brake_for(0.0) == brake_for(3.0) == 0.0


def test_equations_21_to_24_by_hand():
    # v' = 1 + 0.5 * 2 * 0.05 = 1.05 and 0.5 * -1 * 0.05 = -0.025; p' = p + v' * 0.05
    assert walk(10.0, 20.0, 1.0, 0.0, 2.0, -1.0, 0.5, 5.0, TICK) == pytest.approx((10.0525, 19.99875, 1.05, -0.025))


def test_braking_distance_at_full_brake_is_speed_squared_over_twice_the_deceleration():
    x, speed = 0.0, 8.0
    for _ in range(100):
        x, _, _, speed, _ = drive(x, 0.0, 0.0, speed, 0.0, 0.0, 1.0, TICK)
    assert speed == 0.0
    assert x == pytest.approx(8.0**2 / (2 * MAX_DECELERATION), rel=1e-12)


def test_a_vehicle_never_reverses_by_braking():
    state = (3.0, 4.0, 1.0, 0.01)
    for _ in range(10):
        *state, distance = drive(*state, 0.5, 0.0, 1.0, TICK)
        assert state[3] >= 0.0
        assert distance >= 0.0
    assert state[3] == 0.0
    x, y, heading, _, _ = drive(*state, 1.0, 0.0, 1.0, TICK)
    assert (x, y, heading) == tuple(state[:3])  # and does not turn on the spot


def test_turning_circle_at_full_steer_is_that_of_wheelbase_and_lock():
    radius = WHEELBASE / math.tan(MAX_STEERING_ANGLE)
    assert radius == pytest.approx(5.021, abs=1e-3)
    x = y = heading = 0.0
    for _ in range(1000):
        x, y, heading, _, _ = drive(x, y, heading, 2.0, 1.0, 0.0, 0.0, TICK)
        assert math.hypot(x, y - radius) == pytest.approx(radius, rel=1e-9)  # to the left: the centre is on the left
    assert heading == pytest.approx(1000 * TICK * 2.0 / radius)


def test_the_arc_does_not_depend_on_how_finely_time_is_cut():
    coarse = drive(0.0, 0.0, 0.3, 6.0, -0.4, 0.2, 0.0, 1.0)[:4]
    fine = (0.0, 0.0, 0.3, 6.0)
    for _ in range(100):
        fine = drive(*fine, -0.4, 0.2, 0.0, 0.01)[:4]
    assert coarse == pytest.approx(fine, rel=1e-9)


def test_a_pedestrians_speed_stays_human_whatever_the_acceleration():
    state = (0.0, 0.0, 4.0, 0.0)
    for _ in range(100):
        state = walk(*state, 50.0, 30.0, 0.5, 5.0, TICK)
        assert math.hypot(*state[2:]) <= 5.0 + 1e-12
