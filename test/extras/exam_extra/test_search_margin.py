"""Margins on places that are worked out by hand: the car is 4.69 m by 1.85 m, the pedestrian's radius 0.3 m."""

import numpy as np
import pytest

from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.extras.exam_extra.search.margin import least_margin


def episode(*ahead: list[float], speed: float = 3.0, curvttc: float = np.inf, outcome: str = "goal") -> Episode:
    """Return an episode of a car at the origin and pedestrians so far ahead of it, a list of T each."""
    x = np.array(ahead)
    still, walks = np.zeros(x.shape[1]), np.zeros(x.shape)
    listed = Listed("1:0", "A", 1, 0, outcome, curvttc)
    vehicle = still, still, still, still + speed, still
    walk = x, walks, walks, walks, walks + curvttc, x
    return Episode("test", listed, None, 0.05, *vehicle, *walk, x < 0.0, x > 0.0)


def test_the_margin_of_a_contact_is_the_clearance_between_the_footprints():
    assert least_margin("collision", episode([4.645])) == pytest.approx(4.645 - 2.345 - 0.3)


@pytest.mark.parametrize("failure", ["collision", "moving_collision"])
def test_a_contact_between_two_ticks_has_no_positive_margin(failure):
    assert least_margin(failure, episode([4.645], outcome="collision")) == 0.0


@pytest.mark.parametrize(("speed", "more"), [(0.6, 0.0), (0.5, 1.0), (0.0, 1.0)])
def test_who_walks_into_a_standing_car_is_a_metre_further_from_being_hit(speed, more):
    assert least_margin("moving_collision", episode([2.645], speed=speed)) == pytest.approx(more, abs=1e-9)


@pytest.mark.parametrize(("failure", "expected"), [("conflict", 1.0), ("severe_conflict", 2.0)])
def test_the_margin_of_a_conflict_is_curvttc_less_its_threshold(failure, expected):
    assert least_margin(failure, episode([9.0], curvttc=3.0)) == pytest.approx(expected)
    assert least_margin(failure, episode([9.0])) == pytest.approx(7.0 + expected)


def test_an_episode_has_the_least_margin_of_its_frames_and_of_its_pedestrians():
    assert least_margin("collision", episode([5.645, 3.645, 7.0], [9.0, 6.645, 8.0])) == pytest.approx(1.0)
