"""An exam's episodes for the page that plays them: the driving system beside the autopilot."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import polars as pl

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.config import ALONE, title_of
from vpsci_ros.exam.report import ADS, BASELINE
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.safety import VEHICLE_LENGTH
from vpsci_ros.view.sources import Shown, Source, shown

MARKS = {name.removesuffix("_rate"): measure for name, measure in MEASURES.items() if measure.statistic is None}
"""Shares of episodes that the exam gives: the page filters by them, so that each number opens its episodes."""
Rows = dict[str, dict[str, Any]]  # name -> row of the table of episodes
Driven = Callable[[str], Iterable[Episode]]  # pedestrian -> a driver's episodes with it
_DRIVERS = {ADS: "the ADS", BASELINE: "autopilot"}


def exam_sources(
    table: pl.DataFrame, drivers: Mapping[str, Driven], limit: int, failure: str = "collision"
) -> list[Source]:
    """Return the episodes of an exam: each pedestrian with the driving system, and with the autopilot beside it.

    :param table: a row an episode, `vpsci_ros.exam.measures.COLUMNS`.
    :param drivers: the episodes of `ADS` and, unless it is left out, of `BASELINE`.
    :param limit: episodes at most with each pedestrian, those that came nearest where there are more.
    :param failure: column of what counts as a failure; these and all contacts have the group of their failure.
    """
    marked = table.with_columns(
        (measure.column & measure.among).alias(f"mark {name}") for name, measure in MARKS.items()
    ).with_columns(grouped=pl.col(failure) | pl.col("collision") | pl.col("parked_collision"))
    rows = marked.filter(pl.col("pedestrian") != ALONE)
    found = []
    for (pedestrian,), of_both in rows.group_by("pedestrian", maintain_order=True):
        for driver, driven in drivers.items():
            if (mine := of_both.filter(pl.col("driver") == driver)).height:
                found.append(_source(driver, str(pedestrian), driven(str(pedestrian)), mine, limit))
    return found


def _source(driver: str, pedestrian: str, episodes: Iterable[Episode], rows: pl.DataFrame, limit: int) -> Source:
    """Return a driver's episodes with what the exam says of them."""
    chosen, title = _chosen(rows, limit), f"{_DRIVERS[driver]}, {title_of(pedestrian)}"
    found = [_marked(shown(episode), chosen[episode.name]) for episode in episodes if episode.name in chosen]
    return Source(f"{driver}-{pedestrian}", title, found[0].episode.period, found, rows.height)


def _chosen(rows: pl.DataFrame, limit: int) -> Rows:
    """Return the episodes to show: those that came nearest where there are too many."""
    if rows.height > limit:
        rows = rows.sort("least_curvttc", "scenario", "episode").head(limit).sort("scenario", "episode")
    return {f"{row['scenario']}:{row['episode']}": row for row in rows.to_dicts()}


def _marked(each: Shown, row: dict[str, Any]) -> Shown:
    """Return an episode with who yielded by the exam, its shares as marks, and the group of its failure."""
    marks = tuple(name for name in MARKS if row[f"mark {name}"])
    marks += ("beyond_range",) if row["range"] == "beyond" else ()
    group = str(failure_group(row, each.episode)) if row["grouped"] else ""
    return each._replace(yielded=row["yielded"], marks=marks, failure=group)


class FailureGroup(NamedTuple):
    """The common properties of a group of failures; its text is shown on the page.

    :ivar kind: of the pedestrian; `hidden`: behind parked vehicles as it became critical.
    :ivar contact: "moving vehicle", "standing vehicle", "parked vehicle", or "none".
    :ivar came_first: where they touch: "pedestrian", before the front, or "vehicle", touched in its side; empty: no
        contact of the two.
    """

    scenario: int
    kind: str
    hidden: bool
    contact: str
    came_first: str

    def __str__(self) -> str:
        what = {"none": "no contact", "parked vehicle": "hits a parked vehicle"}.get(self.contact, self.contact)
        first = f", {self.came_first} came first" if self.came_first else ""
        return f"{self.scenario}: {self.kind or 'adult'} {'hidden' if self.hidden else 'in sight'}, {what}{first}"


def failure_group(row: Mapping[str, Any], episode: Episode) -> FailureGroup:
    """Return the group of an episode that failed.

    :param row: of it in the table of episodes, `vpsci_ros.exam.measures.COLUMNS`.
    """
    contact = "parked vehicle" if row["parked_collision"] else "none"
    if row["collision"]:
        contact = "moving vehicle" if row["moving_collision"] else "standing vehicle"
    return FailureGroup(row["scenario"], row["kind"], row["hidden"], contact, came_first(episode))


def came_first(episode: Episode) -> str:
    """Return which agent reached the contact point first, see `FailureGroup`."""
    if episode.outcome != "collision":
        return ""
    seen = episode.filled().pair(episode.most_critical)
    dx, dy = seen.ped_x[0, -1] - seen.x[-1], seen.ped_y[0, -1] - seen.y[-1]
    forward = math.cos(seen.heading[-1]) * dx + math.sin(seen.heading[-1]) * dy
    return "pedestrian" if forward >= 0.5 * VEHICLE_LENGTH else "vehicle"
