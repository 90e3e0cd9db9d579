"""Post-encroachment time: from when one agent leaves the crossing point to when the other agent reaches it."""

import math

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.safety.inputs import FloatLike, Floats
from vpsci_ros.safety.series import trajectories

_PRECISION = 1e-6  # [steps]


@kernel
def first_crossing(
    x: Floats, y: Floats, ahead: float, heading: float, ped_x: Floats, ped_y: Floats
) -> tuple[float, float, float, float]:
    """First point of the pedestrian's path on the vehicle's path: (vehicle step, pedestrian step, x, y) [steps, m].

    Steps are fractional, of float64[T] positions [m]. The vehicle's path goes on straight for `ahead` metres along its
    last `heading` [rad]; on that part the vehicle step is infinity, since the vehicle has not been there. Four NaN
    where the paths do not cross.
    """
    last = x.size - 1
    end_x, end_y = x[last] + ahead * math.cos(heading), y[last] + ahead * math.sin(heading)
    low_x, high_x = min(x.min(), end_x), max(x.max(), end_x)
    low_y, high_y = min(y.min(), end_y), max(y.max(), end_y)
    for j in range(ped_x.size - 1):
        ax, ay, bx, by = ped_x[j], ped_y[j], ped_x[j + 1], ped_y[j + 1]
        left, right, bottom, top = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
        if right < low_x or left > high_x or top < low_y or bottom > high_y:
            continue
        best_walked, best_driven = math.inf, math.inf
        for i in range(last + 1):
            cx, cy = x[i], y[i]
            dx, dy = (x[i + 1], y[i + 1]) if i < last else (end_x, end_y)
            if right < min(cx, dx) or left > max(cx, dx) or top < min(cy, dy) or bottom > max(cy, dy):
                continue
            across = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
            walked = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / across
            driven = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / across
            if 0.0 <= walked <= 1.0 and 0.0 <= driven <= 1.0 and walked < best_walked:
                best_walked = walked
                best_driven = i + driven if i < last else math.inf
        if best_walked <= 1.0:
            point_x, point_y = ax + best_walked * (bx - ax), ay + best_walked * (by - ay)
            return best_driven, j + best_walked, point_x, point_y
    return math.nan, math.nan, math.nan, math.nan


@kernel
def _outside(
    rows: tuple[Floats, ...], step: float, vehicle: bool, cx: float, cy: float, sizes: tuple[float, float, float]
) -> bool:
    """Return whether (cx, cy) lies outside the footprint of the vehicle, or the pedestrian, at a fractional `step`."""
    x, y, heading, ped_x, ped_y = rows
    i = min(int(step), x.size - 2)
    part = step - i
    if not vehicle:
        here_x, here_y = ped_x[i] + part * (ped_x[i + 1] - ped_x[i]), ped_y[i] + part * (ped_y[i + 1] - ped_y[i])
        return math.hypot(here_x - cx, here_y - cy) > sizes[2]
    turned = heading[i + 1] - heading[i]
    turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
    here_x, here_y = x[i] + part * (x[i + 1] - x[i]), y[i] + part * (y[i + 1] - y[i])
    return clearance_pair(here_x, here_y, heading[i] + part * turned, cx, cy, sizes[0], sizes[1], 0.0) > 0.0


@kernel
def _edge(
    rows: tuple[Floats, ...],
    start: float,
    toward: float,
    vehicle: bool,
    cx: float,
    cy: float,
    sizes: tuple[float, float, float],
) -> float:
    """Return the step at which the agent, over the point at `start`, uncovers it: going on (1) or back (-1)."""
    last = rows[0].size - 1.0
    covered = start
    while True:
        step = min(max(covered + toward, 0.0), last)
        if _outside(rows, step, vehicle, cx, cy, sizes):
            break
        if step == covered:
            return step  # the record ends, or begins, while the point is covered
        covered = step
    free = step
    while abs(free - covered) > _PRECISION:
        middle = 0.5 * (free + covered)
        if _outside(rows, middle, vehicle, cx, cy, sizes):
            free = middle
        else:
            covered = middle
    return covered


@kernel
def _pet_steps(rows: tuple[Floats, ...], sizes: tuple[float, float, float]) -> tuple[float, float]:
    """Return PET in steps, and the step at which the second agent arrives; NaN where the paths do not cross."""
    x, y, heading, ped_x, ped_y = rows
    driven, walked, cx, cy = first_crossing(x, y, 0.0, heading[-1], ped_x, ped_y)
    if not driven < math.inf:
        return math.nan, math.nan
    if walked <= driven:
        arrival = _edge(rows, driven, -1.0, True, cx, cy, sizes)
        return arrival - _edge(rows, walked, 1.0, False, cx, cy, sizes), arrival
    arrival = _edge(rows, walked, -1.0, False, cx, cy, sizes)
    return arrival - _edge(rows, driven, 1.0, True, cx, cy, sizes), arrival


@kernel
def _pets(rows: tuple[Floats, ...], sizes: tuple[float, float, float], pet: Floats, arrival: Floats) -> None:
    for i in range(pet.size):
        own = (rows[0][i], rows[1][i], rows[2][i], rows[3][i], rows[4][i])
        pet[i], arrival[i] = _pet_steps(own, sizes)


def post_encroachment_time(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    *,
    dt: float,
    length: float = VEHICLE_LENGTH,
    width: float = VEHICLE_WIDTH,
    radius: float = PEDESTRIAN_RADIUS,
) -> tuple[Floats, Floats]:
    """Return the post-encroachment time (PET) [s] and the time [s] of the second agent's arrival at the crossing point.

    PET is the time from when the first agent left the crossing point to when the second agent reached it. The crossing
    point is the first point of the pedestrian's recorded path that lies on the vehicle's; an agent covers that point
    while the point lies within the agent's footprint. See Allen, Shin and Cooper, "Analysis of traffic conflicts and
    collisions" (1978).

    PET looks back: where one agent never gets to the crossing point, because it stopped or turned away, the paths do
    not cross and PET is undefined, however near the miss was.

    :param x, y, heading: the vehicle's pose, float[..., T] [m] and [rad]; one episode, or a batch.
    :param ped_x, ped_y: the pedestrian's position, float[..., T] [m].
    :param dt: time between steps [s].
    :param length, width, radius: sizes [m], the same for all rows.
    :returns: PET float64[...] [s], NaN where undefined, below 0 where the second agent arrived before the first had
        left; and the time of that arrival, when PET becomes known, float64[...] [s] from the row's first step, NaN
        where PET is undefined.
    :raises InvalidInput: values that are not finite, shapes that differ, sizes or `dt` that are not positive.
    """
    for name, value in (("dt", dt), ("length", length), ("width", width), ("radius", radius)):
        if not 0.0 < value < math.inf:
            raise InvalidInput(f"{name} = {value}: expected a number above 0")
    names = ("x", "y", "heading", "ped_x", "ped_y")
    rows, _, shape = trajectories(names, (x, y, heading, ped_x, ped_y), None)
    pet, arrival = np.full((2, len(rows[0])), np.nan)
    if rows[0].shape[1] > 1:
        _pets(rows, (float(length), float(width), float(radius)), pet, arrival)
    return (pet * dt).reshape(shape)[()], (arrival * dt).reshape(shape)[()]
