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

from vpsci_ros.safety import PEDESTRIAN_RADIUS
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import from_heading_frame, to_heading_frame
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


# ---- The social force model: repulsion between pedestrians, and a reference pedestrian repelled by the vehicle.
#
# See 'Social force model for pedestrian dynamics' by Helbing and Molnar, Physical Review E 51, 1995
# (https://doi.org/10.1103/PhysRevE.51.4282), for the form and for the repulsion between pedestrians. There it is an
# ellipse that grows with the step of the other one; here it acts where the two will be nearest, as in 'Social force
# model with explicit collision prediction' by Zanlungo, Ikeda and Kanda, EPL 93, 2011, which pushes both alike. How
# stiff bodies are, and the strength of the vehicle's repulsion, are set here, the latter so that a pedestrian walking
# at 1.4 m/s straight at a standing vehicle comes to rest one metre from it.


RELAXATION_TIME = 0.5  # [s] in which a pedestrian regains the wanted velocity; Helbing and Molnar
RANGE = 1.0  # [m] over which the repulsion falls to 1/e
POTENTIAL = 2.1  # [m2/s2] V of two pedestrians at the same place; Helbing and Molnar
AMONG_RANGE = 0.3  # [m] sigma, over which it falls to 1/e; Helbing and Molnar
FORESIGHT = 0.5  # [s] as the relaxation time
STIFFNESS = 40.0  # [1/s2] of bodies that touch
STRENGTH = 1.4 / RELAXATION_TIME * math.e  # [m/s2] at contact: 1.4 m/s is held off at a distance of RANGE


@kernel
def social_force(  # type: ignore[no-untyped-def]
    wanted_x, wanted_y, vx, vy, ped_x, ped_y, x, y, heading, half_length, half_width, radius
):
    """Acceleration (ax, ay) [m/s2] of a pedestrian that wants the velocity (wanted_x, wanted_y) [m/s].

    The vehicle's rectangle has its centre at (x, y) [m].
    """
    forward, left = to_heading_frame(heading, ped_x - x, ped_y - y)
    away_forward = forward - min(max(forward, -half_length), half_length)
    away_left = left - min(max(left, -half_width), half_width)
    distance = math.sqrt(away_forward * away_forward + away_left * away_left)
    ax, ay = (wanted_x - vx) / RELAXATION_TIME, (wanted_y - vy) / RELAXATION_TIME
    if distance > 0.0:
        push = STRENGTH * math.exp((radius - distance) / RANGE) / distance
        push_x, push_y = from_heading_frame(heading, push * away_forward, push * away_left)
        ax, ay = ax + push_x, ay + push_y
    return ax, ay


@kernel
def keep_apart(state, first, count, pushes):  # type: ignore[no-untyped-def]
    """Compute the repulsion between the pedestrians in rows `first` to `first + count` of EPISODE[B], [B, 2] [m/s2]."""
    for i in range(first, first + count):
        pushes[i, 0] = pushes[i, 1] = 0.0
        for j in range(first, i):
            one, other = state[i], state[j]
            ax, ay = repulsion(
                one.pedestrian_x - other.pedestrian_x,
                one.pedestrian_y - other.pedestrian_y,
                one.pedestrian_vx - other.pedestrian_vx,
                one.pedestrian_vy - other.pedestrian_vy,
            )
            pushes[i, 0], pushes[i, 1] = pushes[i, 0] + ax, pushes[i, 1] + ay
            pushes[j, 0], pushes[j, 1] = pushes[j, 0] - ax, pushes[j, 1] - ay


@kernel
def repulsion(dx, dy, vx, vy):  # type: ignore[no-untyped-def]
    """Acceleration (ax, ay) [m/s2] of a pedestrian at (dx, dy) [m] of another one, with (vx, vy) [m/s] relative to it.

    It is the repulsion at the nearest point within the next `FORESIGHT`, so that pedestrians who meet step aside.
    Bodies that touch are pressed apart.
    """
    square = vx * vx + vy * vy
    ahead = min(FORESIGHT, max(0.0, -(dx * vx + dy * vy) / square)) if square > 0.0 else 0.0
    ax, ay = _away(dx + ahead * vx, dy + ahead * vy)
    distance = math.sqrt(dx * dx + dy * dy)
    if 0.0 < distance < 2.0 * PEDESTRIAN_RADIUS:
        press = STIFFNESS * (2.0 * PEDESTRIAN_RADIUS - distance) / distance
        ax, ay = ax + press * dx, ay + press * dy
    return ax, ay


@kernel
def _away(dx, dy):  # type: ignore[no-untyped-def]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance == 0.0:
        return 0.0, 0.0
    push = POTENTIAL / AMONG_RANGE * math.exp(-distance / AMONG_RANGE) / distance
    return push * dx, push * dy
