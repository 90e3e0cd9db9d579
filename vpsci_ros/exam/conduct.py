"""The order of an exam's runs, and the exam from its first run to its report.

The driving system drives the empty road, then the same episodes with each pedestrian. Many episodes are driven in
parts, each a run of its own (`run`), by workers side by side where there are several.

In the output folder: exam.json (what is examined: parameters, hashes, versions), runs/PEDESTRIAN/PART (its record, and
its episodes in frames.parquet), logs/, autopilot/ (episodes of the baseline), episodes.parquet, report.json,
report.html, summary.md, junit.xml, pictures, and view.html, in which the episodes play. The same command resumes a
stopped exam: it reads the finished runs of the driving system, and runs the others and the baseline.
"""

import contextlib
import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import polars as pl

from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.exam.comparison import compare, compared_with, failing
from vpsci_ros.exam.criteria import check, parse, sentence
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, OWN_TIMING, Exam, identity_of, take_folder, title_of
from vpsci_ros.exam.junit import write_junit
from vpsci_ros.exam.markdown import write_summary
from vpsci_ros.exam.measures import COLUMNS, EPISODES, episode_table
from vpsci_ros.exam.report import make_report, standing
from vpsci_ros.exam.report_page import write_page
from vpsci_ros.exam.result import Conduct, RunResult, label_of, read_result, run_folder
from vpsci_ros.exam.run import autopilot_run, is_done, run_with
from vpsci_ros.exam.terminal import print_report
from vpsci_ros.exam.timing import Timing, head_starts, not_met, summary, timing_of
from vpsci_ros.exam.travel import arrived, files_to_take
from vpsci_ros.exam.view import autopilot_file, exam_sources
from vpsci_ros.lockstep.intervention import HeadStarts
from vpsci_ros.runs.files import write_text
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.workers import HERE, Place, Site, Work, computed, mixed
from vpsci_ros.view.view_page import LIMIT, write_view

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


class Run(NamedTuple):
    """A run of the driving system: with one pedestrian, on the episodes of one part of the exam.

    :ivar head_starts: of its episodes, which are known only after the run on the empty road.
    :ivar title: label of the run in the progress; empty: the run is quiet.
    """

    pedestrian: str
    part: int
    head_starts: HeadStarts
    title: str

    def __str__(self) -> str:
        return label_of(self.pedestrian, self.part)


DriveWith = Callable[[Sequence[str], HeadStarts], dict[str, RunResult]]


@contextlib.contextmanager
def drives(
    exam: Exam, folder: Path, *, workers: Site = HERE, most: int, quiet: bool, what: str = ""
) -> Iterator[DriveWith]:
    """Yield a function that returns the driving system's result with each pedestrian that it is given.

    A finished run in `folder` is read, not repeated. After a run in which the system completes no episode, no further
    run of the call begins. The workers start at the first run, and drive those of all calls.

    :param workers: where the runs are driven; the results do not depend on it.
    :param most: pedestrians of a call, at most.
    :param what: label of the runs in the progress.
    :raises VpsciError: a node has failed, or workers die again and again.
    :raises KeyboardInterrupt: stopped on request.
    """
    parts = exam.parts()
    reads = partial(files_to_take, exam)
    work = Work(partial(conductor, parts), folder, most * len(parts), reads, whole_host=not exam.in_process)

    def drive(pedestrians: Sequence[str], head_starts: HeadStarts) -> dict[str, RunResult]:
        timed = [{key: head_starts[key] for key in part.episodes if key in head_starts} for part in parts]
        own = [dataclasses.replace(part, head_starts=starts) for part, starts in zip(parts, timed, strict=True)]
        runs = [(name, number) for name in pedestrians for number in range(len(own))]
        waiting, found = iter(enumerate(runs, 1)), dict[tuple[str, int], RunResult]()

        def following() -> Run | None:
            while all(result.episodes for result in found.values()) and (numbered := next(waiting, None)):
                number, (name, part) = numbered
                if not is_done(own[part], folder, name):
                    shutil.rmtree(run_folder(folder, name, part), ignore_errors=True)
                    label = f"{what}{number} of {len(runs)}" * (workers.alone and not quiet)
                    return Run(name, part, timed[part], label)
                found[name, part] = read_result(folder, name, part)
            return None

        todo = list(filter(None, [following()]))
        if todo:
            units = computed(pool(), lambda: todo.pop() if todo else following(), ahead=False)
            with Bars(quiet=quiet or workers.alone, where=workers.hosts) as bars:
                for run, _ in units:
                    found[run.pedestrian, run.part] = read_result(folder, run.pedestrian, run.part)
                    done = sum(own[part].run.total for _, part in found)
                    wanted = sum(part.run.total for part in own) * len(pedestrians)
                    bars.bar(f"{what}episodes", done, wanted, note=f"last: {title_of(run.pedestrian)}")
                    bars.line(f"{what}{done:,} of {wanted:,} episodes", now=done == wanted)
        empty = next((n for n, run in enumerate(runs) if run in found and not found[run].episodes), len(runs))
        taken = {name: [found[run] for run in runs[: empty + 1] if run[0] == name] for name in pedestrians}
        whole = sum(len(part.episodes) for part in own)
        return {name: merged_results(results, whole) for name, results in taken.items() if results}

    with contextlib.ExitStack() as stack:
        pool = cache(lambda: stack.enter_context(contextlib.closing(workers.start(work))))
        yield drive


def run_with_all(
    exam: Exam, folder: Path, pedestrians: Sequence[str], *, workers: Site = HERE, quiet: bool, what: str = ""
) -> dict[str, RunResult]:
    """Return the driving system's result with each pedestrian, see `drives`."""
    with drives(exam, folder, workers=workers, most=len(pedestrians), quiet=quiet, what=what) as drive:
        return drive(pedestrians, exam.head_starts)


def conductor(parts: Sequence[Exam], place: Place) -> Callable[[Run], None]:
    """Return a function that does a `Run`, one part of an exam with one pedestrian, whose result is in its files."""
    own = [arrived(part, place) for part in parts]

    def conduct(run: Run) -> None:
        exam = dataclasses.replace(own[run.part], head_starts=run.head_starts)
        run_with(exam, run.pedestrian, place.folder, run.title)

    return conduct


def merged_results(results: Sequence[RunResult], wanted: int) -> RunResult:
    """Return the results of all parts of an exam with one pedestrian, of `wanted` episodes, as one result."""
    conducts = [result.conduct for result in results]
    failures = [conduct.failure for conduct in conducts if conduct.failure]
    others = f" (so did {len(failures) - 1} more of its runs)" if len(failures) > 1 else ""
    names = ("refused", "surplus", "safe_stops")
    refused, surplus, stops = (sum(getattr(each, name) for each in conducts) for name in names)
    conduct = Conduct(wanted, refused, surplus, stops, failures[0] + others if failures else "")
    episodes = sorted((episode for result in results for episode in result.episodes), key=lambda episode: episode.key)
    unanswered = {key: count for result in results for key, count in result.unanswered.items()}
    return RunResult(episodes, conduct, unanswered)
