"""What the runs of an exam came to: read from their bags and records, and the parts of a run put together."""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.gathered import Tick, gathered
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
    """Return how the folder of a run is named: walker, walker-2, walker-3."""
    return f"{pedestrian}-{part + 1}" if part else pedestrian


def bag_of(folder: Path, label: str) -> Path:
    """Return where the bag of a run is."""
    return folder / "runs" / label / "bag"


def bags_of(folder: Path, pedestrian: str) -> list[Path]:
    """Return the bags of the runs with one pedestrian, in the order of their parts."""
    numbered = (bag_of(folder, label_of(pedestrian, part)) for part in itertools.count())
    return list(itertools.takewhile(Path.is_dir, numbered))


def joined(results: Sequence[RunResult], wanted: int) -> RunResult:
    """Return what the parts of a run came to together."""
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


def conduct_of(exam: Exam, folder: Path, name: str) -> Conduct:
    """Return how a run went, by its record; one that has not been is a failure, too."""
    wanted = len(exam.episodes)
    record = read_record(folder / "runs" / label_of(name, exam.part) / RECORD)
    if record is None:
        return Conduct(wanted, failure=f"{title_of(name)}: has not been run")
    nodes = record["results"].get("nodes", {})
    counts = counts_of({node: NodeStatus.of(values) for node, values in nodes.items()}) or WorldCounts()
    failure = f"{title_of(name)}: {record['error']}" if record["error"] else ""
    refused, surplus = counts.vehicle_commands_refused, counts.vehicle_commands_surplus
    return Conduct(wanted, refused, surplus, counts.safe_stops, failure)


def counts_of(nodes: Mapping[str, NodeStatus]) -> WorldCounts | None:
    """Return what the world of a graph has counted; None where it has reported nothing."""
    return nodes["world_simulator"].counts if "world_simulator" in nodes else None


def read_run(exam: Exam, name: str, bag: Path, conduct: Conduct) -> RunResult:
    """Return what a bag holds: the episodes that ended, without those that were left to the autopilot."""
    silent_ticks = exam.config.silent_ticks
    if conduct.failure and not bag.is_dir():
        return RunResult([], conduct)  # it failed before the recorder wrote anything
    recording = Bag(bag, recover=bool(conduct.failure))
    events = recording.topics().get(EVENTS)
    if events is not None and not events.messages:  # the bag of a class has no such topic
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
                        raise InvalidInput(f"{bag}: episode {key[0]}:{key[1]} is another graph's, not of this exam")
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
