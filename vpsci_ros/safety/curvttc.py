"""CurvTTC: the least time to contact of a vehicle on an arc and a pedestrian on a line, see docs/curvttc.md.

`curvttc` is for batches and checks its arguments. `curvttc_pair` gives the same number for one pair, unchecked, for
other numba code.
"""

import math
from typing import Literal

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import in_threads, kernel
from vpsci_ros.safety.contact import first_contact
from vpsci_ros.safety.crossing import overlap_start
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, in_vehicle_frame
from vpsci_ros.safety.inputs import FloatLike, Floats, as_floats, common_shape, flattened, refuse

HORIZON = 10.0  # [s] how far the motion is predicted
CRITICAL_TTC = 5.0  # [s] below it an interaction is safety-critical and the policies act
CONFLICT_TTC = 2.0  # [s] below it an interaction is a conflict


@kernel
def curvttc_pair(x, y, heading, speed, curvature, ped_x, ped_y, ped_vx, ped_vy, length, width, radius, horizon):  # type: ignore[no-untyped-def]
    """CurvTTC [s] of one pair by first contact, as `curvttc` gives it; for other numba code, arguments unchecked."""
    dx, dy = ped_x - x, ped_y - y
    reach = 0.5 * (length + width) + radius + horizon * (speed + abs(ped_vx) + abs(ped_vy))
    if abs(dx) > reach or abs(dy) > reach:
        return math.inf
    walker = in_vehicle_frame(heading, dx, dy, ped_vx, ped_vy)
    return first_contact(*walker, speed, curvature, 0.5 * length, 0.5 * width, radius, horizon)


@kernel
def _curvttcs(states: tuple[Floats, ...], sizes: Floats, footprint: bool, out: Floats) -> bool:
    """Fill `out`; return False at the first bad number. `states` are 9 float64[B], `sizes` is float64[4, 1 or B]."""
    stride = 0 if sizes.shape[1] == 1 else 1
    for i in range(out.size):
        x, y, heading, speed, curvature = states[0][i], states[1][i], states[2][i], states[3][i], states[4][i]
        ped_x, ped_y, ped_vx, ped_vy = states[5][i], states[6][i], states[7][i], states[8][i]
        length, width = sizes[0, i * stride], sizes[1, i * stride]
        radius, horizon = sizes[2, i * stride], sizes[3, i * stride]
        total = x + y + heading + speed + curvature + ped_x + ped_y + ped_vx + ped_vy
        total += length + width + radius + horizon
        if not (math.isfinite(total) and speed >= 0.0 and min(length, width, radius, horizon) > 0.0):
            return False
        if footprint:
            car, walker = (x, y, heading, speed, curvature), (ped_x, ped_y, ped_vx, ped_vy)
            out[i] = curvttc_pair(*car, *walker, length, width, radius, horizon)
        else:
            walker = in_vehicle_frame(heading, ped_x - x, ped_y - y, ped_vx, ped_vy)
            out[i] = overlap_start(*walker, speed, curvature, 0.5 * (length + width), horizon)
    return True


_STATE = ("x", "y", "heading", "speed", "curvature", "ped_x", "ped_y", "ped_vx", "ped_vy")
_SIZES = ("length", "width", "radius", "horizon")
_PER_THREAD = 20_000  # pairs below which another thread costs more than it saves


def curvttc(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    speed: FloatLike,
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
    method: Literal["footprint", "center"] = "footprint",
) -> Floats:
    """Curvilinear time to collision [s], float64[B], of vehicles and pedestrians (CurvTTC of the paper's Table 7).

    The least time after which the footprints touch if the vehicle keeps its speed and path curvature, for at most 90
    degrees of the arc, and the pedestrian keeps its velocity.

    :param x, y: centre of the vehicle's rectangle [m], which moves along its heading; float[B], as are the others,
        or anything that broadcasts with them, scalars included.
    :param heading: direction of motion and of the long side [rad], counter-clockwise from x.
    :param speed: of the centre along the heading [m/s], not below 0.
    :param curvature: of the centre's path [1/m], positive to the left.
    :param ped_x, ped_y: centre of the pedestrian's disc [m].
    :param ped_vx, ped_vy: its velocity [m/s], in the same frame as the positions.
    :param length, width, radius: sizes [m], above 0.
    :param horizon: of the prediction [s], above 0.
    :param method: "footprint", the first contact of rectangle and disc, exact to 1e-3 s; the n-th step of its search
        is at least n^2 ns, and may pass a shorter contact. Or "center", the older form: the paths of the two centres
        cross, each agent occupies the crossing point for (length + width) / 2 either side at its own speed, and CurvTTC
        is the start of the overlap (`radius` unused).
    :returns: float64[B] [s]; infinity where there is no contact, or no overlap, within the horizon and the 90 degrees.
        With "footprint" 0 where the footprints touch now.
    :raises InvalidInput: a value that is not finite, a negative speed, a size or horizon that is not positive, shapes
        that do not broadcast, an unknown method.
    """
    if method not in ("footprint", "center"):
        raise InvalidInput(f"method: expected 'footprint' or 'center', got {method!r}")
    states = (x, y, heading, speed, curvature, ped_x, ped_y, ped_vx, ped_vy)
    arrays = [as_floats(name, value) for name, value in zip(_STATE, states, strict=True)]
    sizes = [as_floats(name, v) for name, v in zip(_SIZES, (length, width, radius, horizon), strict=True)]
    shape = common_shape(_STATE + _SIZES, arrays + sizes)
    flat = tuple(flattened(array, shape) for array in arrays)
    one_size = all(size.size == 1 for size in sizes)
    table = np.stack([size.reshape(1) if one_size else flattened(size, shape) for size in sizes])
    out = np.empty(shape)
    flat_out, footprint = out.reshape(-1), method == "footprint"

    def run(part: slice) -> bool:
        own = table if one_size else np.ascontiguousarray(table[:, part])
        return bool(_curvttcs(tuple(a[part] for a in flat), own, footprint, flat_out[part]))

    if not all(in_threads(run, out.size, _PER_THREAD)):
        refuse(_STATE + _SIZES, arrays + sizes, positive=_SIZES, not_negative=("speed",))
    result: Floats = out[()]
    return result
