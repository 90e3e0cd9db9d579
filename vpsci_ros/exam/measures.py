"""The table of an exam's episodes: a row for each driver, pedestrian and episode, with all measures."""

import math
from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.episode import YIELDED, Episode, yields
from vpsci_ros.data.parquet import Column, read_parquet
from vpsci_ros.exam.exam import HARD_BRAKING, MOVING, SEVERE_TTC, STANDS
from vpsci_ros.exam.result import RunResult, first_critical
from vpsci_ros.exam.timing import Timed, Timing
from vpsci_ros.policy.onset_range import range_of_episode
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC, HORIZON
from vpsci_ros.world import COLLISION, GOAL, OUTCOME_NAMES, PARKED_COLLISION

Floats = NDArray[np.float64]
_COLLISION, _PARKED_COLLISION = OUTCOME_NAMES[COLLISION], OUTCOME_NAMES[PARKED_COLLISION]

EPISODES = "episodes.parquet"
COLUMNS: dict[str, Column] = {
    "driver": Column(pl.String, "", "ads, or autopilot for the baseline"),
    "pedestrian": Column(pl.String, "", "the pedestrian of the run"),
    "scenario": Column(pl.Int64, "", "number of the scenario; 1 to 8 are those of Table 6"),
    "episode": Column(pl.Int64, "", "number within the scenario: the same number begins the same way"),
    "outcome": Column(pl.String, "", "collision, goal (in the lane or not), timeout or parked_collision"),
    "arrived": Column(pl.Boolean, "", "the vehicle reached its goal"),
    "stood_still": Column(pl.Boolean, "", "it stood at the end, short of its goal and without a contact"),
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
    "time_lost": Column(
        pl.Float64, "s", "later at its goal than alone on the road, or up to the end without an arrival"
    ),
    "parked_collision": Column(pl.Boolean, "", "the vehicle ran into a parked one"),
    "lane_departure": Column(pl.Float64, "m", "largest distance of the vehicle's centre from the middle of its lane"),
    "left_lane": Column(pl.Boolean, "", "its centre was beyond an edge of the lane"),
    "hidden": Column(pl.Boolean, "", "parked vehicles hid the pedestrian when CurvTTC first fell below 5 s"),
    "kind": Column(pl.String, "", "kind of the pedestrian that became critical first; empty: none did"),
    "group_size": Column(pl.Int64, "", "pedestrians of the episode; 0: none became critical"),
    "head_start": Column(
        pl.Float64, "s", "by which its pedestrians are earlier than timed to the autopilot; NaN: not timed to the ADS"
    ),
    "hurried": Column(
        pl.Float64,
        "s",
        "by which the ADS is earlier at the place of the encounter than alone; NaN: not timed, or never",
    ),
    "unanswered": Column(pl.Int64, "ticks", "ticks without a usable command of the ADS: the autopilot drove"),
    "range": Column(
        pl.String,
        "",
        "pedestrian `learned`: 'beyond' the range of its recorded onsets as it becomes critical, or 'within'; else ''",
    ),
}


def read_episode_table(folder: Path) -> pl.DataFrame:
    """Return the table of episodes of a finished exam in `folder`, a row an episode, with `COLUMNS`.

    :raises InvalidInput: there is no such table, or it cannot be read.
    """
    return read_parquet(folder / EPISODES, "the episodes of an exam", COLUMNS)


def worst_first(table: pl.DataFrame, *then: str) -> pl.DataFrame:
    """Return episodes sorted by severity, the worst first.

    Contacts of a moving vehicle, the fastest first, then those without a contact by least CurvTTC, and last those in
    which the pedestrian walked into a standing vehicle.

    :param then: columns that decide between equals, the least first.
    """
    moving, standing = pl.col("moving_collision"), pl.col("collision") & ~pl.col("moving_collision")
    speed = pl.when(moving).then(-pl.col("impact_speed")).otherwise(0.0)
    return table.sort([~moving, speed, standing, "least_curvttc", *then, "scenario", "episode"])


