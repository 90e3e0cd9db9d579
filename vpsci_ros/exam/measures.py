"""From episodes to one row each: what a driving system did with one pedestrian, in columns that everything rests on."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import EpisodeArrays
from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.data.parquet import Column
from vpsci_ros.evaluation.yields import yields
from vpsci_ros.exam.config import MOVING, SEVERE_TTC, ExamConfig
from vpsci_ros.exam.sight import Sight
from vpsci_ros.safety import CRITICAL_TTC, HORIZON, Yielded
from vpsci_ros.world import COLLISION, OUTCOME_NAMES, PARKED_COLLISION

Key = tuple[int, int]  # scenario, episode
Floats = NDArray[np.float64]
YIELDED = {Yielded.NONE: "nobody", Yielded.VEHICLE: "vehicle", Yielded.PEDESTRIAN: "pedestrian", Yielded.BOTH: "both"}

COLUMNS: dict[str, Column] = {
    "driver": Column(pl.String, "", "ads, or autopilot for the baseline"),
    "pedestrian": Column(pl.String, "", "who was met"),
    "scenario": Column(pl.Int64, "", "number of the scenario; 1 to 8 are those of Table 6"),
    "episode": Column(pl.Int64, "", "number within the scenario: the same number begins the same way"),
    "outcome": Column(pl.String, "", "collision, goal, timeout or parked_collision"),
    "duration": Column(pl.Float64, "s", "from the spawn to the end"),
    "driven": Column(pl.Float64, "m", "length of the vehicle's path"),
    "collision": Column(pl.Boolean, "", "the footprints touched"),
    "impact_speed": Column(pl.Float64, "m/s", "speed of the vehicle at the contact, NaN without one"),
    "moving_collision": Column(pl.Boolean, "", "they touched while the vehicle moved"),
    "least_curvttc": Column(pl.Float64, "s", "least CurvTTC, at most its horizon of 10 s"),
    "critical": Column(pl.Boolean, "", "CurvTTC fell below 5 s"),
    "conflict": Column(pl.Boolean, "", "CurvTTC fell below the threshold of a conflict"),
    "severe_conflict": Column(pl.Boolean, "", "CurvTTC fell below the threshold of a severe one"),
    "hardest_braking": Column(pl.Float64, "m/s2", "largest deceleration from one frame to the next"),
    "hard_braking": Column(pl.Boolean, "", "it was above the threshold"),
    "yielded": Column(pl.String, "", "who gave way: nobody, vehicle, pedestrian, both"),
    "time_lost": Column(pl.Float64, "s", "later than alone on the road at the place reached; NaN after a collision"),
    "parked_collision": Column(pl.Boolean, "", "the vehicle ran into a parked one"),
    "hidden": Column(pl.Boolean, "", "parked vehicles hid the pedestrian when CurvTTC first fell below 5 s"),
    "kind": Column(pl.String, "", "kind of the pedestrian that became critical first; empty: none did"),
    "group_size": Column(pl.Int64, "", "pedestrians of the episode; 0: none became critical"),
    "told_share": Column(pl.Float64, "", "share of the critical ticks at which the ADS was told of the pedestrian"),
    "told_after": Column(pl.Float64, "s", "from the first critical tick until the ADS was told of the pedestrian"),
    "unanswered": Column(pl.Int64, "ticks", "ticks without a usable command of the ADS: the autopilot drove"),
}


@dataclass(frozen=True)
class Drive:
    """An episode, frame by frame.

    :ivar values: float32[T, 10], `QUANTITIES` in map frame [m, m/s, s].
    """

    scenario: int
    episode: int
    outcome: int
    values: NDArray[np.float32]

    @property
    def key(self) -> Key:
        """What begins the same way with every pedestrian."""
        return self.scenario, self.episode

    def __getitem__(self, name: str) -> Floats:
        """Return one quantity, float64[T]."""
        return self.values[:, QUANTITIES.index(name)].astype(np.float64)

    @property
    def speed(self) -> Floats:
        """Speed of the vehicle, float64[T] [m/s]."""
        return np.hypot(self["velocity_x_av"], self["velocity_y_av"])

    @property
    def path(self) -> Floats:
        """How far the vehicle has driven, float64[T] [m]."""
        steps = np.hypot(np.diff(self["position_x_av"]), np.diff(self["position_y_av"]))
        return np.concatenate([[0.0], np.cumsum(steps)])


def drives(batches: Iterable[EpisodeBatch]) -> list[Drive]:
    """Return the episodes of batches in the order of their keys, of several pedestrians with the most critical one."""
    found = [
        Drive(int(b.scenario[i]), int(b.episode[i]), int(b.outcome[i]), b.values[i, : b.frames[i]])
        for b in batches
        for i in _most_critical(b)
    ]
    return sorted(found, key=lambda drive: drive.key)


def _most_critical(batch: EpisodeBatch) -> list[int]:
    """Return the entry of each episode's pedestrian with the least CurvTTC."""
    ttc = batch.values[..., QUANTITIES.index("CurvTTC")]
    least = np.where(np.isnan(ttc), np.inf, ttc).min(axis=1, initial=np.inf)
    episodes = zip(batch.first.tolist(), batch.pedestrians.tolist(), strict=True)
    return [first + int(least[first : first + several].argmin()) for first, several in episodes]


