"""The way on foot round vehicles that stand: the shortest way past their corners."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import PEDESTRIAN_RADIUS

Point = tuple[float, float]
ROOM, CORNER = 0.6, 0.8  # [m] from the pedestrian's centre to a vehicle beside it, and at its corners


def meets(a: Point, b: Point, box: NDArray[np.float64], room: float) -> bool:
    """Whether the segment from a to b passes a box (x, y, heading, length, width) at less than `room` [m]."""
    along, (lengths, widths) = _within(a, box), 0.5 * box[3:] + room
    way, first, last = np.subtract(_within(b, box), along), 0.0, 1.0
    for begin, step, half in zip(along, way, (lengths, widths), strict=True):
        if abs(step) < 1e-9:
            if abs(begin) >= half:
                return False
            continue
        ends = sorted(((-half - begin) / step, (half - begin) / step))
        first, last = max(first, ends[0]), min(last, ends[1])
    return bool(first < last)


def next_point(own: Point, target: Point, boxes: Sequence[NDArray[np.float64]]) -> Point:
    """Return the next point [m] of the shortest way from `own` to `target` round boxes; `target` where there is none.

    A pedestrian nearer than `ROOM` may go on as near, but not nearer.
    """
    near = [
        max(PEDESTRIAN_RADIUS, min(ROOM, float((np.abs(_within(own, b)) - 0.5 * b[3:]).max()) - 1e-6)) for b in boxes
    ]
    corners = [_beyond(box, *signs) for box in boxes for signs in itertools.product((-1.0, 1.0), repeat=2)]
    points = [own, *corners, target]
    left = np.full(len(points), math.inf)  # [m] to the target
    left[-1], ahead = 0.0, [len(points) - 1] * len(points)
    open_ = set(range(len(points)))
    while open_ and math.isfinite(left[best := min(open_, key=lambda k: left[k])]):
        open_.remove(best)
        for k in open_:
            rooms = near if k == 0 else [ROOM] * len(boxes)
            length = left[best] + math.dist(points[k], points[best])
            if length < left[k] and not any(
                map(meets, [points[k]] * len(boxes), [points[best]] * len(boxes), boxes, rooms)
            ):
                left[k], ahead[k] = length, best
    return points[ahead[0]]


def _within(point: Point, box: NDArray[np.float64]) -> Point:
    """Return a point in a box's frame: along its heading and to its left [m]."""
    dx, dy, cosine, sine = point[0] - box[0], point[1] - box[1], math.cos(box[2]), math.sin(box[2])
    return dx * cosine + dy * sine, dy * cosine - dx * sine


def _beyond(box: NDArray[np.float64], front: float, left: float) -> Point:
    """Return the point beyond a corner of a box, by `CORNER` along it and beside it."""
    along, aside = front * (0.5 * box[3] + CORNER), left * (0.5 * box[4] + CORNER)
    cosine, sine = math.cos(box[2]), math.sin(box[2])
    return float(box[0] + along * cosine - aside * sine), float(box[1] + along * sine + aside * cosine)
