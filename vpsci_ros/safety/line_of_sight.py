"""The visible share of a pedestrian from a point, behind parked vehicles (oriented rectangles).

Everything is seen from above. The disc of the pedestrian takes an angle of 2 asin(radius / distance) at the eye; each
rectangle that is nearer covers the angle between its outermost corners. The visible share is the uncovered part of the
disc's angle. Seen from a point, one of two convex shapes that do not overlap is in front of the
other in every direction that both take up, so one direction decides which.
"""

import math

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.safety.inputs import FloatLike, Floats, as_floats, broadcast, refuse

BOX = 5  # columns of a rectangle: x, y [m], heading [rad], length, width [m]
_TURN = 2.0 * math.pi


def visible_share(
    eye_x: FloatLike,
    eye_y: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    boxes: FloatLike,
    *,
    radius: FloatLike = PEDESTRIAN_RADIUS,
) -> Floats:
    """Return the share of a pedestrian's disc that is seen from a point, float64[B], 0 (nothing) to 1 (all of it).

    :param eye_x, eye_y: the point [m]; float[B], as are the others, or anything that broadcasts with them.
    :param ped_x, ped_y: centre of the disc [m].
    :param boxes: rectangles that hide, float[K, 5] for all rows: x, y of the centre [m], heading [rad], length and
        width [m]. An eye inside a rectangle sees nothing.
    :param radius: of the disc [m]; an eye within the disc sees all of it, also inside a rectangle.
    :raises InvalidInput: a value that is not finite, a size that is not positive, shapes that do not fit.
    """
    names, given = ("eye_x", "eye_y", "ped_x", "ped_y", "radius"), (eye_x, eye_y, ped_x, ped_y, radius)
    arrays, shape = broadcast(names, given)
    if not all(np.isfinite(array).all() for array in arrays) or not (arrays[4] > 0.0).all():
        refuse(names, given, positive=("radius",))
    out = np.empty(arrays[0].size)
    rectangles = as_boxes(boxes)
    _shares(*arrays, rectangles, np.empty((3 * len(rectangles), 2)), out)
    result: Floats = out.reshape(shape)[()]
    return result


def as_boxes(boxes: FloatLike) -> Floats:
    """Return checked rectangles as contiguous float64[K, 5]: x, y [m], heading [rad], length, width [m].

    :raises InvalidInput: another shape, a number that is not finite, a size that is not positive.
    """
    array = np.ascontiguousarray(as_floats("boxes", boxes))
    if array.ndim != 2 or array.shape[1] != BOX:
        raise InvalidInput(f"boxes: expected [K, 5] of x, y, heading, length, width, got shape {array.shape}")
    if not np.isfinite(array).all() or not (array[:, 3:] > 0.0).all():
        raise InvalidInput(f"boxes: expected finite numbers and sizes above 0, got {array.tolist()}")
    return array


@kernel
def _shares(eye_x, eye_y, ped_x, ped_y, radius, boxes, shadows, out):  # type: ignore[no-untyped-def]
    for i in range(out.size):
        out[i] = visible_pair(eye_x[i], eye_y[i], ped_x[i], ped_y[i], radius[i], boxes, len(boxes), shadows)


@kernel
def visible_pair(eye_x, eye_y, x, y, radius, boxes, count, shadows):  # type: ignore[no-untyped-def]
    """`visible_share` of one pair behind the first `count` boxes, unchecked; `shadows`: scratch float64[3 count, 2]."""
    dx, dy = x - eye_x, y - eye_y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance <= radius:
        return 1.0
    half, bearing = math.asin(radius / distance), math.atan2(dy, dx)
    n = 0
    for k in range(count):
        first, last = _corners_seen(eye_x, eye_y, boxes[k], bearing)
        if first > last:
            return 0.0  # from inside
        for turn in range(-1, 2):
            low, high = max(first + turn * _TURN, -half), min(last + turn * _TURN, half)
            if low < high:
                middle = 0.5 * (low + high)
                along = distance * math.sin(middle)
                disc = distance * math.cos(middle) - math.sqrt(max(radius * radius - along * along, 0.0))
                if _entry(eye_x, eye_y, bearing + middle, boxes[k]) < disc:
                    shadows[n, 0], shadows[n, 1] = low, high
                    n += 1
    return 1.0 - _union(shadows, n) / (2.0 * half)


