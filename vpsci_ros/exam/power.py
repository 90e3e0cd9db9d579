"""How large a change an exam can see, and how many episodes a change needs, in words."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from vpsci_ros.evaluation import statistics
from vpsci_ros.exam.exam import Exam, title_of
from vpsci_ros.exam.scores import MEASURES

ASSUMED = 0.2  # share of episodes whose outcome changes between two systems, before there are data


def can_see(found: Mapping[str, Any], measure: str) -> str:
    """Return, in words, how large a change would have to be to show; "" where that is not known.

    :param found: the change, as `vpsci_ros.exam.report.differences` gives it.
    """
    if not found.get("detectable"):  # 0: of a mean, where all episodes change alike
        return ""
    unit = MEASURES[measure].unit
    least = found["detectable"] * (1.0 if unit else 100.0)
    return f"with {found['n']} episodes a change of {_short(least)} {unit or 'points'} or more would show"


def needed(exam: Exam, points: float, earlier: pl.DataFrame | None = None) -> Iterator[str]:
    """Yield, in lines, how many episodes the exam needs so that a change of its failures by `points` shows.

    :param points: of percentage.
    :param earlier: episodes of the system with which the exam is to be compared; None: there are none.
    """
    change, failure, has = 0.01 * points, MEASURES[f"{exam.config.failure}_rate"], len(exam.episodes)
    yield (
        f"A change of {points:g} points or more in {failure.title} shows (95% interval without 0, in 4 of 5 exams) "
        "with this many episodes with a pedestrian:"
    )
    yield _line(change, change, "where all outcomes that change do so in one direction: no exam needs fewer")
    yield _line(change, ASSUMED, f"where {ASSUMED:.0%} of the outcomes change, as assumed before there are data")
    yield _line(change, 0.5, "where half of the outcomes change, as those of two coins do")
    for name in exam.config.opponents:
        rows = [] if earlier is None else earlier.filter(pl.col("pedestrian") == name)[exam.config.failure].to_list()
        if rows:
            share = sum(rows) / len(rows)
            text = (
                f"where outcomes are unrelated to the earlier exam's, of which {share:.1%} fail with {title_of(name)}"
            )
            yield _line(change, 2.0 * share * (1.0 - share), text)
    least = 100.0 * statistics.detectable_difference(has, ASSUMED)
    seen = "no change" if math.isnan(least) else f"a change of {_short(least)} points or more"
    number = math.ceil(statistics.units_for_difference(change, ASSUMED) / len(exam.scenarios))
    yield (
        f"This exam has {has}, which show {seen} ({ASSUMED:.0%}). "
        f"{points:g} points: --episodes {number} in each of {len(exam.scenarios)} scenarios."
    )


def _line(change: float, discordant: float, when: str) -> str:
    return f"{statistics.units_for_difference(change, discordant):9,}  {when}"


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
