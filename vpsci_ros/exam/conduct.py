"""The runs of an exam: the driving system or the autopilot drives the same episodes with each pedestrian.

A driving system drives through the graph of nodes, one episode at a time (`in_graph`), or answers through the loop,
many side by side (`in_process`); so does the autopilot. Many episodes are driven in parts, each a run of its own, by
workers side by side where there are several. Each run leaves a record and its result (`result`); that of a graph is
made of its bag.
"""

import contextlib
import dataclasses
import itertools
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.episode_file import FRAMES, read_episodes
from vpsci_ros.data.gathered import Tick
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.config import EXTERNAL, SILENT_TICKS, title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_graph import counts_of, domain_of, run_in_graph
from vpsci_ros.exam.in_process import run_in_process
from vpsci_ros.exam.result import Conduct, FirstCritical, RunResult, episodes_of, read_result, write_result
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.record import RECORD, read_record
from vpsci_ros.runs.workers import computed, local_workers
from vpsci_ros.wire.layout import EVENTS
from vpsci_ros.world.counts import WorldCounts
from vpsci_ros.world.crowd import episode_rows
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING


class Run(NamedTuple):
    """A run of the driving system: with one pedestrian, on the episodes of one part of the exam."""

    pedestrian: str
    part: int

    def __str__(self) -> str:
        return label_of(self.pedestrian, self.part)


def run_with_all(
    exam: Exam,
    folder: Path,
    pedestrians: Sequence[str],
    *,
    workers: int = 1,
    quiet: bool,
    what: str = "",
) -> dict[str, RunResult]:
    """Run the driving system with each pedestrian; a finished run in `folder` is only read.

    After a run in which not one episode is driven no other begins: its failure is said once.

    :param workers: runs side by side, each in a process of its own; the results do not depend on their number.
    :param what: label of the runs in the progress.
    :raises VpsciError: a node has failed, or workers die again and again.
    :raises KeyboardInterrupt: stopped on request.
    """
    parts = exam.parts()
    runs = [Run(name, number) for name in pedestrians for number in range(len(parts))]
    waiting, found = iter(runs), dict[Run, RunResult]()
    alone = workers == 1
    titles = {run: f"{what}{n} of {len(runs)}" for n, run in enumerate(runs, 1)} if alone and not quiet else {}

    def following() -> Run | None:
        return None if any(not result.episodes for result in found.values()) else next(waiting, None)

    pool = local_workers(partial(conductor, parts, titles, folder), min(workers, len(runs)))
    with contextlib.closing(pool), Bars(quiet=quiet or alone) as bars:
        for run, result in computed(pool, following, ahead=0):
            found[run] = result
            done, wanted = sum(parts[each.part].run.total for each in found), len(exam.episodes) * len(pedestrians)
            bars.bar(f"{what}episodes", done, wanted, note=f"last: {title_of(run.pedestrian)}")
            bars.line(f"{what}{done:,} of {wanted:,} episodes", now=done == wanted)
    empty = next((n for n, run in enumerate(runs) if run in found and not found[run].episodes), len(runs))
    taken = {name: [found[run] for run in runs[: empty + 1] if run.pedestrian == name] for name in pedestrians}
    return {name: merged_results(results, len(exam.episodes)) for name, results in taken.items() if results}


def conductor(parts: Sequence[Exam], titles: Mapping[Run, str], folder: Path) -> Callable[[Run], RunResult]:
    """Return the function that runs a part of an exam with one pedestrian.

    :param titles: of the runs, for the progress; a run without one is quiet.
    """

    def conduct(run: Run) -> RunResult:
        with domain_of(parts[0]):
            return run_with(parts[run.part], run.pedestrian, folder, titles.get(run, ""), quiet=run not in titles)

    return conduct


def run_with(exam: Exam, name: str, folder: Path, which: str, *, quiet: bool) -> RunResult:
    """Run the driving system with one pedestrian in `folder`, unless the run is finished; return the result.

    :param which: label of the run in the progress.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    if is_done(exam, folder, name):
        return read_run(exam, folder, name)
    if not quiet:
        where = f"; the ADS is expected in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
        external = where if exam.config.examined == EXTERNAL and exam.driver is None else ""
        print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
    run = run_folder(folder, name, exam.part)
    shutil.rmtree(run, ignore_errors=True)
    for parent in (run.parent, folder / "logs"):
        parent.mkdir(parents=True, exist_ok=True)
    log = folder / "logs" / f"ads_{run.name}.log"
    drive = run_in_process if exam.in_process else run_in_graph
    drive(exam, name, run, log, quiet=quiet)
    return read_run(exam, folder, name)


def label_of(pedestrian: str, part: int) -> str:
    """Return the name of a run's folder: walker, walker-2, walker-3."""
    return f"{pedestrian}-{part + 1}" if part else pedestrian