@kernel
def _corners_seen(eye_x, eye_y, box, bearing):  # type: ignore[no-untyped-def]
    """Return the first and last direction [rad] that a box takes up, from `bearing`; (1, -1) for an eye inside."""
    c, s = math.cos(box[2]), math.sin(box[2])
    forward, left = c * (eye_x - box[0]) + s * (eye_y - box[1]), c * (eye_y - box[1]) - s * (eye_x - box[0])
    if abs(forward) < 0.5 * box[3] and abs(left) < 0.5 * box[4]:
        return 1.0, -1.0
    to_box = math.atan2(box[1] - eye_y, box[0] - eye_x)
    first, last = math.inf, -math.inf
    for k in range(4):
        along = 0.5 * box[3] if k < 2 else -0.5 * box[3]
        across = 0.5 * box[4] if k % 2 else -0.5 * box[4]
        x, y = box[0] + c * along - s * across - eye_x, box[1] + s * along + c * across - eye_y
        turned = _wrapped(math.atan2(y, x) - to_box)
        first, last = min(first, turned), max(last, turned)
    middle = _wrapped(to_box - bearing)
    return middle + first, middle + last


@kernel
def _wrapped(angle: float) -> float:
    """Return the same direction as an angle from -pi to pi, for an `angle` from -2 pi to 2 pi [rad]."""
    if angle > math.pi:
        return angle - _TURN
    return angle + _TURN if angle < -math.pi else angle


@kernel
def _entry(eye_x, eye_y, direction, box):  # type: ignore[no-untyped-def]
    """Return the distance [m] from the eye to the box in a direction [rad]; infinity where the box is missed."""
    c, s = math.cos(box[2]), math.sin(box[2])
    at = (c * (eye_x - box[0]) + s * (eye_y - box[1]), c * (eye_y - box[1]) - s * (eye_x - box[0]))
    way = (math.cos(direction - box[2]), math.sin(direction - box[2]))
    enters, leaves = 0.0, math.inf
    for k in range(2):
        if way[k] == 0.0:
            if abs(at[k]) > 0.5 * box[3 + k]:
                return math.inf
            continue
        one, other = (-0.5 * box[3 + k] - at[k]) / way[k], (0.5 * box[3 + k] - at[k]) / way[k]
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return enters if enters <= leaves else math.inf


@kernel
def _union(intervals, n):  # type: ignore[no-untyped-def]
    """Return the length of the union of the first `n` intervals, which are sorted on the way."""
    for i in range(1, n):
        low, high = intervals[i, 0], intervals[i, 1]
        j = i
        while j > 0 and intervals[j - 1, 0] > low:
            intervals[j, 0], intervals[j, 1] = intervals[j - 1, 0], intervals[j - 1, 1]
            j -= 1
        intervals[j, 0], intervals[j, 1] = low, high
    total, reached = 0.0, -math.inf
    for i in range(n):
        total += max(0.0, intervals[i, 1] - max(reached, intervals[i, 0]))
        reached = max(reached, intervals[i, 1])
    return total


@kernel
def touches_box(x, y, heading, box, length=VEHICLE_LENGTH, width=VEHICLE_WIDTH):  # type: ignore[no-untyped-def]
    """Return whether a vehicle touches or overlaps a box, float64[5] (x, y [m], heading [rad], length, width [m])."""
    turned = box[2] - heading
    c, s = abs(math.cos(turned)), abs(math.sin(turned))
    dx, dy = box[0] - x, box[1] - y
    for direction, own, across, other, aside in (
        (heading, length, width, box[3], box[4]),
        (box[2], box[3], box[4], length, width),
    ):
        forward = abs(math.cos(direction) * dx + math.sin(direction) * dy)
        left = abs(math.cos(direction) * dy - math.sin(direction) * dx)
        if forward > 0.5 * (own + c * other + s * aside) or left > 0.5 * (across + s * other + c * aside):
            return False
    return True
