"""Which simulated episodes make it into the dataset: the four conditions of section 3.3 of the paper.

Every condition is checked for every episode, on the numbers as they are stored, and every rejection has a reason that
is counted. The third condition also drops each collision before the 100th frame, since a collision ends its episode;
how many is in the counts. An episode with several pedestrians is classified by one of them: it is kept if a pair is.
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
    values, pairs = batch.values, np.zeros(len(batch), RECORD)
    pairs["scenario"], pairs["count"], pairs["outcome"] = batch.scenario, batch.episode, batch.outcome
    pairs["frames"], pairs["pedestrians"] = batch.frames, 1
    counted = np.arange(values.shape[1]) < batch.frames[:, None]
    ttc = np.where(counted & ~np.isnan(values[..., _TTC]), values[..., _TTC], np.inf)
    pairs["least_curvttc"] = ttc.min(axis=1, initial=np.inf)
    missing = counted & np.isnan(values[..., _VELOCITIES]).any(axis=-1)
    pairs["failed"] = np.column_stack(
        [
            ~(pairs["least_curvttc"] < config.critical_ttc),
            _longest_run(missing) >= config.missing_frames,
            batch.frames < config.least_frames,
            _moved(values, _VEHICLE, counted) <= config.vehicle_distance,
            _moved(values, _PEDESTRIAN, counted) <= config.pedestrian_distance,
        ]
    )
    pairs["reason"] = np.where(pairs["failed"].any(axis=1), pairs["failed"].argmax(axis=1) + 1, KEPT)
    pairs["vehicle_path"], pairs["pedestrian_path"] = (_path_length(values, who) for who in (_VEHICLE, _PEDESTRIAN))
    return pairs


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
