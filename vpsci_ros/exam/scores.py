"""The measures of an exam, each with its definition, unit and estimator, in one table."""

import math
from dataclasses import dataclass, field
from typing import Any

import polars as pl
from numpy.typing import NDArray

from vpsci_ros.evaluation import statistics
from vpsci_ros.evaluation.statistics import NOTHING, Estimate


@dataclass(frozen=True)
class Measure:
    """One measure of a driver with one pedestrian.

    :ivar column: of the table of episodes; bool for a share, a number otherwise.
    :ivar among: which episodes count.
    :ivar statistic: None: the share of episodes in which `column` holds.
    :ivar good: "low", "high", or "" where neither is better.
    :ivar none: the reason for which there is no value, although episodes were driven.
    """

    name: str
    title: str
    unit: str
    definition: str
    column: pl.Expr
    among: pl.Expr = field(default_factory=lambda: pl.lit(True))
    statistic: statistics.Statistic | None = None
    good: str = "low"
    none: str = "not measured"


NO_CONTACT = "no contact"  # a measure of contacts then satisfies every limit
_NO_CRITICAL, _NO_RESOLVED = "no critical episode", "no critical episode without a contact"
_CRITICAL = pl.col("critical")
_RESOLVED = pl.col("critical") & ~pl.col("collision")

MEASURES = {
    measure.name: measure
    for measure in (
        Measure("collision_rate", "collisions", "", "share of episodes in which the footprints touch, whoever moved",
                pl.col("collision")),
        Measure("moving_collision_rate", "collisions, vehicle moving", "",
                "share of episodes in which they touch while the vehicle moves: the vehicle hits",
                pl.col("moving_collision")),
        Measure("parked_collision_rate", "collisions with parked vehicles", "",
                "share of episodes in which the vehicle runs into a parked one, where there are any",
                pl.col("parked_collision")),
        Measure("left_lane_rate", "left its lane", "",
                "share of episodes in which the vehicle's centre is beyond an edge of its lane",
                pl.col("left_lane")),
        Measure("impact_speed", "impact speed", "m/s", "mean speed of the vehicle at the contact, of collisions",
                pl.col("impact_speed"), pl.col("collision"), statistics.mean, none=NO_CONTACT),
        Measure("critical_rate", "critical episodes", "", "share of episodes in which CurvTTC falls below 5 s",
                pl.col("critical"), good=""),
        Measure("conflict_rate", "conflicts", "", "share of episodes in which CurvTTC falls below {conflict:g} s",
                pl.col("conflict")),
        Measure("severe_conflict_rate", "severe conflicts", "",
                "share of episodes in which CurvTTC falls below {severe:g} s", pl.col("severe_conflict")),
        Measure("evasion_success_rate", "evasion success", "", "share of critical episodes that end without a contact",
                ~pl.col("collision"), _CRITICAL, good="high", none=_NO_CRITICAL),
        Measure("least_curvttc_q25", "least CurvTTC, lower quartile", "s",
                "quartile of the episodes' least CurvTTC, each at most 10 s", pl.col("least_curvttc"),
                statistic=statistics.quantile(0.25), good="high"),
        Measure("least_curvttc_median", "least CurvTTC, median", "s",
                "median of the episodes' least CurvTTC, each at most 10 s", pl.col("least_curvttc"),
                statistic=statistics.quantile(0.5), good="high"),
        Measure("hard_braking_rate", "hard braking", "",
                "share of episodes with braking above {hard_braking:g} m/s2", pl.col("hard_braking")),
        Measure("arrived_rate", "arrived", "", "share of episodes in which the vehicle reaches its goal",
                pl.col("arrived"), good="high"),
        Measure("never_arrived_rate", "never arrived", "",
                "share of episodes without a contact that end before the vehicle is at its goal",
                ~pl.col("arrived"), ~(pl.col("collision") | pl.col("parked_collision")),
                none="no episode without a contact"),
        Measure("stood_still_rate", "stood still", "",
                "share of episodes at whose end the vehicle stands, short of its goal and without a contact",
                pl.col("stood_still")),
        Measure("time_lost", "time lost", "s",
                "mean, of episodes without a contact: how much later it is at its goal than the same driver with "
                "nobody on the road; without an arrival, up to the end of the episode", pl.col("time_lost"),
                pl.col("time_lost").is_not_nan(), statistics.mean,
                none="no episode without a contact"),
        Measure("pedestrian_yield_rate", "only the pedestrian yielded", "",
                "share of critical episodes without a contact in which the pedestrian gave way and the vehicle did not",
                pl.col("yielded") == "pedestrian", _RESOLVED, none=_NO_RESOLVED),
        Measure("vehicle_yield_rate", "the vehicle yielded", "",
                "share of critical episodes without a contact in which the vehicle gave way (alone or with the "
                "pedestrian)", pl.col("yielded").is_in(["vehicle", "both"]), _RESOLVED, good="high", none=_NO_RESOLVED),
    )
}  # fmt: skip
"""Measures of one driver with one pedestrian."""

DIFFERENCES = ("collision_rate", "moving_collision_rate", "conflict_rate", "severe_conflict_rate",
               "least_curvttc_median", "hard_braking_rate", "arrived_rate", "time_lost")  # fmt: skip
"""Measures that are compared between pedestrians, on the same episodes."""


def estimate(rows: pl.DataFrame, measure: Measure) -> Estimate:
    """Return the estimate of a measure from the episodes of one driver with one pedestrian."""
    values = rows.filter(measure.among).select(measure.column.alias("value"))["value"].to_numpy()
    if measure.statistic is None:
        return statistics.share(int(values.sum()), len(values))
    return statistics.resampled(values, measure.statistic)


def difference(first: pl.DataFrame, second: pl.DataFrame, measure: Measure) -> tuple[Estimate, float]:
    """Return measure(first) - measure(second) on common episodes, and McNemar's p-value (NaN if it is no share)."""
    one, other = _pairs(first, second, measure)
    if not len(one):
        return NOTHING, math.nan
    if measure.statistic is None:
        only_first, only_second = int((one & ~other).sum()), int((other & ~one).sum())
        share = statistics.share_difference(only_first, only_second, len(one))
        return share, statistics.mcnemar(only_first, only_second)
    return statistics.resampled_difference(one, other, measure.statistic), math.nan


def detectable(first: pl.DataFrame, second: pl.DataFrame, measure: Measure, found: Estimate) -> float:
    """Return the least difference that these common episodes would show in 4 of 5 cases; NaN where none.

    For a share it is assumed that as many episodes differ as here. As in the interval, half an episode more in either
    direction counts, so that equal systems do not seem to leave no doubt.

    :param found: the difference of the measure, see `difference`.
    """
    if measure.statistic is not None:
        return statistics.detectable_by_interval(found)
    one, other = _pairs(first, second, measure)
    return statistics.detectable_difference(len(one), (int((one != other).sum()) + 1.0) / (len(one) + 2.0))


def _pairs(first: pl.DataFrame, second: pl.DataFrame, measure: Measure) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the column of a measure in the n common episodes that count in both tables, [n] and [n]."""
    keys = ["scenario", "episode"]
    what = measure.column.alias("value"), measure.among.alias("counts")
    parts = [table.select(*keys, *what) for table in (first, second)]
    both = parts[0].join(parts[1], on=keys, how="inner", suffix="_second").sort(keys)
    both = both.filter(pl.col("counts") & pl.col("counts_second"))
    return both["value"].to_numpy(), both["value_second"].to_numpy()
