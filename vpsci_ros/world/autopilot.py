"""The rule-based pair: a vehicle that keeps its lane and brakes at a fixed distance, a pedestrian that just walks.

It drives until an episode is critical, and whole episodes as the baseline of sections 4.5 and 4.6 of the paper
("CARLA default"): the vehicle brakes fully when the pedestrian is within a fixed distance straight ahead, whatever
the speeds, and the pedestrian does not react to the vehicle.

Steering is pure pursuit: the arc that starts along the heading and meets the centreline a look-ahead away. On a
circle it has no steady error, far from the lane it never turns by more than half a turn, and it does not depend
on derivatives of the map. See 'Implementation of the pure pursuit path tracking algorithm' by Coulter, CMU-RI-TR-92-01.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import Path, line_at, point_at

LATERAL_COMFORT = 2.0  # [m/s2] sideways in the bend: what drivers turning right at an intersection accept
COMFORT_ACCELERATION = 2.0  # [m/s2]
COMFORT_DECELERATION = 2.5  # [m/s2]
SPEED_TIME = 0.5  # [s] in which the speed goes to the wanted one
LOOK_AHEAD = 2.0  # [m] at rest
LOOK_AHEAD_TIME = 0.3  # [s] of driving, added to it
WALK_ACCELERATION = 2.5  # [m/s2] with which the walker changes its velocity
WALK_LOOK_AHEAD = 2.0  # [m]


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
    """Return the arc length [m] of the place that a driver at `s` [m] steers to."""
    return s + LOOK_AHEAD + LOOK_AHEAD_TIME * speed


@kernel
def pursuit_curvature(points, row, count, step, s, aside, x, y, heading, speed):  # type: ignore[no-untyped-def]
    """Curvature [1/m] of the arc to the centreline of lane `row`, a look-ahead beyond arc length `s` [m].

    Or to a place so far `aside` of it, to the left [m].
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
    """Acceleration [m/s2] along the heading from `speed` to the `wanted` one [m/s], within comfort."""
    return min(COMFORT_ACCELERATION, max(-COMFORT_DECELERATION, (wanted - speed) / SPEED_TIME))


@kernel
def too_near(forward: float, left: float, half_length: float, reach: float, distance: float) -> bool:
    """Whether a pedestrian at (forward, left) [m] of the vehicle's centre is straight ahead of its front, and near.

    Near is within `distance` [m], straight ahead within `reach` [m] of the centre line.
    """
    return 0.0 < forward < half_length + distance and abs(left) < reach


@kernel
def walk_velocity(points, row, count, step, s, offset, x, y, speed):  # type: ignore[no-untyped-def]
    """Velocity (east, north) [m/s] of a walker at (x, y) that follows its route, `offset` [m] to its left."""
    here_x, here_y, ux, uy = line_at(points, row, count, step, s + WALK_LOOK_AHEAD)
    dx, dy = here_x - offset * uy - x, here_y + offset * ux - y
    distance = math.sqrt(dx * dx + dy * dy)
    return speed * dx / distance, speed * dy / distance


@kernel
def walk_acceleration(change_x: float, change_y: float, most: float, period: float) -> tuple[float, float]:
    """Acceleration (ax, ay) [m/s2] for a change of velocity [m/s], `most` [m/s2] at most."""
    change = math.sqrt(change_x * change_x + change_y * change_y)
    scale = 1.0 / period if change <= most * period else most / change
    return change_x * scale, change_y * scale
