"""The runs of an exam: the driving system drives the same episodes with each pedestrian.

A driving system drives through the graph of nodes, one episode at a time (`in_graph`), or answers through the loop,
many side by side (`in_process`). Many episodes are driven in parts, each a run of its own, by workers side by side
where there are several. Each run leaves a record and its result (`result`).
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.exam.exam import Exam, HeadStarts, identity_of
from vpsci_ros.exam.exam_config import EXTERNAL, title_of
from vpsci_ros.exam.in_graph import domain_of, run_in_graph
from vpsci_ros.exam.in_process import run_in_process
from vpsci_ros.exam.result import Conduct, RunResult, label_of, read_result, run_folder
from vpsci_ros.exam.travel import arrived, files_to_take
from vpsci_ros.runs.journal import finished, write_item_record
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.record import RUN_RECORD, read_record
from vpsci_ros.runs.workers import HERE, Place, Site, Work, Workers, computed

RESULT = "result.json"  # what a finished run is, and the hash of each of its files


class Run(NamedTuple):
    """A run of the driving system: with one pedestrian, on the episodes of one part of the exam."""

    pedestrian: str
    part: int

    def __str__(self) -> str:
        return label_of(self.pedestrian, self.part)


class TimedRun(NamedTuple):
    """A run with the timing of its pedestrians, which is known only after the run on the empty road.

    :ivar head_starts: of its episodes.
    :ivar title: label of the run in the progress; empty: the run is quiet.
    """

    run: Run
    head_starts: HeadStarts
    title: str

    def __str__(self) -> str:
        return str(self.run)


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
    job = partial(conductor, parts, [exam_digest(part) for part in parts])
    reads = partial(files_to_take, exam)
    work = Work(job, folder, most * len(parts), reads, whole_host=not exam.in_process)
    with contextlib.ExitStack() as stack:
        pool = cache(lambda: stack.enter_context(contextlib.closing(workers.start(work))))
        yield partial(_driven, parts, folder, workers, pool, quiet, what)


def run_with_all(
    exam: Exam, folder: Path, pedestrians: Sequence[str], *, workers: Site = HERE, quiet: bool, what: str = ""
) -> dict[str, RunResult]:
    """Return the driving system's result with each pedestrian, see `drives`."""
    with drives(exam, folder, workers=workers, most=len(pedestrians), quiet=quiet, what=what) as drive:
        return drive(pedestrians, exam.head_starts)


def _driven(
    parts: Sequence[Exam],
    folder: Path,
    site: Site,
    pool: Callable[[], Workers[TimedRun, None]],
    quiet: bool,
    what: str,
    pedestrians: Sequence[str],
    head_starts: HeadStarts,
) -> dict[str, RunResult]:
    """Return the driving system's result with each pedestrian, see `drives`."""
    own = [dataclasses.replace(part, head_starts=_of(part, head_starts)) for part in parts]
    runs = [Run(name, number) for name in pedestrians for number in range(len(own))]
    waiting, found = iter(enumerate(runs, 1)), dict[Run, RunResult]()

    def take(run: Run) -> None:
        found[run] = read_result(folder, run.pedestrian, run.part)

    def following() -> TimedRun | None:
        while all(result.episodes for result in found.values()) and (numbered := next(waiting, None)):
            number, run = numbered
            if not is_done(own[run.part], folder, run.pedestrian):
                shutil.rmtree(run_folder(folder, run.pedestrian, run.part), ignore_errors=True)
                title = f"{what}{number} of {len(runs)}" if site.alone and not quiet else ""
                return TimedRun(run, own[run.part].head_starts, title)
            take(run)
        return None

    todo = list(filter(None, [following()]))
    if todo:
        units = computed(pool(), lambda: todo.pop() if todo else following(), ahead=False)
        with Bars(quiet=quiet or site.alone, where=site.hosts) as bars:
            for timed, _ in units:
                take(timed.run)
                done = sum(own[each.part].run.total for each in found)
                wanted = sum(part.run.total for part in own) * len(pedestrians)
                bars.bar(f"{what}episodes", done, wanted, note=f"last: {title_of(timed.run.pedestrian)}")
                bars.line(f"{what}{done:,} of {wanted:,} episodes", now=done == wanted)
    empty = next((n for n, run in enumerate(runs) if run in found and not found[run].episodes), len(runs))
    taken = {name: [found[run] for run in runs[: empty + 1] if run.pedestrian == name] for name in pedestrians}
    most = sum(len(part.episodes) for part in own)
    return {name: merged_results(results, most) for name, results in taken.items() if results}


