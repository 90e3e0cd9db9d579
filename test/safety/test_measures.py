"""The measures beside CurvTTC, each against numbers worked out by hand."""

import math

import pytest

from vpsci_ros.safety import closest_encounter, curvttc, drac, second_order_ttc, ttc_2d


def test_ttc_2d_is_curvttc_on_a_straight_path_and_misses_what_the_turn_leads_to():
    walker = (8.0, 8.0, 0.0, 0.0)  # stands in the middle of a left turn of 8 m radius
    assert ttc_2d(0, 0, 0, 4, *walker) == math.inf
    assert curvttc(0, 0, 0, 4, 1 / 8, *walker) < 4.0
    assert ttc_2d(0, 0, 0, 5, 20, 0, 0, 0) == pytest.approx((20 - 2.345 - 0.3) / 5)


def test_an_accelerating_vehicle_arrives_when_its_distance_is_covered():
    gap = 20 - 2.345 - 0.3  # = 2 t + t^2
    assert second_order_ttc(0, 0, 0, 2, 2.0, 0, 20, 0, 0, 0) == pytest.approx(math.sqrt(1 + gap) - 1)
    assert second_order_ttc(0, 0, 0, 0, 2.0, 0, 20, 0, 0, 0) == pytest.approx(math.sqrt(gap))


def test_a_vehicle_that_can_stop_in_time_has_no_contact_and_one_that_cannot_has():
    gap = 20 - 2.345 - 0.3
    enough = 8.0**2 / (2 * gap)
    assert second_order_ttc(0, 0, 0, 8, -enough - 1e-3, 0, 20, 0, 0, 0) == math.inf
    assert math.isfinite(second_order_ttc(0, 0, 0, 8, -enough + 1e-3, 0, 20, 0, 0, 0))


def test_a_pedestrian_walks_into_the_vehicle_that_has_stopped():
    # it stops at x = 4; the pedestrian comes down x = 4 from y = 6 and meets its side at y = 0.925 + 0.3
    assert second_order_ttc(0, 0, 0, 4, -2.0, 0, 4, 6, 0, -1.0) == pytest.approx(6 - 0.925 - 0.3)


def test_drac_is_the_deceleration_that_stops_the_vehicle_at_the_predicted_contact():
    ttc = curvttc(0, 0, 0, 8, 0, 20, 0, 0, 0)
    needed = float(drac(ttc, 8.0))
    assert needed == pytest.approx(8.0**2 / (2 * (20 - 2.345 - 0.3)))
    assert second_order_ttc(0, 0, 0, 8, -needed * 1.001, 0, 20, 0, 0, 0) == math.inf


def test_closest_encounter_by_hand():
    # the other comes from (10, 3) at (-2, 0): nearest after 5 s, 3 m away
    ttce, dce = closest_encounter(0, 0, 0, 0, 10, 3, -2, 0)
    assert (ttce, dce) == (pytest.approx(5.0), pytest.approx(3.0))
