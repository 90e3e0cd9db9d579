"""The names of the controls, and the mean turn: positions float64[n, K, 2, 30, 2] [m] in the map frame."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets, borrowable
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
CONTROL, FADING, SAMPLER = "constant_velocity_tracked", "fading_acceleration", "residual_sampler"
TURN, FORCE = "constant_turn", "social_force"
APART = "residual_sampler_apart"  # without donors that lead to contact
CONTROLS = ("recorded", CONTROL, TURN, FADING, FORCE, SAMPLER, APART)


def constant_turn(onsets: Onsets, library: Onsets, middle: Floats) -> Floats:
    """Return roll-outs [n, 1, 2, 30, 2] [m] in which the vehicle has other clips' mean curvature and acceleration.

    Both are means over the 3 s after the library's onsets, of those in `borrowable`: one bend, one deceleration for all
    of a source. The pedestrian keeps its velocity.

    :param middle: constant velocity, float64[n, 1, 2, 30, 2], whose beginning and pedestrian this has.
    """
    moved, row, first = library.interactions.motion, np.arange(len(library)), library.interactions.first
    begin, end = moved[row, first], moved[row, first + STEPS]
    places = np.concatenate([begin[:, None, :2], library.recorded[:, 0]], axis=1)
    way = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
    gain = (np.hypot(end[:, 3], end[:, 4]) - np.hypot(begin[:, 3], begin[:, 4])) / (STEPS * STEP)
    others = borrowable(onsets, library).astype(np.float64)
    curvature = (others @ (end[:, 2] - begin[:, 2])) / np.maximum(others @ way, 1e-9)
    mean_gain = (others @ gain) / others.sum(axis=1)
    step = middle[:, 0, 0, 0] - onsets.start[:, :2]
    speed = np.hypot(step[:, 0], step[:, 1]) / STEP
    speeds = np.maximum(speed[:, None] + mean_gain[:, None] * STEP * (np.arange(STEPS) + 0.5), 0.0)
    heading = np.where(speed > 0.1, np.arctan2(step[:, 1], step[:, 0]), onsets.start[:, 2])
    angle = heading[:, None] + curvature[:, None] * STEP * (np.cumsum(speeds, axis=1) - 0.5 * speeds)
    out = middle.copy()
    driven = STEP * speeds[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    out[:, 0, 0] = onsets.start[:, None, :2] + np.cumsum(driven, axis=1)
    return out
