"""A search with a driving system, and its files in a folder.

search.json (what is searched, and by which parameters and versions), parts/ (the runs, as an exam's), episodes.parquet
(a row for each that was driven), report.json (with the failures, the worst first, and the setting that drives them
again), report.html. The same command goes on with a search that was stopped.
"""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.episode import Key
from vpsci_ros.data.parquet import Column, write_parquet
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput, require
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.exam.conduct import run_with_all
from vpsci_ros.exam.exam import ADS, AUTOPILOTS_TIMING, Exam, identity_of, take_folder, title_of
from vpsci_ros.exam.measures import COLUMNS, EPISODES, episode_table, worst_first
from vpsci_ros.extras.exam_extra.search.imitation import lessons
from vpsci_ros.extras.exam_extra.search.plan import AT_RANDOM, Plan
from vpsci_ros.extras.exam_extra.search.risk import Count
from vpsci_ros.extras.exam_extra.search.seek import Driven, SearchConfig, seek
from vpsci_ros.report import html
from vpsci_ros.runs.files import write_json, write_text
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.workers import HERE, Site, mixed

IDENTITY = "search.json"
TITLES = {
    "moving_collision": "the vehicle hits the pedestrian while it moves",
    "collision": "the footprints touch",
    "conflict": "CurvTTC falls below the threshold of a conflict",
    "severe_conflict": "CurvTTC falls below the threshold of a severe conflict",
}
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "search.html"
_LISTED = ("scenario", "episode", "outcome", "moving_collision", "impact_speed", "least_curvttc")
_MORE = {
    "part": Column(
        pl.String, "", "of the search in which it was driven: a pilot at random, then where failures were likely"
    ),
    "margin": Column(pl.Float64, "m or s", "least margin in the last rehearsal before it was driven; NaN: it had none"),
}


class _Failed(Exception):
    """The driving system did not drive a part to its end."""


def run_search(
    exam: Exam, search: SearchConfig, folder: Path, *, workers: Site = HERE, quiet: bool = False
) -> list[str]:
    """Search, write and print the result; return the reasons for which the ADS did not drive its episodes.

    :param workers: where the runs are driven.
    :raises InvalidInput: a parameter is refused, or `folder` holds something else; nothing has been run then.
    :raises VpsciError: a node has failed.
    """
    require("sklearn", "threadpoolctl")  # which are needed only after the first part has been driven
    failure = exam.config.failure
    if exam.run.only:
        raise InvalidInput("ads-search and a list of episodes exclude each other; take world_simulator.only out")
    # The pool's episodes are too many to drive alone first.
    config = dataclasses.replace(exam.config, timing=AUTOPILOTS_TIMING, check_state=False)
    sections = exam.sections.changed("ads_test", {"timing": AUTOPILOTS_TIMING})
    exam = dataclasses.replace(exam, config=config, sections=sections)
    identity = identity_of(exam) | mixed(workers) | {"search": dataclasses.asdict(search) | {"failure": failure}}
    take_folder(folder, identity, IDENTITY)
    pool = _pool(exam, search.pool)
    tables: dict[str, pl.DataFrame] = {}

    def drive(name: str, keys: list[Key]) -> Driven:
        bars.clear()
        where = folder / "parts" / name
        keys = _chosen(where, keys)
        what, pedestrian = f"part {name} of the search, ", search.pedestrian
        run = run_with_all(exam.only(keys), where, [pedestrian], workers=workers, quiet=quiet, what=what)[pedestrian]
        if run.conduct.failure:
            raise _Failed(run.conduct.failure)
        table = episode_table(run, [], driver=ADS, pedestrian=search.pedestrian)
        tables[name] = table
        failed = dict(zip(table.select("scenario", "episode").iter_rows(), table[failure], strict=True))
        seen, done = lessons(run.episodes, exam.world.pedestrians)
        return Driven(keys, np.array([failed[key] for key in keys]), seen, done)

    try:
        with Bars(quiet=quiet) as bars:
            plan = seek(exam, search, pool, drive, bars.bar)
    except _Failed as error:
        return [str(error)]
    count = plan.count()
    table = _table(tables, plan, pool)
    write_parquet(table, folder / EPISODES, COLUMNS | _MORE, content="episodes of a search", search=identity)
    failures = worst_first(table.filter(pl.col(failure)), "margin")
    rows = [{name: _plain(row[name]) for name in _LISTED} for row in failures.to_dicts()]
    numbers = sorted((int(row["episode"]), int(row["scenario"])) for row in rows)
    report = {
        "search": identity,
        "driven": int(plan.driven.sum()),
        "failures": rows,
        "again": f"world_simulator.only={[number for episode, scenario in numbers for number in (scenario, episode)]}",
        "pool": len(pool),
        "count": count._asdict(),
        "by_part": _by_part(tables, failure),
        "plain": plain(count, int(plan.driven.sum())),
    }
    write_text(folder / "report.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    html.write_page(
        folder / "report.html",
        _TEMPLATE,
        title=f"Search for failures of {exam.config.examined}",
        report=report,
        count=report["count"],
        failure=TITLES[failure],
        pedestrian=title_of(search.pedestrian),
        at_random=AT_RANDOM,
    )
    _print(report, folder)
    return []


