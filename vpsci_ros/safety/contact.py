"""First contact of a turning rectangle and a walking disc: conservative advancement with a second-order bound.

`first_contact` predicts from one instant; `contact_in_step` looks back at a step from its two ends.

In the vehicle's own frame the rectangle stands still and the pedestrian's centre p moves with relative velocity w.
The free distance c(t) = distance(p(t), rectangle) - radius stays positive until contact. From time t on,

* the distance to a convex set is convex, so along the tangent p + w h it is at least c + c' h, with c' = n . w and n
  the unit vector from the nearest point of the rectangle to p;
* the true path leaves that tangent by at most A h^2 / 2, where A bounds |p''|, and the distance changes by at most
  as much:

      c(t + h) >= c + c' h - A h^2 / 2.

The step h = 2 c / (sqrt(c'^2 + 2 A c) - c') is the positive root of the right side: no contact can lie within it.
Near contact the step is Newton's, so the iteration converges quadratically from below. Only steps that `STEP_FLOOR`
lengthens may pass a contact, one shorter than the step. With both agents on straight lines A is 0.

With yaw rate W = v k, J the quarter turn and g(t) the way from the turning centre to the pedestrian, whose velocity
is u, |p''| = |2 W J u + W^2 g(t)|: the norm of a function linear in t, hence convex, hence largest at an end of the
interval that is searched. An accelerating vehicle adds |a k g(t)|.
"""

import math

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, gap
from vpsci_ros.safety.inputs import FloatLike, as_floats

TOUCH = 1e-9  # [m] footprints this near to each other count as touching
STEP_FLOOR = 1e-9  # [s] the n-th step is at least n^2 times as long: never more than 3,200 of them in 10 s
QUARTER = 0.5 * math.pi  # [rad] the predicted arc is at most as long
_MARGIN = 1e-6  # [m] the swept ring is drawn this much wider, against rounding


@kernel
def first_contact(qx, qy, ux, uy, speed, curvature, half_length, half_width, radius, horizon):  # type: ignore[no-untyped-def]
    """Time [s] of the first contact, 0 when touching now; infinity: none within `horizon` [s] and 90 degrees of arc.

    Everything is in the vehicle's heading frame at time 0 (forward, left): the pedestrian's centre (qx, qy) [m]
    relative to the rectangle's, and its ground velocity (ux, uy) [m/s].
    """
    dx, dy = abs(qx) - half_length, abs(qy) - half_width
    near = radius + TOUCH
    if dx <= near and dy <= near and (dx <= 0.0 or dy <= 0.0 or dx * dx + dy * dy <= near * near):
        return 0.0
    yaw_rate = speed * curvature
    turn = abs(yaw_rate)
    end = QUARTER / turn if turn * horizon > QUARTER else horizon
    begin, end = _within_swept_ring(qx, qy, ux, uy, curvature, half_length, half_width, radius + _MARGIN, end)
    if begin > end:
        return math.inf
    # A at both ends; yaw_rate g = (yaw_rate q_x, yaw_rate q_y - v) stays finite as the curvature goes to zero
    px, py = qx + ux * begin, qy + uy * begin
    bound = math.hypot(yaw_rate * px - 2.0 * uy, yaw_rate * py - speed + 2.0 * ux)
    px, py = qx + ux * end, qy + uy * end
    bound = turn * max(bound, math.hypot(yaw_rate * px - 2.0 * uy, yaw_rate * py - speed + 2.0 * ux))
    return advance(qx, qy, ux, uy, speed, 0.0, curvature, half_length, half_width, radius, begin, end, bound)


