"""Path curvature of a recorded vehicle, from its positions or from its yaw rate; positive to the left, in 1/m.

Use yaw rate over speed wherever a filtered heading exists. Three positions 0.1 s apart lie so near to each other that
centimetres of noise bend the circle. With positions only, use positions further apart (`spacing`) and a larger least
bend (`collinear`); docs/curvttc.md has the effect on recordings.
"""

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.inputs import FloatLike, Floats, as_floats, broadcast, place, refuse

COLLINEAR = 1e-4  # [m] three positions bending by less than this are a line
STANDING = 0.1  # [m/s] below it yaw rate over speed says nothing about the path


def curvature_from_yaw_rate(yaw_rate: FloatLike, speed: FloatLike, *, standing: FloatLike = STANDING) -> Floats:
    """Path curvature yaw_rate / speed, float64[...] [1/m]; 0, a straight path, below the speed `standing`.

    :param yaw_rate: float[...] [rad/s], counter-clockwise.
    :param speed: float[...] [m/s], not below 0.
    :param standing: speed below which the vehicle counts as standing [m/s], above 0.
    :returns: float64[...] [1/m].
    :raises InvalidInput: values that are not finite, a negative speed, a `standing` that is not above 0, shapes that
        do not broadcast.
    """
    names, given = ("yaw_rate", "speed", "standing"), (yaw_rate, speed, standing)
    (rate, pace, least), shape = broadcast(names, given)
    if not (np.isfinite(rate + pace + least).all() and (pace >= 0.0).all() and (least > 0.0).all()):
        refuse(names, given, positive=("standing",), not_negative=("speed",))
    result: Floats = np.where(pace < least, 0.0, rate / np.maximum(pace, least)).reshape(shape)[()]
    return result


def curvature_from_positions(x: FloatLike, y: FloatLike, *, spacing: int = 1, collinear: float = COLLINEAR) -> Floats:
    """Curvature [1/m] of the circle through the last three positions, at each step of a trajectory, float64[..., T].

    :param x, y: float[..., T] positions [m] in the order of time, T >= 1.
    :param spacing: steps between the three positions, at least 1.
    :param collinear: the three positions count as a line (curvature 0) where the middle one lies within this distance
        [m] of the chord of the other two.
    :returns: float64[..., T] [1/m]. Step k uses the positions k - 2 spacing, k - spacing and k; the first 2 spacing
        steps, which have fewer than three, are a line.
    :raises InvalidInput: values that are not finite, arrays of different shapes or without a time axis, a spacing below
        1, a `collinear` that is negative or not finite.
    """
    xs, ys = as_floats("x", x), as_floats("y", y)
    if xs.ndim == 0 or xs.shape != ys.shape:
        raise InvalidInput(f"x, y: expected two arrays [..., T] of one shape, got {xs.shape} and {ys.shape}")
    for name, array in (("x", xs), ("y", ys)):
        bad = ~np.isfinite(array)
        if bad.any():
            raise InvalidInput(f"{name}{place(bad)} = {array[bad][0]}: expected a finite number")
    if not 0.0 <= collinear < np.inf:
        raise InvalidInput(f"collinear = {collinear}: expected a distance [m] not below 0")
    if spacing < 1:
        raise InvalidInput(f"spacing = {spacing}: expected at least 1 step")
    result = np.zeros(xs.shape)
    if xs.shape[-1] <= 2 * spacing:
        return result
    first, middle, last = slice(None, -2 * spacing), slice(spacing, -spacing), slice(2 * spacing, None)
    ax, ay = xs[..., middle] - xs[..., first], ys[..., middle] - ys[..., first]
    bx, by = xs[..., last] - xs[..., middle], ys[..., last] - ys[..., middle]
    chord = np.hypot(ax + bx, ay + by)
    cross = ax * by - ay * bx  # twice the triangle's area: chord times the distance of the middle position from it
    bent = np.abs(cross) > collinear * chord
    sides = np.hypot(ax, ay) * np.hypot(bx, by) * chord
    np.divide(2.0 * cross, sides, out=result[..., last], where=bent & (sides > 0.0))
    return result
