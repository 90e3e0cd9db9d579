"""Bad input: a ValueError that names the argument, the index and the value, and never a silent infinity."""

import math

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import (
    clearance,
    closest_encounter,
    curvature_from_positions,
    curvature_from_yaw_rate,
    curvttc,
    drac,
    onset,
    post_encroachment_time,
    second_order_ttc,
    who_yielded,
)

STATE = {"x": 0.0, "y": 0.0, "heading": 0.0, "speed": 5.0, "curvature": 0.0}
STATE |= {"ped_x": 20.0, "ped_y": 0.0, "ped_vx": 0.0, "ped_vy": 0.0}
SIZES = ("length", "width", "radius", "horizon")


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
@pytest.mark.parametrize("name", [*STATE, *SIZES])
def test_curvttc_names_a_value_that_is_not_finite(name, bad):
    values = np.full(5, STATE.get(name, 1.0))
    values[3] = bad
    with pytest.raises(InvalidInput, match=rf"^{name}\[3\] = {bad}: expected a finite number$"):
        curvttc(**(STATE | {name: values}))


@pytest.mark.parametrize(("name", "bad"), [*((size, bad) for size in SIZES for bad in (0.0, -1.0)), ("speed", -0.01)])
def test_curvttc_names_a_size_that_is_not_positive_and_a_negative_speed(name, bad):
    with pytest.raises(ValueError, match=rf"^{name} = {bad}: expected a number (above|not below) 0$"):
        curvttc(**(STATE | {name: bad}))


def test_shapes_that_do_not_broadcast_are_named():
    with pytest.raises(ValueError, match=r"shapes do not broadcast: x \(3,\), ped_x \(4,\)"):
        curvttc(**(STATE | {"x": np.zeros(3), "ped_x": np.zeros(4)}))


@pytest.mark.parametrize("value", ["5", None, 1j, [[1.0], [1.0, 2.0]]])
def test_what_is_not_a_number_is_refused(value):
    with pytest.raises(InvalidInput, match=r"^speed: expected"):
        curvttc(**(STATE | {"speed": value}))


def test_every_function_of_the_room_refuses_nan():
    nan, row = math.nan, np.zeros(4)
    spoilt = np.array([0.0, nan, 0.0, 0.0])
    calls = [
        (r"^heading = nan", lambda: clearance(0, 0, nan, 1, 0)),
        (r"^radius = 0.0", lambda: clearance(0, 0, 0, 1, 0, radius=0.0)),
        (r"^x\[1\] = nan", lambda: curvature_from_positions(spoilt, row)),
        (r"^yaw_rate = nan", lambda: curvature_from_yaw_rate(nan, 1.0)),
        (r"^speed = -1.0", lambda: curvature_from_yaw_rate(0.1, -1.0)),
        (r"^ttc = nan", lambda: drac(nan, 1.0)),
        (r"^ttc = -1.0", lambda: drac(-1.0, 1.0)),
        (r"^speed = inf", lambda: drac(1.0, math.inf)),
        (r"^ped_vy = nan", lambda: closest_encounter(0, 0, 0, 0, 1, 1, 0, nan)),
        (r"^acceleration = nan", lambda: second_order_ttc(0, 0, 0, 1, nan, 0, 5, 0, 0, 0)),
        (r"^curvttc\[1\] = nan", lambda: onset(spoilt)),
        (r"^ped_x\[1\] = nan", lambda: post_encroachment_time(row, row, row, spoilt, row, dt=0.1)),
        (r"^dt = 0.0", lambda: post_encroachment_time(row, row, row, row, row, dt=0.0)),
        (r"^speed\[1\] = -1.0", lambda: who_yielded(row, row, row, [0, -1.0, 0, 0], *[row] * 5, dt=0.1)),
        (r"one shape", lambda: who_yielded(row, row, row, row[:3], *[row] * 5, dt=0.1)),
        (r"at least one step", lambda: onset(1.0)),
        (r"^lengths\[0\] = 5", lambda: who_yielded(*[row[None]] * 9, dt=0.1, lengths=[5])),
        (r"^lengths\[0\] = 0", lambda: who_yielded(*[row[None]] * 9, dt=0.1, lengths=[0])),
        (r"^lengths: expected", lambda: who_yielded(*[row[None]] * 9, dt=0.1, lengths=[1.5])),
    ]
    for message, call in calls:
        with pytest.raises(InvalidInput, match=message):
            call()
