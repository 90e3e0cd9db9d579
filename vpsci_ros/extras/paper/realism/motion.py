"""Motion from positions: speeds, accelerations, headings, turns, clearance, CurvTTC.

Recordings and simulations go through the same code, from positions alone, so that no difference between published
speeds and positions is taken for one of behaviour. Give `smoothed` positions: the second differences of recorded
ones are mostly noise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import clearance, curvature_from_yaw_rate, curvttc
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
MOVING = 0.3  # [m/s] below it a position's change says nothing of a direction: the one before stays
_TURN_WINDOW = 4  # steps back over which a turn is measured


class Motion(NamedTuple):
    """Quantities of trajectories [..., T], derived from positions at T + 1 steps."""

    speed: Floats  # [..., 2, T] [m/s] of vehicle and pedestrian, from each step to the next
    acceleration: Floats  # [..., 2, T - 1] [m/s2] change of that speed
    heading: Floats  # [..., 2, T] [rad] direction of motion, unwrapped; the last one where an agent stands
    turn_rate: Floats  # [..., 2, T] [rad/s] slope of the heading over the last 0.4 s
    aside: Floats  # [..., T] [m] of the pedestrian, to the left of the line of its velocity at the onset
    clearance: Floats  # [..., T] [m] between the footprints
    curvttc: Floats  # [..., T] [s]


def fitted(steps: int, back: int, ahead: int, *, slope: bool = False) -> Floats:
    """Return the matrix [steps, steps] that replaces each value by that of a line fitted to the values around it.

    The window runs from `back` steps before to `ahead` after; near an end it is moved inside (`ahead` > 0) or cut short
    (looking back alone). With `slope` the matrix returns the line's slope per second instead.
    """
    matrix = np.zeros((steps, steps))
    for at in range(steps):
        if ahead:
            low = min(max(at - back, 0), max(steps - 1 - back - ahead, 0))
            window = np.arange(low, min(low + back + ahead + 1, steps))
        else:
            window = np.arange(max(at - back, 0), at + 1)
        offset = window - window.mean()
        spread = float(offset @ offset)
        if slope:
            matrix[at, window] = offset / (spread * STEP) if spread else 0.0
        else:
            matrix[at, window] = 1.0 / len(window) + (offset * (at - window.mean()) / spread if spread else 0.0)
    return matrix


def smoothed(path: Floats) -> Floats:
    """Return positions [..., T, 2], each on a line fitted to the nine around it (0.9 s), or the first or last nine."""
    result: Floats = np.einsum("st,...tc->...sc", fitted(path.shape[-2], 4, 4), path)
    return result


def rotation(angle: Floats) -> Floats:
    """Return the matrices [..., 2, 2] that turn map vectors into (forward, left) of `angle` [...] [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)


def with_onset(positions: Floats, start: Floats) -> Floats:
    """Return positions [n, ..., 2, T, 2] with the positions at the onset in front, [n, ..., 2, T + 1, 2].

    :param start: float64[n, 9], rows as in `Interactions.motion`.
    """
    first = np.stack([start[:, 0:2], start[:, 5:7]], axis=1)[:, :, None]
    for _ in range(positions.ndim - 4):
        first = first[:, None]
    return np.concatenate([np.broadcast_to(first, (*positions.shape[:-2], 1, 2)), positions], axis=-2)


def motion(path: Floats, start: Floats, size: Floats) -> Motion:
    """Return the motion of positions that begin at the onset, float64[n, K, 2, T + 1, 2] [m].

    :param start: float64[n, 9], the onset, rows as in `Interactions.motion`.
    :param size: float64[n, 2], length and width of the vehicle [m].
    """
    step = np.diff(path, axis=-2) / STEP
    speed = np.hypot(step[..., 0], step[..., 1])
    walking, heading = np.arctan2(start[:, 8], start[:, 7]), directions(path, start)
    turn_rate = heading @ fitted(heading.shape[-1], _TURN_WINDOW, 0, slope=True).T
    offset = path[..., 1, 1:, :] - start[:, None, None, 5:7]
    aside = np.cos(walking)[:, None, None] * offset[..., 1] - np.sin(walking)[:, None, None] * offset[..., 0]
    vehicle, pedestrian = path[..., 0, 1:, :], path[..., 1, 1:, :]
    place = (vehicle[..., 0], vehicle[..., 1], heading[..., 0, :])
    length, width = (np.broadcast_to(size[:, None, None, i], aside.shape) for i in (0, 1))
    curvature = curvature_from_yaw_rate(turn_rate[..., 0, :], speed[..., 0, :], standing=MOVING)
    ttc = curvttc(
        *(part.ravel() for part in (*place, speed[..., 0, :], curvature, pedestrian[..., 0], pedestrian[..., 1])),
        *(step[..., 1, :, i].ravel() for i in (0, 1)),
        length=length.ravel(),
        width=width.ravel(),
    )
    return Motion(
        speed,
        np.diff(speed, axis=-1) / STEP,
        heading,
        turn_rate,
        np.where((np.hypot(start[:, 7], start[:, 8]) > MOVING)[:, None, None], aside, 0.0),
        clearance(*place, pedestrian[..., 0], pedestrian[..., 1], length=length, width=width),
        ttc.reshape(aside.shape),
    )


def directions(path: Floats, start: Floats, moving: float = MOVING) -> Floats:
    """Return the direction of each step, float64[n, K, 2, T] [rad], unwrapped; where an agent stands, the one before.

    Parameters are those of `motion`; a slower agent than `moving` [m/s] stands.
    """
    step = np.diff(path, axis=-2) / STEP
    first = np.stack([start[:, 2], np.arctan2(start[:, 8], start[:, 7])], axis=1)[:, None]
    first = np.broadcast_to(first, step.shape[:-2])[..., None]
    direction = np.arctan2(step[..., 1], step[..., 0])
    count = np.arange(step.shape[-2])
    last = np.maximum.accumulate(np.where(np.hypot(step[..., 0], step[..., 1]) > moving, count, -1), axis=-1)
    held = np.take_along_axis(direction, np.maximum(last, 0), axis=-1)
    held = np.where(last < 0, first, held)
    return np.unwrap(np.concatenate([first, held], axis=-1), axis=-1)[..., 1:]