def plain(count: Count, driven: int) -> dict[str, float]:
    """Return how many random episodes would give an interval of this width, and their ratio to the driven ones.

    By the normal approximation, n = z^2 p (1 - p) / h^2 for half the interval's width h.
    """
    half = (count.rate_high - count.rate_low) / 2.0
    needed = 1.96**2 * count.rate * (1.0 - count.rate) / half**2
    return {"episodes": needed, "saving": needed / driven}


def _pool(exam: Exam, size: int) -> list[Key]:
    scenarios, first = exam.run.scenarios, exam.run.first_episode
    numbers = math.ceil(size / len(scenarios))
    return [(scenario, first + number) for number in range(numbers) for scenario in scenarios]


def _chosen(where: Path, keys: list[Key]) -> list[Key]:
    """Return the episodes of a part: those with which it was begun, or these, which are written down for the next time.

    Rehearsals on another number of threads differ in their last bits, and so may what they choose.
    """
    path = where / "chosen.json"
    if path.is_file():
        return [(int(scenario), int(episode)) for scenario, episode in read_json(path)]
    where.mkdir(parents=True, exist_ok=True)
    write_json(path, keys)
    return keys


def _table(tables: Mapping[str, pl.DataFrame], plan: Plan, pool: list[Key]) -> pl.DataFrame:
    margin = pl.DataFrame(
        {"scenario": [key[0] for key in pool], "episode": [key[1] for key in pool], "margin": plan.margin_before}
    )
    found = pl.concat([table.with_columns(part=pl.lit(name)) for name, table in tables.items()])
    return found.join(margin, on=["scenario", "episode"], how="left", maintain_order="left")


def _by_part(tables: Mapping[str, pl.DataFrame], failure: str) -> list[dict[str, Any]]:
    rows = []
    for name, table in tables.items():
        failed = int(table[failure].sum())
        low, high = wilson_interval(failed, table.height)
        rows.append({"part": name, "driven": table.height, "failures": failed, "low": low, "high": high})
    return rows


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def _print(report: Mapping[str, Any], folder: Path) -> None:
    count = report["count"]
    print(
        f"{len(report['failures'])} failures in {report['driven']} episodes driven; of the {report['pool']:,} searched "
        f"{count['failures']:.0f} [{count['failures_low']:.0f}, {count['failures_high']:.0f}] fail\n"
        f"failure rate {count['rate']:.3%} [{count['rate_low']:.3%}, {count['rate_high']:.3%}]; drawn at random, an "
        f"interval as narrow takes {report['plain']['episodes']:,.0f}, {report['plain']['saving']:.1f} times as many"
    )
    print(f"report: {folder / 'report.html'}")
