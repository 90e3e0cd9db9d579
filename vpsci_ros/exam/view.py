"""An exam's episodes for the page that plays them: the driving system beside the autopilot."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.episode import Episode
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, EXAM, title_of
from vpsci_ros.exam.measures import read_episode_table
from vpsci_ros.exam.result import EpisodeFile, exam_runs
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.safety import VEHICLE_LENGTH, contact_step
from vpsci_ros.view.view_page import Shown, Source

MARKS = {name.removesuffix("_rate"): measure for name, measure in MEASURES.items() if measure.statistic is None}
"""Filter of the page -> the measure, a share of episodes, whose episodes it shows."""
_DRIVERS = {ADS: "the ADS", BASELINE: "autopilot"}


def is_exam(path: Path) -> bool:
    """Return whether a path is the folder of an exam."""
    return (path / EXAM).is_file()


def read_exam(folder: Path, limit: int) -> list[Source]:
    """Return the episodes of a finished exam, see `exam_sources`.

    :raises InvalidInput: the exam is not whole, or not one episode of it was driven.
    """
    table = read_episode_table(folder)
    drivers = (ADS, BASELINE) if (folder / BASELINE).is_dir() else (ADS,)
    names = table["pedestrian"].unique().to_list()
    episodes = {driver: {name: stored_episodes(folder, driver, name) for name in names} for driver in drivers}
    path = folder / "report.json"
    failure = read_json(path).get("failure", "collision") if path.is_file() else "collision"
    found = exam_sources(table, episodes, limit, failure)
    if not found:
        raise InvalidInput(f"{folder}: not one episode of this exam was driven, so there is nothing to show")
    return found


def stored_episodes(folder: Path, driver: str, pedestrian: str) -> Iterator[Episode]:
    """Yield the stored episodes of a driver, the ADS or the autopilot, with one pedestrian, part by part.

    :raises InvalidInput: there is no file, or one cannot be read.
    """
    paths = [path for name, path in exam_runs(folder) if name == pedestrian]
    if driver == BASELINE:
        paths = [autopilot_file(folder, pedestrian)]
    elif not paths:
        raise InvalidInput(f"{folder}: no finished run with {pedestrian}; give the exam's command again")
    for path in paths:
        yield from EpisodeFile(path).read()


def autopilot_file(folder: Path, pedestrian: str) -> Path:
    """Return the file with the baseline's episodes with one pedestrian."""
    return folder / BASELINE / f"{pedestrian}.parquet"


def exam_sources(
    table: pl.DataFrame,
    episodes: Mapping[str, Mapping[str, Iterable[Episode]]],
    limit: int,
    failure: str = "collision",
) -> list[Source]:
    """Return the sources of an exam's page: for each pedestrian the ADS's episodes, then the autopilot's.

    :param table: a row an episode, `vpsci_ros.exam.measures.COLUMNS`.
    :param episodes: of `ADS` and, unless it is left out, of `BASELINE`, by pedestrian; read one after the other.
    :param limit: episodes at most with each pedestrian, those that came nearest where there are more.
    :param failure: column of what counts as a failure; these and all contacts have the group of their failure.
    """
    marked = table.with_columns(
        (measure.column & measure.among).alias(f"mark {name}") for name, measure in MARKS.items()
    ).with_columns(grouped=pl.col(failure) | pl.col("collision") | pl.col("parked_collision"))
    rows = marked.filter(pl.col("pedestrian") != ALONE)
    found = []
    for (pedestrian,), of_both in rows.group_by("pedestrian", maintain_order=True):
        for driver, by_pedestrian in episodes.items():
            if (mine := of_both.filter(pl.col("driver") == driver)).height:
                found.append(_source(driver, str(pedestrian), by_pedestrian[str(pedestrian)], mine, limit))
    return found


def _source(driver: str, pedestrian: str, episodes: Iterable[Episode], rows: pl.DataFrame, limit: int) -> Source:
    """Return a driver's episodes with what the exam says of them."""
    chosen, title = _chosen(rows, limit), f"{_DRIVERS[driver]}, {title_of(pedestrian)}"
    found = [_shown(episode, chosen[episode.name]) for episode in episodes if episode.name in chosen]
    return Source(f"{driver}-{pedestrian}", title, found[0].episode.period, found, rows.height)


def _chosen(rows: pl.DataFrame, limit: int) -> dict[str, dict[str, Any]]:
    """Return name -> row of the episodes to show: those that came nearest where there are too many."""
    if rows.height > limit:
        rows = rows.sort("least_curvttc", "scenario", "episode").head(limit).sort("scenario", "episode")
    return {f"{row['scenario']}:{row['episode']}": row for row in rows.to_dicts()}


def _shown(episode: Episode, row: dict[str, Any]) -> Shown:
    """Return an episode with who yielded by the exam, its shares as marks, and the group of its failure."""
    marks = tuple(name for name in MARKS if row[f"mark {name}"])
    marks += ("beyond_range",) if row["range"] == "beyond" else ()
    return Shown(episode, row["yielded"], marks, failure_group(row, episode) if row["grouped"] else "")


def failure_group(row: Mapping[str, Any], episode: Episode) -> str:
    """Return the common properties of failures such as this episode, in words, by which the page filters.

    Scenario, kind of the pedestrian, whether parked vehicles hid it as it became critical, what touched, and who came
    to the contact first.

    :param row: of it in the table of episodes, `vpsci_ros.exam.measures.COLUMNS`.
    """
    contact = "hits a parked vehicle" if row["parked_collision"] else "no contact"
    if row["collision"]:
        contact = "moving vehicle" if row["moving_collision"] else "standing vehicle"
    first = came_first(episode)
    who = f"{row['kind'] or 'adult'} {'hidden' if row['hidden'] else 'in sight'}"
    return f"{row['scenario']}: {who}, {contact}{f', {first} came first' if first else ''}"


def came_first(episode: Episode) -> str:
    """Return "pedestrian" or "vehicle", the agent that came first to the contact point; "" without a contact."""
    if episode.outcome != "collision":
        return ""
    seen = episode.pair().filled()
    dx, dy = seen.ped_x[0] - seen.x, seen.ped_y[0] - seen.y
    forward = np.cos(seen.heading) * dx + np.sin(seen.heading) * dy
    touched = contact_step(seen.x, seen.y, seen.heading, seen.ped_x[0], seen.ped_y[0])
    at_contact = np.interp(touched, np.arange(len(seen)), forward)  # the last frame where they are not seen to touch
    return "pedestrian" if at_contact >= 0.5 * VEHICLE_LENGTH else "vehicle"