def episode_table(
    found: list[Drive],
    alone: list[Drive],
    config: ExamConfig,
    period: float,
    *,
    driver: str,
    pedestrian: str,
    unanswered: Mapping[Key, int] | None = None,
    sight: Mapping[Key, Sight] | None = None,
) -> pl.DataFrame:
    """Return a row an episode, with the columns of `COLUMNS`.

    :param alone: the same driver on the same episodes with nobody there: the reference of the time lost.
    :param period: time from one frame to the next [s].
    :param unanswered: ticks without a usable command, for the episodes that had any.
    :param sight: what the driver could see, of the episodes that were critical.
    """
    reference = {drive.key: drive.path for drive in alone}
    given_way = _yielded(found, period)
    rows = []
    for drive, code in zip(found, given_way, strict=True):
        collided, crashed = drive.outcome == COLLISION, drive.outcome == PARKED_COLLISION
        seen_of = (sight or {}).get(drive.key, Sight())
        speed = drive.speed
        seen = drive["CurvTTC"]
        least = 0.0 if collided else min(HORIZON, float(np.nanmin(np.append(seen, HORIZON))))
        braking = float(np.max(-np.diff(speed), initial=0.0)) / period
        impact = float(speed[-1]) if collided else math.nan
        lost = math.nan if collided or crashed else time_lost(drive.path, reference.get(drive.key), period)
        rows.append(
            {
                "driver": driver,
                "pedestrian": pedestrian,
                "scenario": drive.scenario,
                "episode": drive.episode,
                "outcome": OUTCOME_NAMES[drive.outcome],
                "duration": (len(speed) - 1) * period,
                "driven": float(drive.path[-1]),
                "collision": collided,
                "impact_speed": impact,
                "moving_collision": collided and impact > MOVING,
                "least_curvttc": least,
                "critical": least < CRITICAL_TTC,
                "conflict": least < config.conflict,
                "severe_conflict": least < SEVERE_TTC,
                "hardest_braking": braking,
                "hard_braking": braking > config.hard_braking,
                "yielded": YIELDED[Yielded(code)],
                "time_lost": lost,
                "parked_collision": crashed,
                "hidden": seen_of.hidden,
                "kind": seen_of.kind,
                "group_size": seen_of.pedestrians,
                "told_share": seen_of.told_share,
                "told_after": seen_of.told_after(period),
                "unanswered": (unanswered or {}).get(drive.key, 0),
            }
        )
    return pl.DataFrame(rows, schema={name: column.dtype for name, column in COLUMNS.items()})


def time_lost(path: Floats, alone: Floats | None, period: float) -> float:
    """Return how much later the vehicle is at the place that it reaches than it was there alone on the road [s].

    Unlike the time to a goal it is defined for a vehicle that has not arrived when its episode ends.

    :param path: float64[T], metres driven by each frame; `alone` float64[S] likewise with nobody there, or None.
    :returns: NaN without a reference.
    """
    if alone is None:
        return math.nan
    frame = float(np.interp(path[-1], alone, np.arange(len(alone))))
    if path[-1] <= alone[0]:
        frame = 0.0
    return (len(path) - 1 - frame) * period


def _yielded(found: list[Drive], period: float) -> NDArray[np.uint8]:
    if not found:
        return np.zeros(0, np.uint8)
    lengths = np.array([len(drive.values) for drive in found])
    values = np.full((len(found), lengths.max(), len(QUANTITIES)), np.nan, np.float32)
    for i, drive in enumerate(found):
        values[i, : lengths[i]] = drive.values
    numbers = np.array([drive.episode for drive in found])
    return yields(EpisodeArrays(numbers, lengths, values), period)