@kernel
def first_contact_accelerating(  # type: ignore[no-untyped-def]
    qx, qy, ux, uy, speed, acceleration, curvature, half_length, half_width, radius, horizon
):
    """`first_contact` [s] with a vehicle at constant acceleration [m/s2] along its arc; once it stops, it stays."""
    if acceleration == 0.0 or (speed == 0.0 and acceleration < 0.0):
        return first_contact(qx, qy, ux, uy, speed, curvature, half_length, half_width, radius, horizon)
    stop = -speed / acceleration if acceleration < 0.0 else math.inf
    drive = min(horizon, stop)
    arc = math.inf
    k = abs(curvature)
    if k * drive * (speed + 0.5 * acceleration * drive) > QUARTER:
        arc = 2.0 * QUARTER / k
        arc = arc / (speed + math.sqrt(speed * speed + acceleration * arc))
        drive = min(drive, arc)
    begin, end = _within_swept_ring(qx, qy, ux, uy, curvature, half_length, half_width, radius + _MARGIN, drive)
    if begin <= end:
        fastest = max(speed, speed + acceleration * drive)
        away = max(
            math.hypot(curvature * qx, curvature * qy - 1.0),
            math.hypot(curvature * (qx + ux * end), curvature * (qy + uy * end) - 1.0),
        )
        bound = 2.0 * k * fastest * math.hypot(ux, uy) + (k * fastest * fastest + abs(acceleration)) * away
        contact = advance(
            qx, qy, ux, uy, speed, acceleration, curvature, half_length, half_width, radius, begin, end, bound
        )
        if contact < math.inf:
            return contact
    if drive >= horizon or drive >= arc:
        return math.inf
    driven = 0.5 * speed * stop  # the vehicle stands from here on; does the pedestrian walk into it?
    half = 0.5 * curvature * driven
    sin, cos = math.sin(half), math.cos(half)
    chord = driven if abs(half) < 1e-9 else driven * (sin / half)
    c, s = 1.0 - 2.0 * sin * sin, 2.0 * sin * cos
    gx, gy = qx + ux * stop, qy + uy * stop
    forward, left = c * gx + s * gy - chord * cos, c * gy - s * gx + chord * sin
    ux, uy = c * ux + s * uy, c * uy - s * ux
    return stop + first_contact(forward, left, ux, uy, 0.0, 0.0, half_length, half_width, radius, horizon - stop)


@kernel
def contact_in_step(before, after, length, width, radius):  # type: ignore[no-untyped-def]
    """Return the part of a step, 0 to 1, after which rectangle and disc first touch; infinity: not in this step.

    In the vehicle's frame the disc moves on a straight line from its place before the step to its place after it. The
    true path leaves this line by at most |p''| step^2 / 8. With the limits of the simulated car this is below 1 cm in a
    step of 0.05 s; it is 0 without turn and acceleration.

    :param before, after: x, y [m], heading [rad] of the rectangle, x, y [m] of the disc's centre at the step's ends.
    """
    half_length, half_width = 0.5 * length, 0.5 * width
    x, y = _seen_from(before)
    end_x, end_y = _seen_from(after)
    part = first_contact(x, y, end_x - x, end_y - y, 0.0, 0.0, half_length, half_width, radius, 1.0)
    return 1.0 if part > 1.0 and gap(end_x, end_y, half_length, half_width) - radius <= 0.0 else part


@kernel
def _seen_from(place):  # type: ignore[no-untyped-def]
    cos, sin = math.cos(place[2]), math.sin(place[2])
    dx, dy = place[3] - place[0], place[4] - place[1]
    return cos * dx + sin * dy, cos * dy - sin * dx


def contact_step(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    *,
    length: float = VEHICLE_LENGTH,
    width: float = VEHICLE_WIDTH,
    radius: float = PEDESTRIAN_RADIUS,
) -> float:
    """Return when vehicle and pedestrian first touch, at a step or between two, in steps; infinity: never.

    :param x, y, heading: float[T] [m], [rad] of the rectangle at each step.
    :param ped_x, ped_y: float[T] [m] of the disc's centre.
    :param length, width, radius: sizes [m].
    :raises InvalidInput: values that are not finite, arrays of different lengths or without a step.
    """
    names = ("x", "y", "heading", "ped_x", "ped_y")
    arrays = [as_floats(name, value) for name, value in zip(names, (x, y, heading, ped_x, ped_y), strict=True)]
    if len({array.shape for array in arrays}) > 1 or arrays[0].ndim != 1 or not arrays[0].size:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True))
        raise InvalidInput(f"expected arrays of one value a step, all of one length, got {shapes}")
    rows = np.stack(arrays, axis=1)
    if not np.isfinite(rows).all():
        step, column = np.argwhere(~np.isfinite(rows))[0]
        raise InvalidInput(f"{names[column]}: expected finite numbers, got {rows[step, column]} at step {step}")
    return float(_contact_step(rows, length, width, radius))


