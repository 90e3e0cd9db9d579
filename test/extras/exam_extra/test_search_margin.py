"""Margins on places that are worked out by hand: the car is 4.69 m by 1.85 m, the pedestrian's radius 0.3 m."""

import numpy as np
import pytest

from vpsci_ros.extras.exam_extra.search.margin import LeastMargins, margin
from vpsci_ros.world import ENDED, IDLE, RUNNING
from vpsci_ros.world.state import EPISODE


def tick(ahead, speed=3.0, status=RUNNING, frame=1, episodes=(0,)):
    state = np.zeros(len(episodes), EPISODE)
    state["pedestrian_x"], state["vehicle_speed"], state["status"], state["frame"] = ahead, speed, status, frame
    state["scenario"], state["episode"] = 1, episodes
    return state


def test_the_margin_of_a_contact_is_the_clearance_between_the_footprints():
    assert margin("collision", tick(4.645), np.array([np.inf])) == pytest.approx(4.645 - 2.345 - 0.3)


def test_a_contact_between_two_ticks_has_no_positive_margin():
    struck = tick(4.645)
    struck["struck"] = 1
    assert margin("collision", struck, np.array([np.inf])) == 0.0
    assert margin("moving_collision", struck, np.array([np.inf])) == 0.0


@pytest.mark.parametrize(("speed", "more"), [(0.6, 0.0), (0.5, 1.0), (0.0, 1.0)])
def test_who_walks_into_a_standing_car_is_a_metre_further_from_being_hit(speed, more):
    found = margin("moving_collision", tick(2.645, speed), np.array([np.inf]))
    assert found == pytest.approx(more, abs=1e-9)


@pytest.mark.parametrize(("failure", "expected"), [("conflict", 1.0), ("severe_conflict", 2.0)])
def test_the_margin_of_a_conflict_is_curvttc_less_its_threshold(failure, expected):
    assert margin(failure, tick(9.0), np.array([3.0])) == pytest.approx(expected)
    assert margin(failure, tick(9.0), np.array([np.inf])) == pytest.approx(7.0 + expected)


def test_an_episode_has_the_least_margin_of_its_ticks_and_of_its_pedestrians_once_it_has_ended():
    least = LeastMargins("collision")
    far = np.array([np.inf, np.inf])
    for ahead, status, frame in (((5.645, 9.0), RUNNING, 0), ((3.645, 6.645), RUNNING, 1), ((7.0, 8.0), ENDED, 2)):
        assert least.found == {}
        least.add(tick(ahead, status=status, frame=frame, episodes=(4, 4)), far)
    assert least.found == {(1, 4): pytest.approx(1.0)}
    least.add(tick((2.0, 2.0), status=IDLE, episodes=(5, 5)), far)
    least.add(tick((8.645, 9.0), status=ENDED, frame=0, episodes=(6, 6)), far)
    assert least.found[1, 6] == pytest.approx(6.0)
