"""Safety measures besides CurvTTC, each with its source, on batches: 2-D and second-order TTC, DRAC, TTCE and DCE.

A measure from one instant predicts; PET, in `encroachment`, looks back at what happened.
"""

import math

import numpy as np

from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.contact import first_contact_accelerating
from vpsci_ros.safety.curvttc import HORIZON, curvttc
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, in_vehicle_frame
from vpsci_ros.safety.inputs import FloatLike, Floats, as_floats, broadcast, refuse


def ttc_2d(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    speed: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    ped_vx: FloatLike,
    ped_vy: FloatLike,
    *,
    length: FloatLike = VEHICLE_LENGTH,
    width: FloatLike = VEHICLE_WIDTH,
    radius: FloatLike = PEDESTRIAN_RADIUS,
    horizon: FloatLike = HORIZON,
) -> Floats:
    """Two-dimensional time to collision with both velocities constant [s]: `curvttc` on a straight path.

    Arguments, result and errors are those of `curvttc` without the curvature. See Jiao, "A fast calculation of
    two-dimensional Time-to-Collision" (2023), which computes the same for two rectangles.
    """
    state = (x, y, heading, speed, 0.0, ped_x, ped_y, ped_vx, ped_vy)
    return curvttc(*state, length=length, width=width, radius=radius, horizon=horizon)


@kernel
def _second_order(arrays: tuple[Floats, ...], out: Floats) -> bool:
    """Fill `out` from 14 float64[B]; return False at the first bad number."""
    for i in range(out.size):
        total = 0.0
        for array in arrays:
            total += array[i]
        speed, acceleration, curvature = arrays[3][i], arrays[4][i], arrays[5][i]
        length, width, radius, horizon = arrays[10][i], arrays[11][i], arrays[12][i], arrays[13][i]
        if not (math.isfinite(total) and speed >= 0.0 and min(length, width, radius, horizon) > 0.0):
            return False
        dx, dy = arrays[6][i] - arrays[0][i], arrays[7][i] - arrays[1][i]
        walker = in_vehicle_frame(arrays[2][i], dx, dy, arrays[8][i], arrays[9][i])
        car = speed, acceleration, curvature, 0.5 * length, 0.5 * width
        out[i] = first_contact_accelerating(*walker, *car, radius, horizon)
    return True


def second_order_ttc(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    speed: FloatLike,
    acceleration: FloatLike,
    curvature: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    ped_vx: FloatLike,
    ped_vy: FloatLike,
    *,
    length: FloatLike = VEHICLE_LENGTH,
    width: FloatLike = VEHICLE_WIDTH,
    radius: FloatLike = PEDESTRIAN_RADIUS,
    horizon: FloatLike = HORIZON,
) -> Floats:
    """Second-order time to collision of a turning vehicle [s]: curvature and acceleration stay constant.

    After Nick Zinat Matin et al., "Second-Order Time to Collision With Non-Static Acceleration" (arXiv 2502.08066): the
    acceleration turns with the vehicle, so the path is an arc of constant curvature driven at constant longitudinal
    acceleration. Two things differ from that paper, so that only the prediction differs from CurvTTC and not the
    bodies: contact is that of rectangle and disc, not of two circles, and the arc ends after 90 degrees. A vehicle that
    brakes to a stop stays there; it does not reverse. The pedestrian keeps its velocity.

    :param acceleration: along the heading [m/s2], negative when braking; float[B] or broadcasting, as are the others.
    :returns: float64[B] [s]; 0 where they touch now, infinity where they do not touch within the horizon. The other
        parameters are those of `curvttc`, and so is the exactness.
    :raises InvalidInput: as `curvttc` does.
    """
    names = ("x", "y", "heading", "speed", "acceleration", "curvature", "ped_x", "ped_y", "ped_vx", "ped_vy")
    sizes = ("length", "width", "radius", "horizon")
    states = (x, y, heading, speed, acceleration, curvature, ped_x, ped_y, ped_vx, ped_vy)
    given = (*states, length, width, radius, horizon)
    arrays, shape = broadcast(names + sizes, given)
    out = np.empty(arrays[0].size)
    if not _second_order(arrays, out):
        refuse(names + sizes, given, positive=sizes, not_negative=("speed",))
    result: Floats = out.reshape(shape)[()]
    return result


def drac(ttc: FloatLike, speed: FloatLike) -> Floats:
    """Deceleration rate to avoid the crash [m/s2]: it stops the vehicle where contact is predicted at constant speed.

    At constant speed v the vehicle reaches that point of its path after v * ttc metres; stopping within s takes
    v^2 / (2 s) = v / (2 ttc). See Cooper and Ferguson, "Traffic studies at T-junctions" (1976), for a vehicle behind
    another one; here the point of contact stands still, as is usual for crossing conflicts.

    :param ttc: time to contact [s], float[B], not below 0; infinity where none is predicted.
    :param speed: of the vehicle [m/s], not below 0; broadcasts with `ttc`.
    :returns: float64[B] [m/s2]; 0 where no contact is predicted or the vehicle stands, infinity where a moving vehicle
        touches already.
    :raises InvalidInput: NaN, a negative value, an infinite speed, shapes that do not broadcast.
    """
    (times, speeds), shape = broadcast(("ttc", "speed"), (ttc, speed))
    if not ((times >= 0.0).all() and (speeds >= 0.0).all() and np.isfinite(speeds).all()):
        given = as_floats("ttc", ttc)
        refuse(("ttc", "speed"), (np.where(given == np.inf, 0.0, given), speed), not_negative=("ttc", "speed"))
    moving = np.where(speeds > 0.0, np.inf, 0.0)  # the answer where they touch now
    result: Floats = np.divide(speeds, 2.0 * times, out=moving, where=times > 0.0).reshape(shape)[()]
    return result


def closest_encounter(
    x: FloatLike,
    y: FloatLike,
    vx: FloatLike,
    vy: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    ped_vx: FloatLike,
    ped_vy: FloatLike,
) -> tuple[Floats, Floats]:
    """Time to the closest encounter (TTCE) [s] and distance then (DCE) [m], centre to centre, at constant velocities.

    See Eggert, "Predictive risk estimation for intelligent ADAS functions" (ITSC 2014).

    :param x, y, vx, vy: position [m] and velocity [m/s] of one agent; float[B], as are the others, or broadcasting.
    :returns: TTCE float64[B] [s], 0 where they do not approach each other, and DCE float64[B] [m].
    :raises InvalidInput: a value that is not finite, shapes that do not broadcast.
    """
    names = ("x", "y", "vx", "vy", "ped_x", "ped_y", "ped_vx", "ped_vy")
    given = (x, y, vx, vy, ped_x, ped_y, ped_vx, ped_vy)
    arrays, shape = broadcast(names, given)
    if not all(np.isfinite(array).all() for array in arrays):
        refuse(names, given)
    x1, y1, vx1, vy1, x2, y2, vx2, vy2 = arrays
    dx, dy, du, dv = x2 - x1, y2 - y1, vx2 - vx1, vy2 - vy1
    squared = du * du + dv * dv
    approach = np.maximum(-(dx * du + dy * dv), 0.0)
    ttce = np.divide(approach, squared, out=np.zeros_like(squared), where=squared > 0.0)
    dce = np.hypot(dx + du * ttce, dy + dv * ttce)
    return ttce.reshape(shape)[()], dce.reshape(shape)[()]
