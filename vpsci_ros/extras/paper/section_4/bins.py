"""Conflicts and yielding by distance, speed and acceleration at the onset: Figures 9 and 11 to 13 as numbers."""

import itertools
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from vpsci_ros.evaluation.statistics import interval, wilson_interval
from vpsci_ros.extras.paper.section_4.comparison import weights

LEAST_IN_BIN = 10  # interactions; a share of fewer says nothing


class Question(NamedTuple):
    """A question about the share with `flag` in bins (conditions on `encounters.SCHEMA`), and the paper's answer."""

    name: str
    flag: str
    bins: tuple[pl.Expr, ...]
    paper: str


def _along(column: str, *bounds: float) -> tuple[pl.Expr, ...]:
    """Return the bins below the first bound, between each two, and from the last one on."""
    at = pl.col(column)
    inner = (at.is_between(low, high, closed="left") for low, high in itertools.pairwise(bounds))
    return at < bounds[0], *inner, at >= bounds[-1]


_DISTANCE, _WALKING, _DRIVING = pl.col("distance"), pl.col("pedestrian_speed"), pl.col("vehicle_speed")
_DRIVES = "vehicle < 1, 1-2, 2-3, 3-4, >= 4 m/s"
_WALKS = "walking < 0.5, 0.5-1, 1-1.5, >= 1.5 m/s"
_APART = "distance < 5, 5-9, 9-13, >= 13 m"
_BY_DRIVING = _along("vehicle_speed", 1.0, 2.0, 3.0, 4.0)
_BY_WALKING = _along("pedestrian_speed", 0.5, 1.0, 1.5)
_BY_DISTANCE = _along("distance", 5.0, 9.0, 13.0)

QUESTIONS = (
    Question(f"conflicts: {_DRIVES}", "conflict", _BY_DRIVING, "rise"),
    Question(f"conflicts: {_WALKS}", "conflict", _BY_WALKING, "rise"),
    Question("conflicts: either speed < 1 m/s", "conflict", ((_DRIVING < 1.0) | (_WALKING < 1.0),), "< 40"),
    Question("conflicts: both speeds >= 3 m/s", "conflict", ((_DRIVING >= 3.0) & (_WALKING >= 3.0),), "> 80"),
    Question(f"pedestrian yields: {_APART}", "pedestrian_yields", _BY_DISTANCE, "falls"),
    Question(f"pedestrian yields: {_WALKS}", "pedestrian_yields", _BY_WALKING, "falls"),
    Question(
        "pedestrian yields: its acceleration < -0.5, -0.5 to 0.5, >= 0.5 m/s2",
        "pedestrian_yields",
        _along("pedestrian_acceleration", -0.5, 0.5),
        "falls",
    ),
    Question(f"pedestrian yields: {_DRIVES}", "pedestrian_yields", _BY_DRIVING, "rises"),
    Question(
        "pedestrian yields: distance < 5 m, walking < 0.5 m/s",
        "pedestrian_yields",
        ((_DISTANCE < 5.0) & (_WALKING < 0.5),),
        "> 80",
    ),
    Question(
        "pedestrian yields: distance < 5 m, vehicle > 2.5 m/s",
        "pedestrian_yields",
        ((_DISTANCE < 5.0) & (_DRIVING > 2.5),),
        "> 60",
    ),
    Question(
        "pedestrian yields: distance < 5 m, vehicle slows down, speeds up",
        "pedestrian_yields",
        tuple((_DISTANCE < 5.0) & bin_ for bin_ in _along("vehicle_acceleration", 0.0)),
        "rises",
    ),
    Question(
        "pedestrian yields: distance > 13 m, walking > 1.5 m/s",
        "pedestrian_yields",
        ((_DISTANCE > 13.0) & (_WALKING > 1.5),),
        "< 20",
    ),
    Question(f"vehicle yields: {_APART}", "vehicle_yields", _BY_DISTANCE, ""),
    Question(f"vehicle yields: {_WALKS}", "vehicle_yields", _BY_WALKING, ""),
)
"""What sections 4.3, 4.5 and 4.6 say about speeds, distances and accelerations at the onset; answers in %."""


def by_bins(encounters: pl.DataFrame, *, clustered: bool) -> dict[str, list[dict[str, Any]]]:
    """Return each question's name -> the share in each of its bins, as {"n", "value", "low", "high"}.

    n counts interactions; below `LEAST_IN_BIN` of them the share and its bounds are None. The 95% bounds resample
    groups or interactions, as `comparison.describe` does; a share of 0 or 1, which no resample changes, has Wilson's.

    :param encounters: at least one row of `encounters.SCHEMA`.
    :param clustered: resample the column `group` rather than interactions.
    """
    draws = np.stack(list(weights(encounters, clustered)))
    found: dict[str, list[dict[str, Any]]] = {}
    for question in QUESTIONS:
        inside = encounters.select(
            here.cast(pl.Float64).alias(f"{place}") for place, here in enumerate(question.bins)
        ).to_numpy()
        hits = inside * encounters[question.flag].to_numpy()[:, None]
        drawn = np.divide(draws @ hits, there := draws @ inside, where=there > 0.0, out=np.full(there.shape, np.nan))
        counts = zip(inside.sum(axis=0), hits.sum(axis=0), drawn.T, strict=True)
        found[question.name] = [_share(round(float(n)), round(float(k)), of_draws) for n, k, of_draws in counts]
    return found


def _share(n: int, hits: int, drawn: Any) -> dict[str, Any]:
    if n < LEAST_IN_BIN:
        return {"n": n, "value": None, "low": None, "high": None}
    low, high = interval(drawn) if 0 < hits < n else wilson_interval(hits, n)
    return {"n": n, "value": hits / n, "low": low, "high": high}
