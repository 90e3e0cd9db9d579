"""An exam's episodes for the page in which they play: the driving system, and beside it the autopilot."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.episode import Episode
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.config import ALONE, title_of
from vpsci_ros.exam.report import ADS, BASELINE
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.view.sources import Shown, Source, read_source, shown

MARKS = {name.removesuffix("_rate"): measure for name, measure in MEASURES.items() if measure.statistic is None}
"""Shares of episodes that the exam gives: the page filters by them, so that each number opens its episodes."""
Rows = dict[str, dict[str, Any]]  # name -> row of the table of episodes
Autopilot = Callable[[str], Sequence[Episode]]  # pedestrian -> episodes


def exam_sources(
    folder: Path, table: pl.DataFrame, autopilot: Autopilot | None, limit: int, tell: Callable[[str], None]
) -> list[Source]:
    """Return the episodes of an exam: each pedestrian with the driving system, and with the autopilot beside it.

    The driving system's are read from the bags. Where the autopilot's are not those of the table any more they are left
    out, and `tell` is called with the reason.

    :param table: a row an episode, `vpsci_ros.exam.measures.COLUMNS`.
    :param autopilot: returns the autopilot's episodes with a pedestrian; None: it is left out.
    :param limit: episodes at most with each pedestrian, those that came nearest where there are more.
    :raises InvalidInput: not one episode was driven.
    """
    marked = table.with_columns(
        (measure.column & measure.among).alias(f"mark {name}") for name, measure in MARKS.items()
    )
    rows = marked.filter(pl.col("pedestrian") != ALONE)
    found = []
    for (pedestrian,), mine in rows.group_by("pedestrian", maintain_order=True):
        own, beside = (mine.filter(pl.col("driver") == driver) for driver in (ADS, BASELINE))
        if own.height:
            chosen = _chosen(own, limit)
            bag = read_source(folder / "runs" / str(pedestrian) / "bag", limit, list(chosen), recover=True)
            found.append(_source(ADS, str(pedestrian), bag, chosen, own.height))
        if beside.height and autopilot is not None:
            found += _autopilot(autopilot(str(pedestrian)), str(pedestrian), beside, limit, tell)
    if not found:
        raise InvalidInput(f"{folder}: not one episode of this exam was driven, so there is nothing to show")
    return found


def key_of(driver: str, pedestrian: str) -> str:
    """Return the key by which addresses find a driver's episodes with a pedestrian."""
    return f"{driver}-{pedestrian}"


def _chosen(rows: pl.DataFrame, limit: int) -> Rows:
    """Return the episodes to show: those that came nearest where there are too many."""
    if rows.height > limit:
        rows = rows.sort("least_curvttc", "scenario", "episode").head(limit).sort("scenario", "episode")
    return {f"{row['scenario']}:{row['episode']}": row for row in rows.to_dicts()}


def _source(driver: str, pedestrian: str, source: Source, chosen: Rows, total: int) -> Source:
    """Return episodes with what the exam says of them: who yielded, and its shares as marks."""
    who = {ADS: "the ADS", BASELINE: "autopilot"}[driver]
    return dataclasses.replace(
        source,
        key=key_of(driver, pedestrian),
        title=f"{who}, {title_of(pedestrian)}",
        episodes=[_marked(each, chosen[each.episode.name]) for each in source.episodes],
        total=total,
    )


def _marked(each: Shown, row: dict[str, Any]) -> Shown:
    return each._replace(yielded=row["yielded"], marks=tuple(name for name in MARKS if row[f"mark {name}"]))


def _autopilot(
    episodes: Sequence[Episode], pedestrian: str, rows: pl.DataFrame, limit: int, tell: Callable[[str], None]
) -> list[Source]:
    chosen = _chosen(rows, limit)
    found = [shown(episode) for episode in episodes if episode.name in chosen]
    if any(each.episode.outcome != chosen[each.episode.name]["outcome"] for each in found):
        tell(f"the autopilot with {title_of(pedestrian)} is left out: simulated again, its episodes end otherwise, "
             "since another version of this package made the exam")  # fmt: skip
        return []
    source = Source(BASELINE, BASELINE, found[0].episode.period, found, rows.height)
    return [_source(BASELINE, pedestrian, source, chosen, rows.height)]
