"""A reference pedestrian that evades by rule: the social force model, with the vehicle as the thing to keep off.

See 'Social force model for pedestrian dynamics' by Helbing and Molnar, Physical Review E 51, 1995
(https://doi.org/10.1103/PhysRevE.51.4282), for the form; the strength of the vehicle's repulsion is set here, so that
a pedestrian walking at 1.4 m/s straight at a standing vehicle comes to rest one metre from it.
"""

import math

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import from_heading_frame, to_heading_frame

RELAXATION_TIME = 0.5  # [s] in which a pedestrian regains the wanted velocity; Helbing and Molnar
RANGE = 1.0  # [m] over which the repulsion falls to 1/e
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
