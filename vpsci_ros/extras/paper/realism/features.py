"""The classifier's 46 features of an interaction, from positions smoothed over 0.9 s.

Camera noise and gait would give any simulation away at once. So positions are smoothed by lines over 0.9 s,
and what that takes away from recordings of *other* clips of the same source is added to every simulation, in place of
what it takes away from the simulation itself; recordings keep their own.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets, borrowable
from vpsci_ros.extras.paper.realism.motion import motion, rotation, smoothed, with_onset
from vpsci_ros.world.observation import STEP

_DONORS = 8  # the nearest in speed, of which one is drawn
_HARD, _GENTLE = 0.5, 0.15  # [m/s2]

Floats = NDArray[np.float64]


def with_borrowed_noise(positions: Floats, onsets: Onsets, seed: int, library: Onsets | None = None) -> Floats:
    """Return smoothed positions [n, K, 2, 30, 2] [m], plus the noise that smoothing removed from other clips.

    A residual is what smoothing takes away, along and to the left of the way of the agent. It comes from one of the
    recordings nearest in the agent's mean speed, so that a standing car does not get the shake of a moving one.

    :param onsets: those that the positions follow; library: recorded ones whose residuals are borrowed; None: the same.
    """
    library = onsets if library is None else library
    rng = np.random.default_rng(seed)
    path = with_onset(positions, onsets.start)
    known = with_onset(library.recorded[:, None], library.start)
    along = _frames(known)
    residual = np.einsum("...ij,...tj->...ti", along, known - smoothed(known))[:, 0]
    pace = _pace(known)[:, 0]
    allowed = borrowable(onsets, library)
    out, own = smoothed(path), _frames(path)
    for agent in range(2):
        gap = np.abs(_pace(path)[:, :, agent, None] - pace[None, None, :, agent])
        order = np.argsort(np.where(allowed[:, None], gap, np.inf), axis=-1)
        choices = min(_DONORS, int(allowed.sum(axis=1).min()))
        donor = np.take_along_axis(order, rng.integers(0, choices, (*order.shape[:2], 1)), axis=-1)[..., 0]
        out[:, :, agent] += np.einsum("...ji,...tj->...ti", own[:, :, agent], residual[donor, agent])
    return out[..., 1:, :]


def _pace(path: Floats) -> Floats:
    steps = np.diff(path, axis=-2)
    result: Floats = np.hypot(steps[..., 0], steps[..., 1]).mean(axis=-1) / STEP
    return result


def _frames(path: Floats) -> Floats:
    """Return the rotations [..., 2, 2] into the direction from the first position to the last."""
    way = path[..., -1, :] - path[..., 0, :]
    return rotation(np.arctan2(way[..., 1], way[..., 0]))


def features(positions: Floats, onsets: Onsets) -> dict[str, Floats]:
    """Return named features, float64[n, K] each, of positions [n, K, 2, 30, 2]; names begin with their family.

    `start_` is the same for a recording and its simulations; `vehicle_`, `pedestrian_` and `joint_` are not.
    """
    path = smoothed(with_onset(positions, onsets.start))
    of = motion(path, onsets.start, onsets.size)
    shape = positions.shape[:2]
    row = np.arange(len(onsets))
    start = onsets.start
    apart = start[:, 5:7] - start[:, 0:2]
    given = {
        "start_vehicle_speed": np.hypot(start[:, 3], start[:, 4]),
        "start_pedestrian_speed": np.hypot(start[:, 7], start[:, 8]),
        "start_distance": np.hypot(apart[:, 0], apart[:, 1]),
        "start_curvttc": onsets.interactions.curvttc[row, onsets.interactions.first],
    }
    out = {name: np.broadcast_to(value[:, None], shape).copy() for name, value in given.items()}
    gain = np.gradient(of.speed, STEP, axis=-1)
    for agent, name in enumerate(("vehicle", "pedestrian")):
        speed, change = of.speed[:, :, agent], gain[:, :, agent]
        heading = of.heading[:, :, agent]
        aside = _aside(path[:, :, agent])
        out |= {
            f"{name}_{key}": value
            for key, value in {
                "speed_mean": speed.mean(axis=-1),
                "speed_least": speed.min(axis=-1),
                "speed_most": speed.max(axis=-1),
                "speed_gained": speed[..., -1] - speed[..., 0],
                "speed_deviation": speed.std(axis=-1),
                "acceleration_first": change[..., :5].mean(axis=-1),
                "acceleration_least": change.min(axis=-1),
                "acceleration_most": change.max(axis=-1),
                "acceleration_deviation": change.std(axis=-1),
                "jerk": np.abs(np.diff(change, axis=-1)).mean(axis=-1) / STEP,
                "time_of_least_acceleration": change.argmin(axis=-1) * STEP,
                "time_gentle": (np.abs(change) < _GENTLE).mean(axis=-1),
                "time_slowing": (change < -_HARD).mean(axis=-1),
                "turned": heading[..., -1] - heading[..., 0],
                "turn_rate_most": np.abs(of.turn_rate[:, :, agent]).max(axis=-1),
                "aside_end": aside[..., -1],
                "aside_most": np.abs(aside).max(axis=-1),
            }.items()
        }
    distance = np.hypot(*np.moveaxis(path[:, :, 0] - path[:, :, 1], -1, 0))
    ttc = np.minimum(of.curvttc, 10.0)
    return out | {
        "joint_clearance_least": of.clearance.min(axis=-1),
        "joint_time_of_least_clearance": of.clearance.argmin(axis=-1) * STEP,
        "joint_clearance_end": of.clearance[..., -1],
        "joint_curvttc_least": ttc.min(axis=-1),
        "joint_time_critical": (ttc < 5.0).mean(axis=-1),
        "joint_curvttc_end": ttc[..., -1],
        "joint_approach": distance[..., 0] - distance[..., -1],
        "joint_correlation": _correlation(gain[:, :, 0], gain[:, :, 1]),
    }


def _aside(path: Floats) -> Floats:
    """Return how far [m] a path lies to the left of the line through its first 0.5 s, [..., T + 1]."""
    way = path[..., 5, :] - path[..., 0, :]
    length = np.maximum(np.hypot(way[..., 0], way[..., 1]), 1e-6)[..., None]
    offset = path - path[..., :1, :]
    result: Floats = (way[..., None, 0] * offset[..., 1] - way[..., None, 1] * offset[..., 0]) / length
    return np.where(length > 0.05, result, 0.0)


def _correlation(a: Floats, b: Floats) -> Floats:
    a, b = a - a.mean(axis=-1, keepdims=True), b - b.mean(axis=-1, keepdims=True)
    scale = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
    result: Floats = (a * b).sum(axis=-1) / np.maximum(scale, 1e-12)
    return result
