"""Simulators without learning, the controls: mean turn, residuals of similar onsets.

Each answers onsets with positions float64[n, K, 2, 30, 2] [m] in the map frame.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets, borrowable
from vpsci_ros.extras.paper.realism.motion import rotation
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
CONTROL = "constant_velocity_tracked"
TURN = "constant_turn"
CONTROLS = ("recorded", CONTROL, TURN, "social_force", "residual_sampler")
NEAREST = 32  # onsets of other clips whose residuals are borrowed


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


def residual_sampler(onsets: Onsets, library: Onsets, middle: Floats, library_middle: Floats) -> Floats:
    """Return roll-outs [n, K, 2, 30, 2] [m]: `middle` plus residuals of the K most similar onsets of other clips.

    A residual is the recording less its own middle trajectory: the vehicle's forward and left of its heading, the
    pedestrian's in the same frame. No residual comes from the own clip, nor of another source where the own one
    has others. K is 32, or as many as there are.

    :param middle: float64[n, 1, 2, 30, 2]; library_middle: the same of the library's onsets.
    """
    here, there = _similarity(onsets), _similarity(library)
    deviation = there.std(axis=0) + 1e-9
    apart = np.linalg.norm((here[:, None] - there[None]) / deviation, axis=2)
    apart[~borrowable(onsets, library)] = np.inf
    count = min(NEAREST, int(np.isfinite(apart).sum(axis=1).min()))
    nearest = np.argsort(apart, axis=1)[:, :count]
    turn = rotation(library.start[:, 2])
    residual = np.einsum("nij,natj->nati", turn, library.recorded - library_middle[:, 0])
    back = rotation(onsets.start[:, 2])
    chosen = residual[nearest]
    chosen[..., 1] *= (_side(onsets)[:, None] * _side(library)[nearest])[:, :, None, None]  # mirrored where they differ
    result: Floats = middle + np.einsum("nji,nkatj->nkati", back, chosen)
    return result


def _similarity(onsets: Onsets) -> Floats:
    """Return the quantities by which onsets are compared, float64[n, 6], mirrored so that the pedestrian is left."""
    start = onsets.start
    turn = rotation(start[:, 2])
    place = np.einsum("nij,nj->ni", turn, start[:, 5:7] - start[:, 0:2])
    walk = np.einsum("nij,nj->ni", turn, start[:, 7:9])
    speed, pace = np.hypot(start[:, 3], start[:, 4]), np.hypot(walk[:, 0], walk[:, 1])
    side = _side(onsets)
    return np.stack([speed, pace, place[:, 0], place[:, 1] * side, walk[:, 0], walk[:, 1] * side], axis=1)


def _side(onsets: Onsets) -> Floats:
    """Return 1 where the pedestrian is to the left of the vehicle at the onset, else -1, float64[n]."""
    start = onsets.start
    east, north = start[:, 5] - start[:, 0], start[:, 6] - start[:, 1]
    return np.where(np.cos(start[:, 2]) * north - np.sin(start[:, 2]) * east < 0.0, -1.0, 1.0)