def episode_table(
    run: RunResult,
    alone: Sequence[Episode],
    *,
    driver: str,
    pedestrian: str,
    reach: Floats | None = None,
    timing: Timing = MappingProxyType({}),
) -> pl.DataFrame:
    """Return a table of a run's episodes, a row each, with `COLUMNS`; missing frames repeat the last known one.

    :param alone: the same driver on the same episodes without pedestrians: the reference of the time lost.
    :param timing: of the episodes, where it was set for this driver.
    :param reach: float64[4, 5], the range of the pedestrian's recorded onsets, see `vpsci_ros.policy.onset_range`.
    """
    reference = {episode.key: arrival(episode.filled()) for episode in alone}
    rows = []
    for episode, code in zip(run.episodes, yields(run.episodes), strict=True):
        collided, crashed = episode.outcome == _COLLISION, episode.outcome == _PARKED_COLLISION
        seen_of, period = first_critical(episode), episode.period
        driven = episode.filled()
        speed, path = driven.speed, driven.path
        least = min(HORIZON, episode.least_curvttc)
        braking = float(np.max(-np.diff(speed), initial=0.0)) / period
        impact = float(speed[-1]) if collided else math.nan
        departure, half = lane_departure(driven)
        there = arrival(driven)
        until = (len(speed) - 1) * period if there is None else there
        timed = timing.get(episode.key)
        before = None if collided or crashed else reference.get(episode.key)
        rows.append(
            {
                "driver": driver,
                "pedestrian": pedestrian,
                "scenario": episode.key[0],
                "episode": episode.number,
                "outcome": episode.outcome,
                "arrived": there is not None,
                "stood_still": there is None and not (collided or crashed) and float(speed[-1]) < STANDS,
                "duration": (len(speed) - 1) * period,
                "driven": float(path[-1]),
                "collision": collided,
                "impact_speed": impact,
                "moving_collision": collided and impact > MOVING,
                "least_curvttc": least,
                "critical": least < CRITICAL_TTC,
                "conflict": least < CONFLICT_TTC,
                "severe_conflict": least < SEVERE_TTC,
                "hardest_braking": braking,
                "hard_braking": braking > HARD_BRAKING,
                "yielded": YIELDED[code],
                "time_lost": math.nan if before is None else until - before,
                "parked_collision": crashed,
                "lane_departure": departure,
                "left_lane": departure > half,
                "hidden": seen_of.hidden,
                "kind": seen_of.kind,
                "group_size": seen_of.pedestrians,
                "head_start": timed.ahead if timed and timed.of else math.nan,
                "hurried": _hurried(timed, driven),
                "unanswered": run.unanswered.get(episode.key, 0),
                "range": range_of_episode(episode, reach),
            }
        )
    return pl.DataFrame(rows, schema={name: column.dtype for name, column in COLUMNS.items()})


def arrival(episode: Episode) -> float | None:
    """Return the time [s] at which the vehicle is at its goal; None: it is not there when the episode ends."""
    if episode.scenario is None:
        return (len(episode) - 1) * episode.period if episode.outcome == OUTCOME_NAMES[GOAL] else None
    lane = episode.scenario.vehicle
    there = lane.path.follow(episode.x, episode.y) >= lane.goal
    return int(there.argmax()) * episode.period if there.any() else None


def lane_departure(episode: Episode) -> tuple[float, float]:
    """Return the greatest distance [m] of the vehicle's centre from its lane's middle, and half the lane width [m].

    NaN and infinity where the lane is not known.
    """
    if episode.scenario is None:
        return math.nan, math.inf
    lane = episode.scenario.vehicle
    begins, ahead = lane.path.points[:-1], np.diff(lane.path.points, axis=0) / lane.path.step
    apart = np.stack([episode.x, episode.y], axis=1)[:, None] - begins
    here = np.hypot(apart[..., 0], apart[..., 1]).argmin(axis=1)
    beside = ahead[here, 0] * apart[range(len(here)), here, 1] - ahead[here, 1] * apart[range(len(here)), here, 0]
    return float(np.abs(beside).max()), 0.5 * lane.lane_width


def _hurried(timed: Timed | None, episode: Episode) -> float:
    """Return the time [s] by which the car is earlier where it would touch the pedestrian than on the empty road.

    NaN: the episode is not timed, or the car does not come there.
    """
    if timed is None or not timed.of or not (there := episode.path >= timed.way).any():
        return math.nan
    return timed.time - float(episode.time[there.argmax()])
