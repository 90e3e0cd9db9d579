"""What is said of failures that were driven again: grouped, and played beside what avoids them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import polars as pl

from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.failure_group import FailureGroup, failure_group
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.report import ADS
from vpsci_ros.extras.exam_extra.factors import FACTORS
from vpsci_ros.extras.exam_extra.why import Search
from vpsci_ros.view.sources import Shown, Source, shown


def groups_of(exam: Exam, runs: Mapping[str, RunResult], table: pl.DataFrame) -> list[dict[str, Any]]:
    """Return the failures by what they have in common, the largest group first, each with its smallest case.

    That is the one with the fewest pedestrians, and of these the shortest.
    """
    failed = pl.col("pedestrian").is_in(exam.config.opponents) & pl.col(exam.config.failure)
    episodes = {(name, each.key): each for name, run in runs.items() for each in run.episodes}
    groups: dict[tuple[str, FailureGroup], list[dict[str, Any]]] = {}
    for row in table.filter((pl.col("driver") == ADS) & failed).to_dicts():
        episode = episodes[row["pedestrian"], (row["scenario"], row["episode"])]
        groups.setdefault((row["pedestrian"], failure_group(row, episode)), []).append(row)
    found = []
    for (pedestrian, group), members in groups.items():
        smallest = min(members, key=lambda row: (row["group_size"], row["duration"], row["episode"]))
        names = [f"{row['scenario']}:{row['episode']}" for row in members]
        found.append({"pedestrian": pedestrian, **group._asdict(), "name": str(group), "episodes": names,
                      "smallest": f"{smallest['scenario']}:{smallest['episode']}"})  # fmt: skip
    return sorted(found, key=lambda group: (-len(group["episodes"]), group["pedestrian"], group["scenario"]))


def again_source(pedestrian: str, searches: Sequence[Search]) -> Source | None:
    """Return the episodes that were driven again, for the page in which they play; None where there are none.

    Its `changes` say which of them belongs to which failure, factor and amount, so that the page has a slider.
    """
    shown_ones: list[Shown] = []
    changes: dict[str, list[dict[str, Any]]] = {}
    period, named = 0.0, set[str]()
    for search in searches:
        steps, factor = [], FACTORS[search.factor]
        for amount, episode in sorted(search.episodes.items(), key=lambda each: each[0]):
            name = (
                f"{search.case.name} {factor.title} by {amount:g} {factor.unit}"
                if amount
                else f"{search.case.name} as it was"
            )
            steps.append({"amount": amount, "name": name, "fails": search.failed[amount]})
            if name in named:
                continue
            named.add(name)
            renamed = dataclasses.replace(episode, listed=episode.listed._replace(name=name))
            shown_ones.append(shown(renamed))
            period = episode.period
        if steps:
            nearest = next((n for n, step in enumerate(steps) if not step["fails"]), len(steps) - 1)
            changes.setdefault(search.case.name, []).append(
                {"title": factor.title, "unit": factor.unit, "steps": steps, "nearest": nearest}
            )
    if not shown_ones:
        return None
    for each in changes.values():  # those that avoid it first
        each.sort(key=lambda change: change["steps"][change["nearest"]]["fails"])
    title = f"driven again, {title_of(pedestrian)}"
    return Source(f"why-{pedestrian}", title, period, shown_ones, len(shown_ones), changes)


def why_reasons(found: Mapping[str, Any], factor: str) -> dict[str, list[str]]:
    """Return why a factor was not varied, each reason with the episodes that it is of."""
    reasons: dict[str, list[str]] = {}
    for row in found["analysed"]:
        each = row["factors"][factor]
        if row["repeats"] and not each["most"]:
            reasons.setdefault(each["reason"], []).append(row["episode"])
    return reasons
