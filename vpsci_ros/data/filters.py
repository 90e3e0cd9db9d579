"""The filters of a dataset: the four conditions of section 3.3 of the paper.

Every condition is checked for every episode, on the numbers as they are stored, and rejections are counted by reason.
The third condition also drops each collision before the 100th frame, since a collision ends its episode; these
collisions are counted, too. An episode with several pedestrians is kept if a pair of it passes all conditions.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import float64

from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import KEPT, EpisodeBlock
from vpsci_ros.parameters import constant
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import COLLISION

_VEHICLE = QUANTITIES.index("position_x_av")  # then y and the velocity
_PEDESTRIAN = QUANTITIES.index("position_x_ped")
_TTC = QUANTITIES.index("CurvTTC")


@dataclass(frozen=True)
class FilterConfig:
    """The bounds of the four conditions; the defaults are the paper's."""

    critical_ttc: float = constant(
        CRITICAL_TTC, "keep episodes whose least CurvTTC is below", unit="s", low=0.0, high=60.0
    )
    missing_frames: int = constant(
        10, "drop episodes with this many frames in a row without velocities", low=1, high=1000
    )
    least_frames: int = constant(100, "keep episodes of at least this many frames", low=1, high=100_000)
    vehicle_distance: float = constant(
        10.0,
        "keep episodes whose last vehicle position is further than this from the first",
        unit="m",
        low=0.0,
        high=1e4,
    )
    pedestrian_distance: float = constant(4.0, "likewise for the pedestrian", unit="m", low=0.0, high=1e4)


def apply_filters(block: EpisodeBlock, config: FilterConfig) -> EpisodeBlock:
    """Return the block with each episode's reason, failed conditions, lengths and least CurvTTC; all rows stay.

    Every episode of the block must have its rows. Reason, failed conditions and lengths are those of one pair: of the
    pairs that pass all conditions, or of all pairs if none does, the pair with the least CurvTTC.
    """
    records, several = block.records.copy(), block.records["pedestrians"]
    frames, first = np.repeat(records["frames"], several), np.cumsum(several) - several
    measures = np.zeros((len(frames), 6))
    _measure(block.values, frames, measures)
    least = measures[:, 0].astype(np.float32)
    failed = np.column_stack(
        [
            ~(least < config.critical_ttc),
            measures[:, 1] >= config.missing_frames,
            frames < config.least_frames,
            measures[:, 4] <= config.vehicle_distance,
            measures[:, 5] <= config.pedestrian_distance,
        ]
    )
    reason = np.where(failed.any(axis=1), failed.argmax(axis=1) + 1, KEPT)
    pair = np.lexsort((least, reason != KEPT, np.repeat(np.arange(len(records)), several)))[first]
    records["failed"], records["reason"] = failed[pair], reason[pair]
    records["vehicle_path"], records["pedestrian_path"] = measures[pair, 2], measures[pair, 3]
    least = np.minimum.reduceat(least, first) if len(first) else least
    records["least_curvttc"] = np.where(records["outcome"] == COLLISION, 0.0, least)  # a contact may be between frames
    return EpisodeBlock(records, block.values)


@kernel
def _measure(values, frames, out):  # type: ignore[no-untyped-def]
    """Measure pairs, float32[rows, 15] one after the other, of `frames` int64[n] each.

    :param out: float64[n, 6]: least CurvTTC [s]; the longest run of frames without velocities; the lengths of both
        trajectories, and how far both were at last from where they were first [m].
    """
    begin = 0
    for i in range(frames.size):
        count = frames[i]
        rows = values[begin : begin + count]
        begin += count
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
