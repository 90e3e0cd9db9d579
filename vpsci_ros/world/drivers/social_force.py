"""The social force model: the driver `social_force`, whom the vehicle repels, and repulsion between pedestrians.

See 'Social force model for pedestrian dynamics' by Helbing and Molnar, Physical Review E 51, 1995
(https://doi.org/10.1103/PhysRevE.51.4282), for the form and for the repulsion between pedestrians. Their repulsion is
elliptic and grows with the other pedestrian's step; here it acts where the two will be nearest, as in 'Social force
model with explicit collision prediction' by Zanlungo, Ikeda and Kanda, EPL 93, 2011, and pushes both alike. The
stiffness of bodies and the strength of the vehicle's repulsion are our choice, the latter so that a pedestrian walking
at 1.4 m/s straight at a standing vehicle comes to rest one metre from it.
"""

import math

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.drivers import walker
from vpsci_ros.world.observation import from_heading_frame, to_heading_frame

RELAXATION_TIME = 0.5  # [s] in which a pedestrian regains the wanted velocity; Helbing and Molnar
RANGE = 1.0  # [m] over which the repulsion falls to 1/e
POTENTIAL = 2.1  # [m2/s2] V of two pedestrians at the same place; Helbing and Molnar
AMONG_RANGE = 0.3  # [m] sigma, over which it falls to 1/e; Helbing and Molnar
FORESIGHT = 0.5  # [s] as the relaxation time
STIFFNESS = 40.0  # [1/s2] of bodies that touch
STRENGTH = 1.4 / RELAXATION_TIME * math.e  # [m/s2] at contact: 1.4 m/s is held off at a distance of RANGE

_HALF_LENGTH, _HALF_WIDTH = 0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH


@inlined
def pedestrian(episode, _i, _answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] of who wants to walk its route and avoids the vehicle; False."""
    wanted_x, wanted_y = episode.pedestrian_vx, episode.pedestrian_vy
    if not walker.early(episode, settings):
        wanted_x, wanted_y = walker.wanted(episode, walker.pace(episode, settings), tables, settings)
    now = episode.pedestrian_vx, episode.pedestrian_vy, episode.pedestrian_x, episode.pedestrian_y
    car = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, _HALF_LENGTH, _HALF_WIDTH
    ax, ay = social_force(wanted_x, wanted_y, *now, *car, PEDESTRIAN_RADIUS)
    return ax, ay, False


@kernel
def social_force(  # type: ignore[no-untyped-def]
    wanted_x, wanted_y, vx, vy, ped_x, ped_y, x, y, heading, half_length, half_width, radius
):
    """Acceleration (ax, ay) [m/s2] of a pedestrian that wants (wanted_x, wanted_y) [m/s] and avoids the vehicle.

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
    """Write to `pushes`, [B, 2] [m/s2], the repulsion between the pedestrians in `count` rows from `first` on."""
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
    """Acceleration (ax, ay) [m/s2] of a pedestrian at (dx, dy) [m] and (vx, vy) [m/s] relative to another one.

    The repulsion is that at the nearest approach within the next `FORESIGHT`, so that pedestrians who meet step aside.
    Bodies that overlap are pressed apart.
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