@kernel
def _contact_step(rows, length, width, radius):  # type: ignore[no-untyped-def]
    if len(rows) == 1:
        return contact_in_step(rows[0], rows[0], length, width, radius)
    for k in range(len(rows) - 1):
        part = contact_in_step(rows[k], rows[k + 1], length, width, radius)
        if part <= 1.0:
            return k + part
    return math.inf


@kernel
def advance(qx, qy, ux, uy, speed, acceleration, curvature, half_length, half_width, radius, begin, end, bound):  # type: ignore[no-untyped-def]
    """Time [s] of the first contact from `begin` to `end` [s], or infinity; `bound` [m/s2] is the module's A."""
    t, count = begin, 0.0
    while True:
        # the pedestrian in the vehicle's frame at time t; the vehicle has moved along a chord and turned
        driven = t * (speed + 0.5 * acceleration * t)
        pace = speed + acceleration * t
        half = 0.5 * curvature * driven
        sin, cos = math.sin(half), math.cos(half)
        chord = driven if abs(half) < 1e-9 else driven * (sin / half)
        c, s = 1.0 - 2.0 * sin * sin, 2.0 * sin * cos
        gx, gy = qx + ux * t, qy + uy * t
        forward = c * gx + s * gy - chord * cos
        left = c * gy - s * gx + chord * sin
        w_forward = c * ux + s * uy - pace * (1.0 - curvature * left)
        w_left = c * uy - s * ux - pace * curvature * forward
        dx, dy = abs(forward) - half_length, abs(left) - half_width
        if forward < 0.0:
            w_forward = -w_forward
        if left < 0.0:
            w_left = -w_left
        if dx > 0.0 and dy > 0.0:
            distance = math.sqrt(dx * dx + dy * dy)
            rate = (dx * w_forward + dy * w_left) / distance
        elif dx > dy:
            distance, rate = dx, w_forward
        else:
            distance, rate = dy, w_left
        free = distance - radius
        if free <= TOUCH:
            return t
        step = 2.0 * free / (math.sqrt(rate * rate + 2.0 * bound * free) - rate)
        count += 1.0
        t += max(step, STEP_FLOOR * count * count)
        if not t <= end:
            return math.inf


@kernel
def _within_swept_ring(qx, qy, ux, uy, curvature, half_length, half_width, radius, end):  # type: ignore[no-untyped-def]
    """Return the part of [0, end] in which contact is possible at all, empty (begin > end) when there is none.

    The rectangle turning about its turning centre sweeps a ring, on a straight path a band. Contact needs the
    pedestrian's centre within `radius` of it. Distances to the turning centre are compared as
    |k| (|g|^2 - 1/k^2), which stays finite as the curvature k goes to zero and the ring becomes the band.
    """
    k = abs(curvature)
    side = 1.0 if curvature >= 0.0 else -1.0
    a = k * (ux * ux + uy * uy)
    b = k * (qx * ux + qy * uy) - side * uy
    now = k * (qx * qx + qy * qy) - 2.0 * side * qy
    corner = math.sqrt((1.0 + k * half_width) ** 2 + (k * half_length) ** 2)
    outer = 2.0 * half_width + k * (half_width * half_width + half_length * half_length)
    outer += radius * (2.0 * corner + k * radius)
    begin = 0.0
    c = now - outer
    root = b * b - a * c
    if c > 0.0:  # outside the ring now: when does the pedestrian enter?
        if b >= 0.0 or root < 0.0:
            return 1.0, 0.0
        begin = c / (math.sqrt(root) - b)
        if begin > end:
            return 1.0, 0.0
        leave = (math.sqrt(root) - b) / a
    else:
        leave = -c / (b + math.sqrt(root)) if b > 0.0 else (math.sqrt(root) - b) / a
    end = min(end, leave)
    reach = half_width + radius
    if k * reach < 1.0:
        c = now + reach * (2.0 - k * reach)
        if c < 0.0:  # inside the ring's hole now: when does the pedestrian leave it?
            root = math.sqrt(b * b - a * c)
            leave = -c / (b + root) if b > 0.0 else (root - b) / a
            if not leave <= end:
                return 1.0, 0.0
            begin = max(begin, leave)
    return begin, end
