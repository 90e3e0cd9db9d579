"""What must hold of CurvTTC whatever the numbers: symmetries, monotony, and the passing of time."""

import numpy as np
import pytest

from vpsci_ros.safety import curvttc

PAIRS = 10_000
CLOSE = 1e-6  # [s]


@pytest.fixture(scope="module")
def pairs():
    """The nine state arguments of `curvttc`, float64[9, PAIRS], of which about half touch within the horizon."""
    rng = np.random.default_rng(11)
    speed = rng.uniform(0.0, 10.0, PAIRS) * (rng.random(PAIRS) < 0.9)
    curvature = rng.uniform(-0.2, 0.2, PAIRS) * (rng.random(PAIRS) < 0.8)
    heading = rng.uniform(-np.pi, np.pi, PAIRS)
    walk = rng.normal(0.0, 1.3, (2, PAIRS)) * (rng.random(PAIRS) < 0.9)
    state = np.stack([np.zeros(PAIRS), np.zeros(PAIRS), heading, speed, curvature, *np.zeros((2, PAIRS)), *walk])
    meeting = rng.uniform(0.0, 8.0, PAIRS)  # the pedestrian comes near the vehicle's path at about that time
    ahead = moved_on(state, meeting)
    state[5:7] = np.stack(ahead[:2]) - walk * meeting * rng.uniform(0.7, 1.3, PAIRS) + rng.normal(0.0, 2.5, (2, PAIRS))
    assert 0.3 < np.isfinite(curvttc(*state)).mean() < 0.7
    return state


@pytest.mark.parametrize("method", ["footprint", "center"])
def test_turning_and_moving_the_whole_scene_changes_nothing(pairs, method):
    x, y, heading, speed, curvature, ped_x, ped_y, ped_vx, ped_vy = pairs
    angle, (east, north) = 2.1, (450.0, -1200.0)
    cos, sin = np.cos(angle), np.sin(angle)
    moved = (
        *(east + cos * x - sin * y, north + sin * x + cos * y, heading + angle, speed, curvature),
        *(east + cos * ped_x - sin * ped_y, north + sin * ped_x + cos * ped_y),
        *(cos * ped_vx - sin * ped_vy, sin * ped_vx + cos * ped_vy),
    )
    np.testing.assert_allclose(curvttc(*moved, method=method), curvttc(*pairs, method=method), atol=CLOSE, rtol=0)


def test_the_order_and_size_of_the_batch_change_no_bit(pairs):
    ttc = curvttc(*pairs)
    backwards = curvttc(*pairs[:, ::-1])[::-1]
    np.testing.assert_array_equal(backwards, ttc)
    np.testing.assert_array_equal(curvttc(*pairs[:, 777:1040]), ttc[777:1040])
    threaded = curvttc(*np.tile(pairs, 4))  # large enough to be shared between threads
    np.testing.assert_array_equal(threaded.reshape(4, -1), np.tile(ttc, (4, 1)))


def moved_on(state, dt):
    """The pairs `dt` later, both having moved as predicted."""
    x, y, heading, speed, curvature, ped_x, ped_y, ped_vx, ped_vy = state
    half = 0.5 * speed * curvature * dt
    chord = speed * dt * np.sinc(half / np.pi)
    x, y = x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)
    return x, y, heading + 2.0 * half, speed, curvature, ped_x + ped_vx * dt, ped_y + ped_vy * dt, ped_vx, ped_vy
