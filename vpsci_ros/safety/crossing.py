"""The older form of CurvTTC: the first time at which both agents occupy the point where their paths cross."""

import math

from vpsci_ros.safety.compiled import kernel


@kernel
def overlap_start(qx, qy, ux, uy, speed, curvature, occupied, horizon):  # type: ignore[no-untyped-def]
    """First time [s] at which both agents occupy the point where their paths cross; infinity: not within `horizon` [s].

    In the vehicle's heading frame: the pedestrian's centre (qx, qy) [m] relative to the vehicle's and its velocity
    (ux, uy) [m/s]. Each occupies the crossing point while its centre is within `occupied` [m] of it along its own path.
    The vehicle's path is an arc of at most 90 degrees, the pedestrian's a half-line. Standing agents have no path.
    """
    pace = math.hypot(ux, uy)
    if speed <= 0.0 or pace <= 0.0:
        return math.inf
    ux, uy = ux / pace, uy / pace
    # The crossing point q + u s lies on the vehicle's circle: k |q + u s|^2 = 2 (q + u s)_y; a line when k = 0.
    a = curvature * 1.0
    b = curvature * (qx * ux + qy * uy) - uy
    c = curvature * (qx * qx + qy * qy) - 2.0 * qy
    root = b * b - a * c
    if root < 0.0:
        return math.inf
    # the two roots of a s^2 + 2 b s + c, each without cancellation
    both = -(b + math.copysign(math.sqrt(root), b))
    first = c / both if both != 0.0 else math.inf
    second = both / a if a != 0.0 else math.inf
    start = min(
        _overlap(qx, qy, ux, uy, pace, first, speed, curvature, occupied),
        _overlap(qx, qy, ux, uy, pace, second, speed, curvature, occupied),
    )
    return start if start <= horizon else math.inf


@kernel
def _overlap(qx, qy, ux, uy, pace, walked, speed, curvature, occupied):  # type: ignore[no-untyped-def]
    """Start [s] of the common occupancy of the crossing point that the pedestrian reaches after `walked` metres."""
    if not 0.0 <= walked < math.inf:
        return math.inf
    cx, cy = qx + ux * walked, qy + uy * walked
    if cx < 0.0:  # behind the vehicle, or beyond the 90 degrees of its arc
        return math.inf
    chord = math.hypot(cx, cy)
    turn = math.asin(min(0.5 * abs(curvature) * chord, 1.0))  # half the angle turned on the way to the crossing point
    if turn > 0.25 * math.pi * (1.0 + 1e-12):
        return math.inf
    driven = 2.0 * turn / abs(curvature) if turn > 1e-9 else chord
    start = max((driven - occupied) / speed, (walked - occupied) / pace, 0.0)
    return start if start <= min((driven + occupied) / speed, (walked + occupied) / pace) else math.inf
