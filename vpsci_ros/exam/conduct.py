"""The runs of an exam: a driving system, or the autopilot, meets one pedestrian after the other on the same episodes.

A driving system drives through the graph of nodes, one episode at a time (`in_graph`), or answers through the loop,
many side by side (`in_process`); so does the autopilot. Many episodes are driven in parts, each a run of its own, by
workers side by side where there are several.
"""

import contextlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.exam.collect import is_done, joined, label_of, read_run, run_folder
from vpsci_ros.exam.config import EXTERNAL, title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_graph import domain_of, run_in_graph
from vpsci_ros.exam.in_process import run_in_process
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.workers import Workers, computed, local_workers


class Run(NamedTuple):
    """A run of the driving system: with one pedestrian, on the episodes of one part of the exam."""

    pedestrian: str
    part: int

    def __str__(self) -> str:
        return label_of(self.pedestrian, self.part)


Conductor = Callable[[Path], Callable[[Run], RunResult]]
"""Made of the output folder, conducts a run."""
Crew = Callable[[Conductor, Path, int | None], Workers[Run, RunResult]]
"""Returns who does the runs in a folder, so many side by side; None: it decides itself."""


def local_crew(here: Conductor, folder: Path, workers: int | None) -> Workers[Run, RunResult]:
    """Return workers of this machine."""
    return local_workers(partial(here, folder), workers or 1)


def run_with_all(
    exam: Exam,
    folder: Path,
    pedestrians: Sequence[str],
    *,
    workers: int | None = None,
    crew: Crew = local_crew,
    quiet: bool,
    what: str = "",
) -> dict[str, RunResult]:
    """Have the driving system meet one pedestrian after the other; a run that is done in `folder` is only read.

    After a run in which not one episode is driven no other begins: its failure is said once.

    :param workers: runs side by side, each in a process of its own; the results do not depend on their number.
    :param what: label of the runs in the progress.
    :raises VpsciError: a node has failed, or workers die again and again.
    :raises KeyboardInterrupt: stopped on request.
    """
    parts = exam.parts()
    runs = [Run(name, number) for name in pedestrians for number in range(len(parts))]
    waiting, found, begun = iter(runs), dict[Run, RunResult](), time.monotonic()
    alone = crew is local_crew and (workers or 1) == 1
    titles = {run: f"{what}{n} of {len(runs)}" for n, run in enumerate(runs, 1)} if alone and not quiet else {}

    def following() -> Run | None:
        return None if any(not result.episodes for result in found.values()) else next(waiting, None)

    pool = crew(partial(conductor, parts, titles), folder, workers and min(workers, len(runs)))
    with contextlib.closing(pool), Bars(quiet=quiet or alone) as bars:
        for run, result in computed(pool, following, ahead=0):
            found[run] = result
            done, wanted = sum(parts[each.part].run.total for each in found), len(exam.episodes) * len(pedestrians)
            bars.bar(f"{what}episodes", done, wanted, note=f"last: {title_of(run.pedestrian)}")
            left = (time.monotonic() - begun) / 60.0 * (wanted - done) / done
            bars.line(f"{what}{done:,} of {wanted:,} episodes, {left:.1f} min left", now=True)
    empty = next((n for n, run in enumerate(runs) if run in found and not found[run].episodes), len(runs))
    taken = {name: [found[run] for run in runs[: empty + 1] if run.pedestrian == name] for name in pedestrians}
    return {name: joined(results, len(exam.episodes)) for name, results in taken.items() if results}


def conductor(parts: Sequence[Exam], titles: Mapping[Run, str], folder: Path) -> Callable[[Run], RunResult]:
    """Return what conducts the runs of an exam's parts, in a process of its own or not.

    :param titles: of the runs, for the progress; a run without one is quiet.
    """

    def conduct(run: Run) -> RunResult:
        with domain_of(parts[0]):
            return run_with(parts[run.part], run.pedestrian, folder, titles.get(run, ""), quiet=run not in titles)

    return conduct


def run_with(exam: Exam, name: str, folder: Path, which: str, *, quiet: bool) -> RunResult:
    """Have the driving system meet one pedestrian in `folder`, unless it has done so there; return the result.

    :param which: label of the run in the progress.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    if is_done(exam, folder, name):
        return read_run(exam, folder, name)
    if not quiet:
        where = f"; the ADS is expected in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
        external = where if exam.config.examined == EXTERNAL and exam.seat is None else ""
        print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
    run = run_folder(folder, name, exam.part)
    shutil.rmtree(run, ignore_errors=True)
    for parent in (run.parent, folder / "logs"):
        parent.mkdir(parents=True, exist_ok=True)
    log = folder / "logs" / f"ads_{run.name}.log"
    if exam.in_process:
        return run_in_process(exam, name, run, log, quiet=quiet)
    run_in_graph(exam, name, run, log, quiet=quiet)
    return read_run(exam, folder, name)
