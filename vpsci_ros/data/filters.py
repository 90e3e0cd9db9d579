"""Which simulated episodes make it into the dataset: the four conditions of section 3.3 of the paper.

Every condition is judged for every episode, on the numbers as they are stored, and every rejection has a reason that
is counted. The third condition also drops each collision before the 100th frame, since a collision ends its episode;
how many is in the counts. An episode with several pedestrians is judged by one of them: it is kept if a pair is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.parameters import parameter
from vpsci_ros.safety import CRITICAL_TTC

KEPT = 0
REASONS = (
    "kept",
    "not critical",  # (1) CurvTTC never below 5 s
    "velocities missing",  # (2) ten frames in a row or more without them
    "too short",  # (3) fewer than 100 frames
    "vehicle hardly moved",  # (4) 10 m or less from the first to the last frame
    "pedestrian hardly moved",  # (4) 4 m or less
)
_VELOCITIES = [QUANTITIES.index(name) for name in QUANTITIES if name.startswith("velocity")]
_VEHICLE = QUANTITIES.index("position_x_av")
_PEDESTRIAN = QUANTITIES.index("position_x_ped")
_TTC = QUANTITIES.index("CurvTTC")


@dataclass(frozen=True)
class FilterConfig:
    """The bounds of the four conditions; the defaults are the paper's."""

    critical_ttc: float = parameter(
        CRITICAL_TTC, "keep episodes whose least CurvTTC is below", unit="s", low=0.0, high=60.0
    )
    missing_frames: int = parameter(
        10, "drop episodes with so many frames in a row without velocities", low=1, high=1000
    )
    least_frames: int = parameter(100, "keep episodes of at least so many frames", low=1, high=100_000)
    vehicle_distance: float = parameter(
        10.0,
        "keep episodes whose last vehicle position is further than this from the first",
        unit="m",
        low=0.0,
        high=1e4,
    )
    pedestrian_distance: float = parameter(4.0, "likewise for the pedestrian", unit="m", low=0.0, high=1e4)


@dataclass(frozen=True)
class Judgement:
    """What the filters say of a batch of n episodes; of several pedestrians, by the pair that decides.

    :ivar failed: bool[n, 5], the conditions `REASONS[1:]` that an episode fails, each judged on its own.
    :ivar reason: uint8[n], index into `REASONS` of the first that fails in the paper's order, `KEPT` for none.
    :ivar least_curvttc: float32[n] [s], the least of all pairs.
    :ivar vehicle_path, pedestrian_path: float64[n] [m], lengths of the trajectories.
    """

    failed: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    least_curvttc: NDArray[np.float32]
    vehicle_path: NDArray[np.float64]
    pedestrian_path: NDArray[np.float64]


def judge(batch: EpisodeBatch, config: FilterConfig) -> Judgement:
    """Apply the four conditions to every episode of a batch.

    Of the pairs of an episode that one decides which is kept, or, where none or several are, has the least CurvTTC.
    """
    pairs = _judge_pairs(batch, config)
    first = batch.first
    if len(first) == len(batch):
        return pairs
    of_episode = np.repeat(np.arange(len(first)), batch.pedestrians)
    order = np.lexsort((pairs.least_curvttc, pairs.reason != KEPT, of_episode))
    decides = order[first]
    least = np.minimum.reduceat(pairs.least_curvttc, first)
    return Judgement(
        pairs.failed[decides],
        pairs.reason[decides],
        least,
        pairs.vehicle_path[decides],
        pairs.pedestrian_path[decides],
    )


def _judge_pairs(batch: EpisodeBatch, config: FilterConfig) -> Judgement:
    values = batch.values
    counted = np.arange(values.shape[1]) < batch.frames[:, None]
    ttc = np.where(counted & ~np.isnan(values[..., _TTC]), values[..., _TTC], np.inf)
    least = ttc.min(axis=1, initial=np.inf).astype(np.float32)
    missing = counted & np.isnan(values[..., _VELOCITIES]).any(axis=-1)
    failed = np.column_stack(
        [
            ~(least < config.critical_ttc),
            _longest_run(missing) >= config.missing_frames,
            batch.frames < config.least_frames,
            _moved(values, _VEHICLE, counted) <= config.vehicle_distance,
            _moved(values, _PEDESTRIAN, counted) <= config.pedestrian_distance,
        ]
    )
    reason = np.where(failed.any(axis=1), failed.argmax(axis=1) + 1, KEPT).astype(np.uint8)
    return Judgement(failed, reason, least, _path_length(values, _VEHICLE), _path_length(values, _PEDESTRIAN))


def _longest_run(missing: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return int64[n], the longest run of True along the rows of bool[n, F]."""
    if not missing.any():
        return np.zeros(len(missing), np.int64)
    step = np.arange(missing.shape[1])
    last_seen = np.maximum.accumulate(np.where(missing, -1, step), axis=1)
    run: NDArray[np.int64] = np.where(missing, step - last_seen, 0).max(axis=1)
    return run


def _moved(values: NDArray[np.float32], first: int, counted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return float64[n] [m], the distance between the first and the last position that were seen."""
    if len(values) == 0:
        return np.zeros(0)
    seen = counted & ~np.isnan(values[..., first])
    rows = np.arange(len(values))
    begin = values[rows, seen.argmax(axis=1), first : first + 2].astype(np.float64)
    end = values[rows, seen.shape[1] - 1 - seen[:, ::-1].argmax(axis=1), first : first + 2]
    moved: NDArray[np.float64] = np.nan_to_num(np.hypot(*(end - begin).T))
    return moved


def _path_length(values: NDArray[np.float32], first: int) -> NDArray[np.float64]:
    steps = np.diff(values[..., first : first + 2].astype(np.float64), axis=1)
    length: NDArray[np.float64] = np.nansum(np.hypot(steps[..., 0], steps[..., 1]), axis=1)
    return length