def run_folder(folder: Path, pedestrian: str, part: int) -> Path:
    """Return the folder of a run of the exam in `folder`."""
    return folder / "runs" / label_of(pedestrian, part)


def driven_episodes(folder: Path, pedestrian: str) -> Iterator[Episode]:
    """Yield the episodes that an exam's driving system drove with one pedestrian, part by part.

    :raises InvalidInput: what a run left cannot be read.
    """
    found = (run_folder(folder, pedestrian, part) / FRAMES for part in itertools.count())
    for path in itertools.takewhile(Path.is_file, found):
        yield from read_episodes(path)


def merged_results(results: Sequence[RunResult], wanted: int) -> RunResult:
    """Return the results of the parts of a run as one."""
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
    return RunResult(
        episodes, conduct, unanswered, {k: v for result in results for k, v in result.first_critical.items()}
    )


def is_done(exam: Exam, folder: Path, name: str) -> bool:
    """Return whether the run of a part with a pedestrian is finished in this folder."""
    record = read_record(run_folder(folder, name, exam.part) / RECORD)
    return record is not None and not record["error"]


def read_run(exam: Exam, folder: Path, name: str) -> RunResult:
    """Return the result of a run: its ended episodes, without those that the autopilot had to finish.

    :raises InvalidInput: what it left cannot be read, though it came to its end.
    """
    run = run_folder(folder, name, exam.part)
    if not (run / FRAMES).is_file():
        record = read_record(run / RECORD)
        if record is None:
            return RunResult([], Conduct(len(exam.episodes), failure=f"{title_of(name)}: has not been run"))
        write_result(run / FRAMES, _read_bag(exam, name, run / "bag", _conduct(exam, name, record)))
    return read_result(run / FRAMES)


def _conduct(exam: Exam, name: str, record: Mapping[str, Any]) -> Conduct:
    nodes = record["results"].get("nodes", {})
    counts = counts_of({node: NodeStatus.of(values) for node, values in nodes.items()}) or WorldCounts()
    failure = f"{title_of(name)}: {record['error']}" if record["error"] else ""
    refused, surplus = counts.vehicle_commands_refused, counts.vehicle_commands_surplus
    return Conduct(len(exam.episodes), refused, surplus, counts.safe_stops, failure)


def _read_bag(exam: Exam, name: str, bag: Path, conduct: Conduct) -> RunResult:
    if conduct.failure and not bag.is_dir():
        return RunResult([], conduct)  # it failed before the recorder wrote anything
    recording = Bag(bag, recover=bool(conduct.failure))
    events = recording.topics().get(EVENTS)
    if events is not None and not events.messages:
        return RunResult([], conduct)  # no episode has begun
    unanswered: Counter[Key] = Counter()

    def count(events: NDArray[np.void]) -> None:
        for event in events:
            unanswered[int(event["scenario"]), int(event["episode"])] += int(event["kind"] == VEHICLE_ACTION_MISSING)

    try:
        found, first_critical = episodes_in_bag(recording, exam, count)
    except InvalidInput:
        if not conduct.failure:
            raise
        return RunResult([], conduct)  # whose failure says why, such as another graph's states among its own
    own = [episode for episode in found if unanswered[episode.key] < SILENT_TICKS]
    if len(own) < len(found) and not conduct.failure:
        left = f"{len(found) - len(own)} episodes were left to the autopilot for {SILENT_TICKS} ticks or more"
        conduct = dataclasses.replace(conduct, failure=left)
    return RunResult(own, conduct, dict(+unanswered), first_critical)


def episodes_in_bag(
    bag: Bag, exam: Exam, take_events: Callable[[NDArray[np.void]], None] | None = None
) -> tuple[list[Episode], Mapping[Key, FirstCritical]]:
    """Return the episodes of a bag, and the first critical pedestrian of each.

    :param take_events: called with the EVENT[n] of each message of events.
    :raises InvalidInput: it cannot be read, or holds an episode that is not of this exam.
    """
    own = set(exam.episodes)

    def ticks() -> Iterator[Tick]:
        for tick in read_bag(bag, take_events=take_events):
            for rows in episode_rows(tick.state):
                first = tick.state[rows[0]]
                if (key := (int(first["scenario"]), int(first["episode"]))) not in own:
                    raise InvalidInput(f"{bag.path}: episode {key[0]}:{key[1]} is another graph's, not of this exam")
            yield tick.state, tick.curvttc, tick.distance

    return episodes_of(ticks(), exam.world.tick, exam.scenarios, str(bag))
