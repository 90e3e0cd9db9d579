"""Which simulated episodes make it into the dataset: the four conditions of section 3.3 of the paper.

Every condition is checked for every episode, on the numbers as they are stored, and every rejection has a reason that
is counted. The third condition also drops each collision before the 100th frame, since a collision ends its episode;
how many is in the counts. An episode with several pedestrians is classified by one of them: it is kept if a pair is.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import float64
from numpy.typing import NDArray

from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.parameters import parameter
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.compiled import kernel

KEPT = 0
REASONS = (
    "kept",
    "not critical",  # (1) CurvTTC never below 5 s
    "velocities missing",  # (2) ten frames in a row or more without them
    "too short",  # (3) fewer than 100 frames
    "vehicle hardly moved",  # (4) 10 m or less from the first to the last frame
    "pedestrian hardly moved",  # (4) 4 m or less
)
_VEHICLE = QUANTITIES.index("position_x_av")  # then y and the velocity
_PEDESTRIAN = QUANTITIES.index("position_x_ped")
_TTC = QUANTITIES.index("CurvTTC")


@dataclass(frozen=True)
class FilterConfig:
    """The bounds of the four conditions; the defaults are the paper's."""

    critical_ttc: float = parameter(
        CRITICAL_TTC, "keep episodes whose least CurvTTC is below", unit="s", low=0.0, high=60.0
    )
    missing_frames: int = parameter(
        10, "drop episodes with this many frames in a row without velocities", low=1, high=1000
    )
    least_frames: int = parameter(100, "keep episodes of at least this many frames", low=1, high=100_000)
    vehicle_distance: float = parameter(
        10.0,
        "keep episodes whose last vehicle position is further than this from the first",
        unit="m",
        low=0.0,
        high=1e4,
    )
    pedestrian_distance: float = parameter(4.0, "likewise for the pedestrian", unit="m", low=0.0, high=1e4)


RECORD = np.dtype(
    [
        ("scenario", np.uint8),
        ("count", np.int64),  # number within the scenario
        ("outcome", np.uint8),  # of `vpsci_ros.world.state`
        ("failed", np.bool_, len(REASONS) - 1),  # the conditions `REASONS[1:]`, each on its own
        ("reason", np.uint8),  # index into `REASONS` of the first that fails in the paper's order, `KEPT` for none
        ("frames", np.int64),
        ("pedestrians", np.int64),
        ("rows", np.int64),  # of the episode that are stored: a row a frame and pedestrian, or none
        ("least_curvttc", np.float32),  # [s] of all pairs
        ("vehicle_path", np.float64),  # [m] length of the trajectory, of the pair that decides
        ("pedestrian_path", np.float64),  # [m]
    ]
)
"""What the filters say of an episode that ended."""


def apply_filters(batch: EpisodeBatch, config: FilterConfig) -> NDArray[np.void]:
    """Apply the four conditions to every episode of a batch, and return RECORD[m].

    Of the pairs of an episode that one decides which is kept, or, where none or several are, has the least CurvTTC.
    """
    pairs, first = _judge_pairs(batch, config), batch.first
    if len(first) == len(batch):
        return pairs
    of_episode = np.repeat(np.arange(len(first)), batch.pedestrians)
    order = np.lexsort((pairs["least_curvttc"], pairs["reason"] != KEPT, of_episode))
    records = pairs[order[first]]
    records["pedestrians"] = batch.pedestrians
    records["least_curvttc"] = np.minimum.reduceat(pairs["least_curvttc"], first)
    return records


def _judge_pairs(batch: EpisodeBatch, config: FilterConfig) -> NDArray[np.void]:
    """Return RECORD[n] of each pair as if it were alone."""
    pairs = np.zeros(len(batch), RECORD)
    pairs["scenario"], pairs["count"], pairs["outcome"] = batch.scenario, batch.episode, batch.outcome
    pairs["frames"], pairs["pedestrians"] = batch.frames, 1
    measures = np.zeros((len(batch), 6))
    _measure(batch.values, batch.frames, measures)
    least, missing, *paths, vehicle_moved, pedestrian_moved = measures.T
    pairs["least_curvttc"], (pairs["vehicle_path"], pairs["pedestrian_path"]) = least, paths
    pairs["failed"] = np.column_stack(
        [
            ~(pairs["least_curvttc"] < config.critical_ttc),
            missing >= config.missing_frames,
            batch.frames < config.least_frames,
            vehicle_moved <= config.vehicle_distance,
            pedestrian_moved <= config.pedestrian_distance,
        ]
    )
    pairs["reason"] = np.where(pairs["failed"].any(axis=1), pairs["failed"].argmax(axis=1) + 1, KEPT)
    return pairs


@kernel
def _measure(values, frames, out):  # type: ignore[no-untyped-def]
    """Measure episodes, float32[n, F, 10], of which the first `frames` int64[n] count.

    :param out: float64[n, 6]: least CurvTTC [s]; the longest run of frames without velocities; the lengths of both
        trajectories, and how far both were at last from where they were first [m].
    """
    for i in range(frames.size):
        rows, count = values[i], frames[i]
        out[i, 0], run = math.inf, 0
        for f in range(count):
            row = rows[f]
            if row[_TTC] < out[i, 0]:
                out[i, 0] = row[_TTC]
            vehicle = math.isnan(row[_VEHICLE + 2]) or math.isnan(row[_VEHICLE + 3])
            pedestrian = math.isnan(row[_PEDESTRIAN + 2]) or math.isnan(row[_PEDESTRIAN + 3])
            run = run + 1 if vehicle or pedestrian else 0
            out[i, 1] = max(out[i, 1], run)
        out[i, 2], out[i, 4] = _way(rows, count, _VEHICLE)
        out[i, 3], out[i, 5] = _way(rows, count, _PEDESTRIAN)


@kernel
def _way(rows, count, first):  # type: ignore[no-untyped-def]
    """Return the length of a trajectory and the distance of its ends [m], whose positions begin at a column."""
    length, begin, end = 0.0, -1, 0
    for f in range(count):
        if not math.isnan(rows[f, first]):
            begin, end = f if begin < 0 else begin, f
        if f > 0:
            step = _apart(rows, f - 1, f, first)
            length += 0.0 if math.isnan(step) else step
    moved = _apart(rows, begin, end, first) if begin >= 0 else 0.0
    return length, 0.0 if math.isnan(moved) else moved


@kernel
def _apart(rows, one, other, first):  # type: ignore[no-untyped-def]
    dx = float64(rows[other, first]) - float64(rows[one, first])
    return math.hypot(dx, float64(rows[other, first + 1]) - float64(rows[one, first + 1]))
