"""Driving along a lane: steering, and comfortable speeds.

Steering is pure pursuit: the arc that starts along the heading and meets the centreline a look-ahead away. On a
circle it has no steady error, far from the lane it never turns by more than half a turn, and it does not depend
on derivatives of the map. See 'Implementation of the pure pursuit path tracking algorithm' by Coulter, CMU-RI-TR-92-01.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import Path, point_at

LATERAL_COMFORT = 2.0  # [m/s2] sideways in the bend: what drivers turning right at an intersection accept
COMFORT_ACCELERATION = 2.0  # [m/s2]
COMFORT_DECELERATION = 2.5  # [m/s2]
SPEED_TIME = 0.5  # [s] in which the speed goes to the wanted one
LOOK_AHEAD = 2.0  # [m] at rest
LOOK_AHEAD_TIME = 0.3  # [s] of driving, added to it


def comfortable_speeds(
    path: Path, lateral: float = LATERAL_COMFORT, deceleration: float = COMFORT_DECELERATION
) -> NDArray[np.float64]:
    """Return the greatest comfortable speed [m/s] at each sample of a lane, float64[N].

    It is slow enough for the bend, by the `lateral` acceleration, and for the `deceleration` into the next one [m/s2].
    """
    speeds = np.sqrt(lateral / np.maximum(np.abs(path.curvature()), 1e-3))
    for i in range(len(speeds) - 2, -1, -1):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2.0 * deceleration * path.step))
    return speeds


@kernel
def look_ahead(s: float, speed: float) -> float:
    """Return the arc length [m] of the point that a driver at `s` [m] steers to."""
    return s + LOOK_AHEAD + LOOK_AHEAD_TIME * speed


@kernel
def pursuit_curvature(points, row, count, step, s, aside, x, y, heading, speed):  # type: ignore[no-untyped-def]
    """Curvature [1/m] of the arc to the point `aside` [m] left of lane `row`, a look-ahead beyond arc length `s`.

    1 or -1 where that point lies behind the vehicle.
    """
    target_x, target_y = point_at(points, row, count, step, look_ahead(s, speed))
    if aside != 0.0:
        next_x, next_y = point_at(points, row, count, step, look_ahead(s, speed) + step)
        target_x, target_y = (
            target_x - aside * (next_y - target_y) / step,
            target_y + aside * (next_x - target_x) / step,
        )
    forward, left = to_heading_frame(heading, target_x - x, target_y - y)
    square = forward * forward + left * left
    if forward <= 0.0:  # the lane lies behind: turn about as tightly as possible
        return 1.0 if left >= 0.0 else -1.0
    return 2.0 * left / square


@kernel
def speed_acceleration(speed: float, wanted: float) -> float:
    """Comfortable acceleration [m/s2] along the heading from `speed` to the `wanted` speed [m/s]."""
    return min(COMFORT_ACCELERATION, max(-COMFORT_DECELERATION, (wanted - speed) / SPEED_TIME))
