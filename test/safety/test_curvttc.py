"""CurvTTC by hand: cases whose contact time follows from a line of geometry."""

import math

import numpy as np
import pytest

from vpsci_ros.safety import curvttc

TIGHT = 1e-6  # [s]


FRONT, SIDE = 4.69 / 2 + 0.3, 0.925 + 0.3  # [m] from the car's middle to that of a pedestrian who touches it


@pytest.mark.parametrize(
    ("speed", "curvature", "walker", "contact"),
    [
        (5.0, 0.0, (20, 0, 0, 0), (20 - FRONT) / 5),  # stands in its way
        (5.0, 0.0, (20, 0, -1.5, 0), (20 - FRONT) / 6.5),  # comes towards it
        (5.0, 0.0, (12, -3, 0, 1.5), (12 - FRONT) / 5),  # crosses and is met by the front, at y = -0.19
        (5.0, 0.0, (6, -3, 0, 1.5), (3 - SIDE) / 1.5),  # walks into the side, which spans x = 3.57 .. 8.26 then
        (0.0, 0.1, (0, 4, 0, -1), 4 - SIDE),  # walks into a car that stands
    ],
)
def test_contact_times_that_follow_from_a_line_of_geometry(speed, curvature, walker, contact):
    assert curvttc(0, 0, 0, speed, curvature, *walker) == pytest.approx(contact, abs=TIGHT)


def test_arc_meets_a_standing_disc_where_its_front_edge_has_turned_to():
    # The front edge seen from the turning centre (0, 10): the line p_forward = 2.345. A disc standing at radius 10
    # and angle a along the arc touches it when 10 sin(a - turned) = 2.345 + 0.3.
    radius, angle, speed = 10.0, 1.2, 5.0
    turned = angle - math.asin((2.345 + 0.3) / radius)
    ped_x, ped_y = radius * math.sin(angle), radius - radius * math.cos(angle)
    assert curvttc(0, 0, 0, speed, 1 / radius, ped_x, ped_y, 0, 0) == pytest.approx(turned * radius / speed, abs=TIGHT)


def test_the_prediction_ends_after_90_degrees_of_the_arc():
    radius, speed = 10.0, 5.0
    beyond = math.pi / 2 + math.asin((2.345 + 0.3) / radius)  # contact exactly at 90 degrees turned
    for angle, touches in ((beyond - 0.01, True), (beyond + 0.01, False)):
        ped_x, ped_y = radius * math.sin(angle), radius - radius * math.cos(angle)
        assert math.isfinite(curvttc(0, 0, 0, speed, 1 / radius, ped_x, ped_y, 0, 0)) == touches


def test_contact_at_the_horizon_counts_and_after_it_does_not():
    contact = (20 - 4.69 / 2 - 0.3) / 5
    assert curvttc(0, 0, 0, 5, 0, 20, 0, 0, 0, horizon=contact + 1e-6) == pytest.approx(contact, abs=TIGHT)
    assert curvttc(0, 0, 0, 5, 0, 20, 0, 0, 0, horizon=contact - 1e-6) == math.inf


@pytest.mark.parametrize("where", [(0.0, 0.0), (2.0, 0.9), (2.345 + 0.29, 0.0), (2.345 + 0.2, 0.925 + 0.2)])
def test_touching_footprints_have_zero_curvttc(where):
    assert curvttc(0, 0, 0, 5, 0.1, *where, -3, 1) == 0.0


def test_center_form_starts_when_the_later_of_the_two_occupies_the_crossing_point():
    occupied = (4.69 + 1.85) / 2
    assert curvttc(0, 0, 0, 5, 0, 20, -6, 0, 1.5, method="center") == pytest.approx((20 - occupied) / 5)
    assert curvttc(0, 0, 0, 5, 0, 5, -9, 0, 1.0, method="center") == math.inf  # the vehicle is through before


def test_center_form_follows_the_arc_to_the_crossing_point():
    # a quarter circle of radius 10, northwards from the origin, crosses the line y = 10 sin(60 deg) after 10 pi / 3 m
    ped_y, crossing_x = 10 * math.sin(math.pi / 3), -5.0
    occupied = (4.69 + 1.85) / 2
    got = curvttc(0, 0, math.pi / 2, 4, 0.1, crossing_x + 3, ped_y, -1.5, 0, method="center")
    assert got == pytest.approx((10 * math.pi / 3 - occupied) / 4)


@pytest.mark.parametrize("method", ["footprint", "center"])
def test_scalars_batches_and_grids_agree(method):
    ys = np.linspace(-8, 0, 12)
    one_by_one = [float(curvttc(0, 0, 0, 5, 0.02, 12, y, 0, 1.5, method=method)) for y in ys]
    batch = curvttc(0, 0, 0, 5, 0.02, 12, ys, 0, 1.5, method=method)
    grid = curvttc(0, 0, 0, 5, 0.02, 12, ys.reshape(3, 4), 0, [[1.5]], method=method)
    assert batch.shape == (12,)
    assert grid.shape == (3, 4)
    np.testing.assert_array_equal(batch, one_by_one)
    np.testing.assert_array_equal(grid.ravel(), one_by_one)
