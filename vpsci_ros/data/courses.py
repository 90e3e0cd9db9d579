"""Velocities, yaw rates and directions of motion on the 0.1 s grid, by recorded positions and headings."""

import math

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
STANDING = 1e-3  # [m/s] below which a velocity has no direction
MOVING = 1.0  # [m/s] above it the direction of motion says what the heading must be
DRIVEN = 0.5  # [m] that a vehicle without a heading drives before its heading changes
_LONG = 0.3  # [m/s] a vehicle that takes longer than that for `DRIVEN` has stood
_YAW_WINDOW = 4  # steps back over which the causal yaw rate is a slope


def slopes(values: Floats, span: int) -> Floats:
    """Return the least-squares slope [1/s] of every `span` + 1 neighbouring values on the 0.1 s grid.

    :param values: float64[T], more than `span`.
    :returns: float64[T - span], the first of the values 0 to `span`.
    """
    offsets = np.arange(span + 1) - 0.5 * span
    return np.correlate(values, offsets / (STEP * float(offsets @ offsets)), "valid")


def slope(values: Floats) -> Floats:
    """Rate of change [1/s] of values on the grid, by the least-squares line through five values.

    A line over 0.4 s keeps the yaw rate of a turn and leaves out the jitter of single frames, which would bend the
    predicted path to one side and the other and report near misses one step long. The ends have the slope of the
    nearest full window. A track of 3 or 4 values has a window of 3, a track of 2 values a window of 2.
    """
    n = len(values)
    if n < 2:
        return np.zeros(n)
    half = min(2, (n - 1) // 2)
    inner = slopes(values, max(2 * half, 1))
    return np.pad(inner, (half, n - len(inner) - half), "edge")


def trailing_slope(values: Floats) -> Floats:
    """Return the slope [1/s] of values on the 0.1 s grid at each step: a least-squares line through the last steps.

    :param values: float64[T]; the line spans four steps back, fewer where there are fewer.
    """
    out = np.zeros(len(values))
    for span in range(1, min(_YAW_WINDOW, len(values) - 1) + 1):
        out[span:] = slopes(values, span)
    return out


def filled(values: Floats) -> Floats:
    """Return values[..., T], each NaN replaced by the last number before or else the first after; 0 if all are NaN."""
    known = ~np.isnan(values)
    if known.all():
        return values
    before = np.maximum.accumulate(np.where(known, np.arange(values.shape[-1]), -1), axis=-1)
    first = np.where(known.any(axis=-1), known.argmax(axis=-1), 0)[..., None]
    found: Floats = np.take_along_axis(values, np.where(before < 0, first, before), axis=-1)
    return np.where(np.isnan(found), 0.0, found)


def headings(vx: Floats, vy: Floats, standing: float = STANDING) -> Floats:
    """Return the unwrapped direction of motion, float64[..., T] [rad]; while standing, the last known direction.

    :param standing: speed [m/s] up to which a velocity has no direction; NaN where it never has one.
    """
    return directions(np.arctan2(vy, vx), np.hypot(vx, vy) > standing)


def directions(angle: Floats, known: NDArray[np.bool_]) -> Floats:
    """Return unwrapped angles, float64[..., T] [rad]; an unknown angle is the last known one, or else the first known.

    :param known: bool[..., T]; NaN where none is.
    """
    found = np.unwrap(filled(np.where(known, angle, np.nan)), axis=-1)
    return np.where(known.any(axis=-1, keepdims=True), found, np.nan)


def courses(x: Floats, y: Floats, vx: Floats, vy: Floats) -> Floats:
    """Return directions of motion [rad], unwrapped, float64[T]; NaN where the vehicle never drives `DRIVEN`.

    Above `MOVING` the velocity says the direction, below it the last `DRIVEN` metres of the way. Until a vehicle has
    driven so far it keeps its heading, since the velocity of a standing vehicle is noise. Before its first direction it
    has this one.
    """
    anchors = _anchors(x, y)
    if len(anchors) < 2:
        return np.full(len(x), np.nan)
    begins, ends = anchors[:-1], anchors[1:]
    took = STEP * np.diff([*anchors, len(x) - 1])
    brisk = took[np.searchsorted(ends, np.arange(len(x)), side="right")] < DRIVEN / _LONG
    direction = np.arctan2(vy, vx)
    known = (np.hypot(vx, vy) > MOVING) & brisk
    late = ~known[ends]
    chord = np.arctan2(y[ends] - y[begins], x[ends] - x[begins])
    direction[ends[late]] = chord[late]
    known[ends] = True
    return directions(direction, known)


def _anchors(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Return the first step, and each step that is at least `DRIVEN` [m] away from the place of the one before."""
    found = [0]
    ax, ay = x[0], y[0]
    for step, (px, py) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        if math.hypot(px - ax, py - ay) >= DRIVEN:
            found.append(step)
            ax, ay = px, py
    return np.array(found, np.int64)
