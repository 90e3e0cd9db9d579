"""The exam of a driving system: running, scoring and reporting it.

In the output folder: exam.json (what is examined: parameters, hashes, versions), runs/PEDESTRIAN/PART (its record, and
its episodes in frames.parquet), logs/, autopilot/ (episodes of the baseline), episodes.parquet, report.json,
report.html, summary.md, junit.xml, pictures, and view.html, in which the episodes play. The same command resumes a
stopped exam: it reads the finished runs of the driving system, and runs the others and the baseline.
"""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import polars as pl

from vpsci_ros.data.episode import ALONE
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.exam.comparison import compare, compared_with, failing
from vpsci_ros.exam.conduct import drives
from vpsci_ros.exam.criteria import check, parse, sentence
from vpsci_ros.exam.exam import Exam, identity_of, take_folder
from vpsci_ros.exam.exam_config import ADS, BASELINE, OWN_TIMING
from vpsci_ros.exam.in_process import autopilot_run
from vpsci_ros.exam.junit import write_junit
from vpsci_ros.exam.markdown import write_summary
from vpsci_ros.exam.measures import COLUMNS, EPISODES, episode_table
from vpsci_ros.exam.report import make_report, standing
from vpsci_ros.exam.report_page import print_report, write_page
from vpsci_ros.exam.result import RunResult
from vpsci_ros.exam.timing import Timing, head_starts, not_met, summary, timing_of
from vpsci_ros.exam.view import autopilot_file, exam_sources
from vpsci_ros.runs.files import write_text
from vpsci_ros.runs.workers import HERE, Site, mixed
from vpsci_ros.view.pack import LIMIT
from vpsci_ros.view.view_page import write_view

VIEW, REPORT = "view.html", "report.html"


def run_exam(
    exam: Exam,
    folder: Path,
    criteria: Sequence[str] = (),
    *,
    workers: Site = HERE,
    against: Path | None = None,
    quiet: bool = False,
) -> list[str]:
    """Run the exam, write and print its report, and return the reasons for failing; empty if it is passed.

    :param criteria: as for --fail-if, in addition to those of the parameters.
    :param workers: where the runs are driven.
    :param against: folder of an earlier exam to compare with.
    :raises InvalidInput: a criterion is refused, or `folder` holds something else; nothing has been run then.
    :raises VpsciError: a node has failed.
    """
    pedestrians = exam.config.opponents
    understood = partial(parse, opponents=pedestrians, compared=against is not None)
    parsed = [understood(text) for text in (*exam.config.fail_if, *criteria)]
    identity = identity_of(exam) | mixed(workers)
    earlier = None if against is None else compared_with(exam, identity, against)
    take_folder(folder, identity)

    driven, timing = timed_runs(exam, folder, workers=workers, against=against, quiet=quiet)
    runs = {ADS: driven}
    if exam.config.baseline:
        (folder / BASELINE).mkdir(exist_ok=True)
        runs[BASELINE] = {name: autopilot_run(exam, name, autopilot_file(folder, name)) for name in pedestrians}
        runs[BASELINE][ALONE] = autopilot_run(exam, ALONE)
    table = pl.concat(_rows(exam, driver, runs[driver], timing if driver == ADS else {}) for driver in runs)
    report = make_report(table, {name: run.conduct for name, run in runs[ADS].items()}, exam.config, exam.perception)
    report["timing"] = summary(timing, table) if timing else None
    if earlier is not None:
        report["against"] = compare(table, earlier, exam)
    verdicts = check(parsed, report, pedestrians)
    failures = [run.conduct.failure for run in runs[ADS].values() if run.conduct.failure]
    stands = standing(report)
    failures += [] if exam.config.allow_standing else [stands] if stands else not_met(report)
    failures += [sentence(verdict) for verdict in verdicts if verdict["failed"]]
    report = {"exam": identity, "failures": failures, "criteria": verdicts} | report

    write_parquet(table, folder / EPISODES, COLUMNS, content="episodes of an exam", exam=identity)
    write_text(folder / "report.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    view = VIEW if report["drivers"].get(ADS) else ""
    episodes = {driver: {name: run.episodes for name, run in found.items()} for driver, found in runs.items()}
    if view:
        sources = exam_sources(table, episodes, LIMIT, report["failure"])
        write_view(folder / view, sources, f"Exam of {exam.config.examined}")
    write_page(folder / REPORT, report, table, episodes[ADS], view)
    listed = failing(report, table)
    write_summary(folder, report, listed, view)
    write_junit(folder, report, listed)
    print_report(report, folder / REPORT)
    return failures


def timed_runs(
    exam: Exam, folder: Path, *, workers: Site = HERE, against: Path | None = None, quiet: bool
) -> tuple[dict[str, RunResult], Timing]:
    """Return the driving system's result on the empty road and with each pedestrian, and how episodes were timed.

    :param against: folder of an earlier exam, whose timing is taken where it is nearly the same.
    :raises VpsciError: a node has failed.
    """
    with drives(exam, folder, workers=workers, most=len(exam.config.opponents), quiet=quiet) as drive:
        if exam.person:
            return drive(exam.config.opponents, {}), {}
        runs = drive([ALONE], {})
        timing: Timing = {}
        if not runs[ALONE].episodes:
            return runs, timing
        if exam.config.timing == OWN_TIMING:
            timing = timing_of(exam, runs[ALONE].episodes, folder, against)
        return runs | drive(exam.config.opponents, head_starts(timing)), timing


def _rows(exam: Exam, driver: str, runs: Mapping[str, RunResult], timing: Timing) -> pl.DataFrame:
    """Return the table of a driver's episodes; the baseline's episodes on the empty road only serve as a reference."""
    names = [name for name in runs if driver == ADS or name != ALONE]
    alone = runs[ALONE].episodes if ALONE in runs else []
    return pl.concat(
        episode_table(
            runs[name],
            alone,
            driver=driver,
            pedestrian=name,
            reach=exam.reach(name),
            timing={} if name == ALONE else timing,
        )
        for name in names
    )
