"""The results of an exam's runs, read from what they left, and put together where a pedestrian has several runs.

A run of the graph leaves a bag, any other its episodes (`vpsci_ros.data.kept`); both leave a record.
"""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.bags.episodes import read_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.gathered import Tick, gathered
from vpsci_ros.data.kept import KEPT, read_kept
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.config import EXTERNAL, title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.report import Conduct
from vpsci_ros.exam.sight import Sight, Watcher
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.record import RECORD, read_record
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import Decoder
from vpsci_ros.wire.layout import EVENTS
from vpsci_ros.world import IDLE
from vpsci_ros.world.counts import WorldCounts
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING


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
    runs = (run_folder(folder, pedestrian, part) for part in itertools.count())
    for run in itertools.takewhile(Path.is_dir, runs):
        kept = run / KEPT
        yield from read_kept(kept) if kept.is_file() else read_episodes(Bag(run / "bag", recover=True))


def joined(results: Sequence[RunResult], wanted: int) -> RunResult:
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
    return RunResult(episodes, conduct, unanswered, {k: v for result in results for k, v in result.sight.items()})


def is_done(exam: Exam, folder: Path, name: str) -> bool:
    """Say whether the run of a part with a pedestrian has come to its end in this folder."""
    record = read_record(run_folder(folder, name, exam.part) / RECORD)
    return record is not None and not record["error"]


def read_run(exam: Exam, folder: Path, name: str) -> RunResult:
    """Return the result of a run: the episodes that ended, without those that were left to the autopilot.

    :raises InvalidInput: what it left cannot be read, though it came to its end.
    """
    run = run_folder(folder, name, exam.part)
    record = read_record(run / RECORD)
    if record is None:
        return RunResult([], Conduct(len(exam.episodes), failure=f"{title_of(name)}: has not been run"))
    conduct = _conduct(exam, name, record)
    if not (run / KEPT).is_file():
        return _read_bag(exam, name, run / "bag", conduct)
    sight = {(each.pop("scenario"), each.pop("episode")): Sight(**each) for each in record["results"]["sight"]}
    return RunResult(read_kept(run / KEPT), conduct, sight=sight)


def sight_record(sight: Mapping[Key, Sight]) -> list[dict[str, Any]]:
    """Return what could be seen, as a record has it."""
    return [{"scenario": key[0], "episode": key[1]} | dataclasses.asdict(seen) for key, seen in sight.items()]


def counts_of(nodes: Mapping[str, NodeStatus]) -> WorldCounts | None:
    """Return what the world of a graph has counted; None where it has reported nothing."""
    return nodes["world_simulator"].counts if "world_simulator" in nodes else None


def _conduct(exam: Exam, name: str, record: Mapping[str, Any]) -> Conduct:
    nodes = record["results"].get("nodes", {})
    counts = counts_of({node: NodeStatus.of(values) for node, values in nodes.items()}) or WorldCounts()
    failure = f"{title_of(name)}: {record['error']}" if record["error"] else ""
    refused, surplus = counts.vehicle_commands_refused, counts.vehicle_commands_surplus
    return Conduct(len(exam.episodes), refused, surplus, counts.safe_stops, failure)


def _read_bag(exam: Exam, name: str, bag: Path, conduct: Conduct) -> RunResult:
    silent_ticks = exam.config.silent_ticks
    if conduct.failure and not bag.is_dir():
        return RunResult([], conduct)  # it failed before the recorder wrote anything
    recording = Bag(bag, recover=bool(conduct.failure))
    events = recording.topics().get(EVENTS)
    if events is not None and not events.messages:
        return RunResult([], conduct)  # no episode has begun
    unanswered: Counter[Key] = Counter()
    decode = Decoder()
    for raw in recording.messages([EVENTS]):
        for event in layout.events(decode(raw, bag)):
            unanswered[int(event["scenario"]), int(event["episode"])] += int(event["kind"] == VEHICLE_ACTION_MISSING)
    try:
        found, sight = episodes_in_bag(recording, exam, name)
    except InvalidInput:
        if not conduct.failure:
            raise
        return RunResult([], conduct)  # whose failure says why, such as another graph's states among its own
    own = [episode for episode in found if unanswered[episode.key] < silent_ticks]
    if len(own) < len(found) and not conduct.failure:
        left = f"{len(found) - len(own)} episodes were left to the autopilot for {silent_ticks} ticks or more"
        conduct = dataclasses.replace(conduct, failure=left)
    return RunResult(own, conduct, dict(+unanswered), sight)


def episodes_in_bag(bag: Bag, exam: Exam, pedestrian: str) -> tuple[list[Episode], Mapping[Key, Sight]]:
    """Return the episodes of a bag of the ADS with one of the pedestrians, and what it could see of each.

    Messages hold neither the kind of the pedestrians nor their number: both are drawn again.
    """
    several = exam.with_pedestrian(pedestrian, EXTERNAL).pedestrians
    watcher = Watcher(exam.scenarios, exam.perception, exam.world.tick, several)
    spawned = exam.spawns(pedestrian)
    begun = {
        (int(row["scenario"]), int(row["episode"]), int(row["pedestrian"])): row
        for row in spawned[spawned["status"] != IDLE]
    }

    def ticks() -> Iterator[Tick]:
        for tick in read_bag(bag):
            for number, row in enumerate(tick.state):
                if row["status"] != IDLE:
                    key = int(row["scenario"]), int(row["episode"])
                    if (begin := begun.get((*key, number))) is None:
                        raise InvalidInput(
                            f"{bag.path}: episode {key[0]}:{key[1]} is another graph's, not of this exam"
                        )
                    row["kind"], row["pedestrians"] = begin["kind"], begin["pedestrians"]
            yield tick.state, tick.curvttc, tick.distance

    return episodes_of(exam, ticks(), watcher, str(bag))


def episodes_of(
    exam: Exam, ticks: Iterable[Tick], watcher: Watcher, source: str
) -> tuple[list[Episode], Mapping[Key, Sight]]:
    """Return the episodes of ticks in the order of their keys, and what could be seen of each."""

    def watched() -> Iterator[Tick]:
        for state, curvttc, distance in ticks:
            watcher.add(state, curvttc)
            yield state, curvttc, distance

    found = gathered(watched(), exam.world.tick, exam.scenarios, source=source)
    return sorted(found, key=lambda episode: episode.key), watcher.found
