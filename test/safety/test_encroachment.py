"""PET of straight and curved paths whose times at the crossing point are known."""

import math

import numpy as np
import pytest

from vpsci_ros.safety import post_encroachment_time

DT = 0.1
TIME = np.arange(0, 100) * DT


def crossing(vehicle_speed=5.0, walking_speed=1.5, walker_start=-6.0, vehicle_start=-20.0):
    """A vehicle along x and a pedestrian along y; the paths cross at the origin."""
    x, ped_y = vehicle_start + vehicle_speed * TIME, walker_start + walking_speed * TIME
    return x, np.zeros(100), np.zeros(100), np.zeros(100), ped_y


def test_the_vehicle_first_then_the_pedestrian():
    pet, arrival = post_encroachment_time(*crossing(walker_start=-12.0), dt=DT)
    left, reached = (20 + 2.345) / 5, (12 - 0.3) / 1.5
    assert pet == pytest.approx(reached - left, abs=1e-6)
    assert arrival == pytest.approx(reached, abs=1e-6)


def test_the_pedestrian_first_then_the_vehicle():
    pet, arrival = post_encroachment_time(*crossing(walker_start=-2.0), dt=DT)
    assert pet == pytest.approx((20 - 2.345) / 5 - (2 + 0.3) / 1.5, abs=1e-6)
    assert arrival == pytest.approx((20 - 2.345) / 5, abs=1e-6)


def test_pet_is_negative_when_both_were_there_at_once():
    pet, _ = post_encroachment_time(*crossing(walker_start=-6.2), dt=DT)
    assert pet < 0.0


def test_pet_is_undefined_when_the_pedestrian_stops_before_the_path_however_near():
    x, y, heading, ped_x, ped_y = crossing(walker_start=-6.0)
    stopped = np.minimum(ped_y, -1.3)
    pet, arrival = post_encroachment_time(x, y, heading, ped_x, stopped, dt=DT)
    assert math.isnan(pet)
    assert math.isnan(arrival)


def test_a_batch_is_its_episodes_one_by_one():
    episodes = [crossing(walker_start=-12.0), crossing(walker_start=-2.0)]
    pets, arrivals = post_encroachment_time(*np.stack(episodes, axis=1), dt=DT)
    for row, episode in enumerate(episodes):
        assert (pets[row], arrivals[row]) == post_encroachment_time(*episode, dt=DT)
