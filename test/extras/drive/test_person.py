"""What pressed keys do to wheel and pedals."""

import math

import pytest

from vpsci_ros.extras.drive.drive_page import Pressed, _pressed
from vpsci_ros.extras.drive.person import held
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_STEERING_ANGLE, WHEELBASE

LEFT, NOTHING = Pressed(steer=1.0), Pressed()


def after(ticks: int, pressed: Pressed, speed: float, before: Pressed = NOTHING) -> Pressed:
    for _ in range(ticks):
        before = held(before, pressed, speed, 0.05)
    return before


def test_the_wheel_takes_half_a_second_to_its_end_and_back() -> None:
    assert [after(n, LEFT, 1.0).steer for n in (1, 5, 10, 20)] == pytest.approx([0.1, 0.5, 1.0, 1.0])
    assert after(9, NOTHING, 1.0, after(10, LEFT, 1.0)).steer == pytest.approx(0.1)
    assert after(3, Pressed(steer=-1.0), 1.0).steer == pytest.approx(-0.3)


def test_a_pressed_key_turns_as_far_as_four_metres_per_second_squared_sideways() -> None:
    """At 10 m/s that is a radius of 25 m, so a wheel angle of atan(2.875 / 25) = 0.1145 rad of 0.52."""
    steer = after(40, LEFT, 10.0).steer
    assert steer == pytest.approx(0.1145 / 0.52, abs=1e-4)
    assert 10.0**2 * math.tan(steer * MAX_STEERING_ANGLE) / WHEELBASE == pytest.approx(4.0, abs=1e-3)


def test_pedals_come_to_three_and_eight_metres_per_second_squared_and_a_foot_off_the_pedal_gives_nothing() -> None:
    assert after(20, Pressed(throttle=1.0), 5.0).throttle * MAX_ACCELERATION == pytest.approx(3.0)
    assert after(20, Pressed(brake=1.0), 5.0).brake * 8.88 == pytest.approx(8.0)
    assert after(1, Pressed(brake=1.0), 5.0).brake == pytest.approx(0.2), "in five ticks to the floor"
    assert after(20, NOTHING, 5.0, Pressed(0.3, 0.2, 0.9)) == NOTHING


@pytest.mark.parametrize("values", [None, [], [0.0, 1.0], ["1", 0, 0], [float("nan"), 0, 0], {"steer": 1}])
def test_what_is_no_reading_of_keys_changes_nothing(values: object) -> None:
    assert _pressed(values) is None
    assert _pressed([-7, 2, -1]) == Pressed(-1.0, 1.0, 0.0)
    assert _pressed([10**400, 0, 0]) == Pressed(1.0, 0.0, 0.0)
