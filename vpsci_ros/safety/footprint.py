"""The two footprints, the vehicle's oriented rectangle and the pedestrian's disc, and the distance between them.

The distance from a point to a convex set is a convex function of the point, and moving the point by one metre changes
it by at most one metre. `contact` builds on these two facts.
"""

import math

import numpy as np

from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.inputs import FloatLike, Floats, broadcast, refuse

VEHICLE_LENGTH = 4.69  # [m] Tesla Model 3, the car of the simulations
VEHICLE_WIDTH = 1.85  # [m]
PEDESTRIAN_RADIUS = 0.3  # [m]


@kernel
def gap(forward: float, left: float, half_length: float, half_width: float) -> float:
    """Signed distance [m] from a point in the vehicle's frame to the rectangle's outline, negative inside."""
    dx = abs(forward) - half_length
    dy = abs(left) - half_width
    if dx > 0.0 and dy > 0.0:
        return math.sqrt(dx * dx + dy * dy)
    return max(dx, dy)


@kernel
def in_vehicle_frame(heading, dx, dy, ped_vx, ped_vy):  # type: ignore[no-untyped-def]
    """Return the pedestrian's position from the vehicle [m] and velocity [m/s] as (forward, left, forward, left)."""
    cos, sin = math.cos(heading), math.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx, cos * ped_vx + sin * ped_vy, cos * ped_vy - sin * ped_vx


@kernel
def clearance_pair(x, y, heading, ped_x, ped_y, length, width, radius):  # type: ignore[no-untyped-def]
    """Return the `clearance` [m] of one pair, for other numba code: arguments [m] and [rad], unchecked."""
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dy = ped_x - x, ped_y - y
    return gap(cos * dx + sin * dy, cos * dy - sin * dx, 0.5 * length, 0.5 * width) - radius


@kernel
def _clearances(arrays: tuple[Floats, ...], out: Floats) -> bool:
    """Fill `out` from 8 float64[B]; return False at the first bad number."""
    x, y, heading, ped_x, ped_y, length, width, radius = arrays
    for i in range(out.size):
        total = x[i] + y[i] + heading[i] + ped_x[i] + ped_y[i] + length[i] + width[i] + radius[i]
        if not (math.isfinite(total) and length[i] > 0.0 and width[i] > 0.0 and radius[i] > 0.0):
            return False
        out[i] = clearance_pair(x[i], y[i], heading[i], ped_x[i], ped_y[i], length[i], width[i], radius[i])
    return True


def clearance(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    *,
    length: FloatLike = VEHICLE_LENGTH,
    width: FloatLike = VEHICLE_WIDTH,
    radius: FloatLike = PEDESTRIAN_RADIUS,
) -> Floats:
    """Free distance [m], float64[B], between the vehicle's rectangle and the pedestrian's disc; 0 or less: they touch.

    :param x, y: centre of the rectangle [m]; float[B], as are the others, or anything that broadcasts with them.
    :param heading: direction of the rectangle's long side [rad], counter-clockwise from x.
    :param ped_x, ped_y: centre of the disc [m].
    :param length, width, radius: sizes [m], all above 0.
    :returns: float64[B] [m]. Positive: the exact distance between the two outlines. Zero or negative: they touch or
        overlap, and the amount is the depth of the disc's deepest point below the nearest side of the rectangle.
    :raises InvalidInput: a value that is not finite, a size that is not positive, shapes that do not broadcast.
    """
    names = ("x", "y", "heading", "ped_x", "ped_y", "length", "width", "radius")
    given = (x, y, heading, ped_x, ped_y, length, width, radius)
    arrays, shape = broadcast(names, given)
    out = np.empty(arrays[0].size)
    if not _clearances(arrays, out):
        refuse(names, given, positive=("length", "width", "radius"))
    result: Floats = out.reshape(shape)[()]
    return result