def _of(part: Exam, head_starts: HeadStarts) -> HeadStarts:
    return {key: head_starts[key] for key in part.episodes if key in head_starts}


def conductor(parts: Sequence[Exam], digests: Sequence[str], place: Place) -> Callable[[TimedRun], None]:
    """Return a function that does a `Run`, one part of an exam with one pedestrian, whose result is in its files.

    :param digests: `exam_digest` of each part, where the exam was prepared.
    """
    own = [arrived(part, place) for part in parts]

    def conduct(timed: TimedRun) -> None:
        run = timed.run
        exam, digest = dataclasses.replace(own[run.part], head_starts=timed.head_starts), digests[run.part]
        with domain_of(exam):
            run_with(exam, run.pedestrian, place.folder, timed.title, quiet=not timed.title, digest=digest)

    return conduct


def run_with(exam: Exam, name: str, folder: Path, which: str, *, quiet: bool, digest: str = "") -> None:
    """Run the driving system with one pedestrian in `folder`, unless the run is finished; see `read_result`.

    :param which: label of the run in the progress.
    :param digest: `exam_digest` of the exam; empty: that of this machine.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    run = run_folder(folder, name, exam.part)
    if is_done(exam, folder, name):
        return
    if not quiet:
        where = f"; the ADS is expected in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
        external = where if exam.config.examined == EXTERNAL and exam.driver is None else ""
        print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
    shutil.rmtree(run, ignore_errors=True)
    for parent in (run.parent, folder / "logs"):
        parent.mkdir(parents=True, exist_ok=True)
    log = folder / "logs" / f"ads_{label_of(name, exam.part)}.log"
    drive = run_in_process if exam.in_process else run_in_graph
    drive(exam, name, run, log, quiet=quiet)
    write_item_record(run / RESULT, run_identity(exam, name, digest))


def run_identity(exam: Exam, name: str, digest: str = "") -> dict[str, Any]:
    """Return what a run is, as JSON values: its pedestrian, part and episodes, and the hash of the exam's identity."""
    starts = [list(exam.head_starts.get(key, (0.0, 0.0))) for key in exam.episodes] if exam.head_starts else None
    own = {"pedestrian": name, "part": exam.part + 1, "episodes": [list(key) for key in exam.episodes]}
    return {**own, "head_starts": starts, "exam_sha256": digest or exam_digest(exam)}


def exam_digest(exam: Exam) -> str:
    """Return a SHA-256 of an exam's identity."""
    return hashlib.sha256(json.dumps(identity_of(exam), sort_keys=True).encode()).hexdigest()


def merged_results(results: Sequence[RunResult], wanted: int) -> RunResult:
    """Return the results of all parts of an exam with one pedestrian, of `wanted` episodes, as one result."""
    conducts = [result.conduct for result in results]
    failures = [conduct.failure for conduct in conducts if conduct.failure]
    others = f" (so did {len(failures) - 1} more of its runs)" if len(failures) > 1 else ""
    conduct = Conduct(
        wanted,
        sum(each.refused for each in conducts),
        sum(each.surplus for each in conducts),
        sum(each.safe_stops for each in conducts),
        failures[0] + others if failures else "",
    )
    episodes = sorted((episode for result in results for episode in result.episodes), key=lambda episode: episode.key)
    unanswered = {key: count for result in results for key, count in result.unanswered.items()}
    return RunResult(episodes, conduct, unanswered)


def is_done(exam: Exam, folder: Path, name: str) -> bool:
    """Return whether `folder` has the exam's finished run with the pedestrian `name`, its files unchanged."""
    run = run_folder(folder, name, exam.part)
    record = read_record(run / RUN_RECORD)
    if record is None or record["error"]:
        return False
    return finished(run / RESULT, run_identity(exam, name), "it is driven again") is not None
