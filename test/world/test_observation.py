"""Equations (6) and (7): the vehicle's heading frame, seen from both agents."""

import math

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import EPISODE, observe, observe_arrays
from vpsci_ros.world.observation import arrays_to_heading_frame, from_heading_frame, to_heading_frame


def record(**values):
    state = np.zeros(1, EPISODE)
    for name, value in values.items():
        state[name] = value
    return state


def test_numbers_by_hand_for_a_vehicle_driving_north():
    # Vehicle at (2, 1) driving north at 4; pedestrian at (5, 7) walking west at 1.5.
    # North is forward, west is left: d_vp = (2 - 5, 1 - 7) = (-3 east, -6 north) -> forward -6, left +3.
    # Pedestrian velocity (-1.5, 0) -> forward 0, left 1.5; v_veh - v_ped = (4, -1.5).
    vehicle, pedestrian = observe(
        record(
            vehicle_x=2,
            vehicle_y=1,
            vehicle_heading=math.pi / 2,
            vehicle_speed=4,
            pedestrian_x=5,
            pedestrian_y=7,
            pedestrian_vx=-1.5,
        )
    )
    assert vehicle[0] == pytest.approx([4, 0, -6, 3, 4, -1.5], abs=1e-6)
    assert pedestrian[0] == pytest.approx([0, 1.5, 6, -3, -4, 1.5], abs=1e-6)


def test_a_rows_bits_do_not_depend_on_its_place_or_its_neighbours():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(9, 65)) * 30
    vehicle, pedestrian = observe_arrays(*columns)
    for i in (0, 1, 31, 64):
        own_vehicle, own_pedestrian = observe_arrays(*columns[:, i])
        assert own_vehicle.tobytes() == vehicle[i].tobytes()
        assert own_pedestrian.tobytes() == pedestrian[i].tobytes()


def test_the_compiled_turn_into_the_heading_frame_and_that_of_arrays_agree():
    assert to_heading_frame(0.5 * math.pi, 3.0, 4.0) == pytest.approx((4.0, -3.0))  # north is ahead, east to the right
    rng = np.random.default_rng(4)
    headings, vectors = rng.uniform(-4.0, 4.0, (50, 3)), rng.normal(0.0, 9.0, (50, 3, 2))
    arrays = arrays_to_heading_frame(headings, vectors)
    for place in np.ndindex(headings.shape):
        compiled = to_heading_frame(headings[place], *vectors[place])
        np.testing.assert_allclose(arrays[place], compiled, rtol=0.0, atol=1e-14)
        assert from_heading_frame(headings[place], *compiled) == pytest.approx(tuple(vectors[place]), abs=1e-13)


def test_arrays_of_different_shapes_are_refused():
    with pytest.raises(InvalidInput, match="one shape for all nine"):
        observe_arrays(*np.zeros((8, 3)), np.zeros(4))
