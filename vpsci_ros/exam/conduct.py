"""The runs of an exam: a driving system, or the autopilot, meets one pedestrian after the other on the same episodes.

The driving system drives through the graph of nodes, in lock-step, one episode at a time, or, as a Python class, in
this process; so does the autopilot. What a run of a driving system came to is read from its bag. Many episodes are
driven in parts, each a run of its own, by workers side by side where there are several.
"""

import contextlib
import dataclasses
import itertools
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.gathered import Tick, gathered
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.config import ALONE, DRIVERS, EXTERNAL, ExamConfig, added_pedestrians, title_of
from vpsci_ros.exam.driver_class import find_driver
from vpsci_ros.exam.episode_list import flat
from vpsci_ros.exam.in_process import SIDE_BY_SIDE, InProcess
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.process import command_of, failure, running
from vpsci_ros.exam.recorded_people import Motion, absent_pedestrians, recorded_people, spawns, write_motion
from vpsci_ros.exam.report import BASELINE, Conduct
from vpsci_ros.exam.sight import Sight, Watcher
from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.failures import ADS, Silence, flood, never_came, second_publishers
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.config import PolicyConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.record import RECORD, read_record, write_record
from vpsci_ros.runs.sections import Sections
from vpsci_ros.runs.workers import computed, local_workers
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import Decoder
from vpsci_ros.wire.layout import EVENTS
from vpsci_ros.world import IDLE, Recorded, Scenario, World, WorldConfig, load_scenarios
from vpsci_ros.world.counts import WorldCounts
from vpsci_ros.world.crowd import CrowdConfig
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.monitor import MonitorConfig
from vpsci_ros.world.perception import PerceptionConfig
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING

_BATCH = 64  # episodes side by side, of the autopilot
_STOPPED = "stopped on request"
PART = 100  # episodes of a run, at most: where there are more, its pedestrian has several runs
DYING = 1.0  # [s] from the last command of a system that ends to its end


@dataclasses.dataclass(frozen=True)
class Exam:
    """What is examined, and on which episodes.

    :ivar sections: the parameters that the graphs are started with.
    :ivar part: which one of an exam in several parts, from 0.
    :ivar whole: that exam; None: it is whole itself.
    """

    sections: Sections
    config: ExamConfig
    run: RunConfig
    world: WorldConfig
    part: int = 0
    whole: "Exam | None" = None

    @property
    def episodes(self) -> list[Key]:
        """The episodes, the same ones with each pedestrian."""
        return list(self.run.queue())

    def only(self, keys: Sequence[Key]) -> "Exam":
        """Return the exam on these episodes alone."""
        listed = flat(keys)
        sections = self.sections.changed("world_simulator", {"only": listed})
        return dataclasses.replace(self, sections=sections, run=dataclasses.replace(self.run, only=listed))

    def parts(self) -> list["Exam"]:
        """Return the exam in parts that are driven in a run each, however many workers there are."""
        keys = self.episodes
        if len(keys) <= PART:
            return [self]
        starts = enumerate(range(0, len(keys), PART))
        return [dataclasses.replace(self.only(keys[k : k + PART]), part=n, whole=self.whole or self) for n, k in starts]

    @property
    def scenarios(self) -> list[Scenario]:
        """Where they take place."""
        return load_scenarios(self.run.scenarios, self.run.scenario_files)

    @property
    def perception(self) -> PerceptionConfig | None:
        """Errors of what is published of pedestrians to the ADS; None: it has their odometry."""
        return self.sections.get(PerceptionConfig, "perception") if self.config.perception else None

    @property
    def latency(self) -> float | None:
        """How late pedestrians are published to the ADS [s], in whole ticks; None: it has their odometry."""
        return None if self.perception is None else self.perception.delay(self.world.tick) * self.world.tick

    @property
    def weights(self) -> Path:
        """Weights of the learned pedestrian."""
        return weights_path(self.sections.get(PolicyConfig, "pedestrian_policy").weights)

    def policy(self, pedestrian: str) -> PolicyConfig:
        """Return the parameters of a pedestrian that acts from the hand-over on, learned or added."""
        return dataclasses.replace(self.sections.get(PolicyConfig, "pedestrian_policy"), agent=pedestrian)

    def with_pedestrian(self, pedestrian: str, vehicle: str) -> WorldConfig:
        """Return the world's configuration with one of the pedestrians and this driver of the vehicle."""
        driver = "policy" if pedestrian in added_pedestrians() else DRIVERS.get(pedestrian, "replay")
        world = dataclasses.replace(self.world, vehicle_driver=vehicle)
        if driver == "replay":  # of one person each
            world = dataclasses.replace(world, pedestrians=1, crowd=CrowdConfig())
        return dataclasses.replace(world, pedestrian_driver=driver)

    def motion(self, pedestrian: str) -> Motion:
        """Return the motion of a pedestrian that is replayed: recorded people, or nobody."""
        if pedestrian == ALONE:
            return absent_pedestrians(self.spawns())
        path, world = self.config.recorded, self.with_pedestrian(pedestrian, "external")
        begins = (self.whole or self).spawns()  # each person once before any twice, in whatever parts
        motion = recorded_people(read_near_misses(path), begins, self.scenarios, world, self.run.seed, path)
        return {key: motion[key] for key in self.episodes}

    def spawns(self, pedestrian: str = ALONE) -> NDArray[np.void]:
        """Return the episodes as they begin, EPISODE[n * P], P rows for each where there are several pedestrians."""
        return spawns(self.with_pedestrian(pedestrian, "external"), self.scenarios, self.episodes, self.run.seed)


class Run(NamedTuple):
    """A run of the driving system: with one pedestrian, on the episodes of one part of the exam."""

    pedestrian: str
    part: int

    def __str__(self) -> str:
        return _label(self.pedestrian, self.part)


def run_with_all(
    exam: Exam, folder: Path, pedestrians: Sequence[str], *, workers: int = 1, quiet: bool, what: str = ""
) -> dict[str, RunResult]:
    """Have the ADS meet one pedestrian after the other; what is done in `folder` is not done again.

    With a run in which not one episode is driven it ends: no need to have that said once for each.

    :param workers: runs side by side, each in a process of its own; what comes out does not depend on their number.
    :param what: these runs are, for who waits.
    :raises VpsciError: a node has failed, or workers die again and again.
    :raises KeyboardInterrupt: stopped on request.
    """
    parts = exam.parts()
    runs = [Run(name, number) for name in pedestrians for number in range(len(parts))]
    waiting, found, begun = iter(runs), dict[Run, RunResult](), time.monotonic()
    titles = {run: f"{what}{n} of {len(runs)}" for n, run in enumerate(runs, 1)} if workers == 1 and not quiet else {}

    def following() -> Run | None:
        return None if any(not result.episodes for result in found.values()) else next(waiting, None)

    pool = local_workers(partial(_conductor, parts, folder, titles), min(workers, len(runs)))
    with contextlib.closing(pool), Bars(quiet=quiet or workers == 1) as bars:
        for run, result in computed(pool, following, ahead=0):
            found[run] = result
            done, wanted = sum(parts[each.part].run.total for each in found), len(exam.episodes) * len(pedestrians)
            bars.bar(f"{what}episodes", done, wanted, note=f"last: {title_of(run.pedestrian)}")
            left = (time.monotonic() - begun) / 60.0 * (wanted - done) / done
            bars.line(f"{what}{done:,} of {wanted:,} episodes, {left:.1f} min left", now=True)
    empty = next((n for n, run in enumerate(runs) if run in found and not found[run].episodes), len(runs))
    taken = {name: [found[run] for run in runs[: empty + 1] if run.pedestrian == name] for name in pedestrians}
    return {name: _joined(results, len(exam.episodes)) for name, results in taken.items() if results}


def _conductor(parts: Sequence[Exam], folder: Path, titles: Mapping[Run, str]) -> Callable[[Run], RunResult]:
    """Return what conducts the runs of an exam's parts, in a process of its own or not.

    :param titles: of the runs, for who waits; a run without one is quiet.
    """

    def conduct(run: Run) -> RunResult:
        with domain_of(parts[0].config):
            return run_with(parts[run.part], run.pedestrian, folder, titles.get(run, ""), quiet=run not in titles)

    return conduct


def _joined(results: Sequence[RunResult], wanted: int) -> RunResult:
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


def domain_of(config: ExamConfig) -> contextlib.AbstractContextManager[object]:
    """Return the context in which graphs have a ROS domain of their own; none for a class or an external system."""
    if config.ads_class or config.ads == EXTERNAL:
        return contextlib.nullcontext()
    from vpsci_ros.nodes.domain import own_domain

    return own_domain()


def run_with(exam: Exam, name: str, folder: Path, which: str, *, quiet: bool) -> RunResult:
    """Have the ADS meet one pedestrian in `folder`, unless it has done so there, and return what it came to.

    :param which: of the runs this is, for who waits.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    for part in ("runs", "logs"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    label = _label(name, exam.part)
    if _conduct(exam, folder, name).failure:
        if not quiet:
            where = f"; the ADS is expected in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
            external = where if exam.config.examined == EXTERNAL else ""
            print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
        shutil.rmtree(folder / "runs" / label, ignore_errors=True)
        (_run_class if exam.config.ads_class else _run)(exam, name, folder, quiet)
    return _read(exam, name, bag_of(folder, label), _conduct(exam, folder, name))


def _label(pedestrian: str, part: int) -> str:
    """Return how the folder of a run is named: walker, walker-2, walker-3."""
    return f"{pedestrian}-{part + 1}" if part else pedestrian


def bag_of(folder: Path, label: str) -> Path:
    """Return where the bag of a run is."""
    return folder / "runs" / label / "bag"


def bags_of(folder: Path, pedestrian: str) -> list[Path]:
    """Return the bags of the runs with one pedestrian, in the order of their parts."""
    numbered = (bag_of(folder, _label(pedestrian, part)) for part in itertools.count())
    return list(itertools.takewhile(Path.is_dir, numbered))


def autopilot_run(exam: Exam, pedestrian: str) -> RunResult:
    """Return what a run of the rule-based autopilot with one pedestrian comes to, many episodes side by side."""
    steps = loop_with(exam, pedestrian, "autopilot", exam.episodes, _BATCH)
    ticks = ((step.tick.state, step.assessment.curvttc, step.assessment.distance) for step in steps)
    found, sight = _gathered(exam, ticks, Watcher(exam.scenarios), BASELINE)
    return RunResult(found, Conduct(len(exam.episodes)), sight=sight)


def loop_with(exam: Exam, pedestrian: str, vehicle: str, episodes: list[Key], batch: int) -> Loop:
    """Return the loop in which a driver of the world's meets a pedestrian in this process.

    :param vehicle: the world's `vehicle_driver`.
    :param batch: episodes side by side, at most.
    """
    config = exam.with_pedestrian(pedestrian, vehicle)
    recorded = None
    if config.pedestrian_driver == "replay":
        motion = exam.motion(pedestrian)
        recorded = Recorded({key: (np.zeros((len(rows), 5)), rows) for key, rows in motion.items()})
    agents = {}
    if config.pedestrian_driver == "policy":
        agents["pedestrian"] = agent = make_agent("pedestrian", exam.policy(pedestrian))
        if isinstance(agent, PolicyAgent):
            agent.load(load_weights(exam.weights), version=1)
    world = World(config, exam.scenarios, episodes, min(batch, len(episodes)), exam.run.seed, recorded)
    monitor = exam.sections.get(MonitorConfig, "safety_monitor")
    return Loop(world, monitor, agents)


def _run(exam: Exam, name: str, folder: Path, quiet: bool) -> None:
    """Run the graph with one pedestrian; an ADS that fails is in the run's record."""
    from vpsci_ros.nodes.graph import run_graph

    silent, label = Silence(exam.config.silent_ticks), _label(name, exam.part)
    graph = exam.sections.get(GraphConfig, "graph")
    patience, restarted = graph.progress_timeout, ["pedestrian_policy"] if graph.restarts else []
    reasons: list[str] = []
    begun = time.monotonic()
    with contextlib.ExitStack() as stack:
        ads = None
        if exam.config.ads != EXTERNAL:
            log = folder / "logs" / f"ads_{label}.log"
            ads = stack.enter_context(running(command_of(exam.config.ads, exam.latency), log))

        def failed(statuses: Mapping[str, NodeStatus], idle: float) -> str:
            counts, second = _counts(statuses), second_publishers(statuses, restarted)
            reason = f"another graph, or the ADS, publishes beside its nodes: {', '.join(second)}" if second else ""
            if counts is not None and not reason:
                late = time.monotonic() - begun > patience
                reason = flood(counts, exam.config.surplus_limit, late=late)
                awaited = statuses["world_simulator"].awaited
                reason = reason or (never_came(counts, idle, patience, awaited) if ads else "") or silent(counts)
            if reason and ads and not failure(ads):
                time.sleep(DYING)  # a system that falls silent may be about to end with other words
            reasons.append((failure(ads) if ads else "") or reason)
            return reasons[-1]

        result = run_graph(_graph(exam, name, folder), folder / "runs" / label, quiet=quiet, stop_when=failed)
    counts = _counts(result.nodes)
    if result.error == _STOPPED:
        raise KeyboardInterrupt
    if result.error and not any(reasons) and not (counts and counts.tick):
        world = result.nodes.get("world_simulator", NodeStatus())
        asks = "; does the ADS publish /vehicle/cmd_accel or /vehicle/cmd_control?" if ADS in world.awaited else ""
        raise VpsciError(f"the run with {title_of(name)}: {result.error}{asks}")


def _run_class(exam: Exam, name: str, folder: Path, quiet: bool) -> None:
    """Have the class meet one pedestrian in this process, and leave a bag and a record as a graph does."""
    begun, label = time.monotonic(), _label(name, exam.part)
    log = folder / "logs" / f"ads_{label}.log"
    log.unlink(missing_ok=True)
    loop = loop_with(exam, name, "external", exam.episodes, SIDE_BY_SIDE)
    drivers = InProcess(find_driver(exam.config.ads_class), loop, exam.perception, log)
    with Bars(quiet=quiet) as bars:
        steps = drivers.episodes(exam.episodes, lambda done: bars.bar(title_of(name), done, len(exam.episodes)))
        made_by = {"made_by": "vpsci ads-test", "ads_class": exam.config.ads_class}
        write_ticks(steps, loop.world.config, bag_of(folder, label), made_by, scenarios=exam.scenarios)
    counts = WorldCounts(vehicle_commands=drivers.commands, vehicle_commands_refused=drivers.refused)
    write_record(
        folder / "runs" / label / RECORD,
        begun=begun,
        error=drivers.failure(),
        results={"nodes": {"world_simulator": dataclasses.asdict(NodeStatus(counts=counts))}},
        inputs={exam.weights.name: sha256(exam.weights)} if "pedestrian" in loop.agents else {},
    )


def _graph(exam: Exam, name: str, folder: Path) -> Sections:
    """Return the sections of the graph in which the ADS meets one pedestrian."""
    config = exam.with_pedestrian(name, "external")
    drivers = {"vehicle_driver": "external", "pedestrian_driver": config.pedestrian_driver}
    world: dict[str, Any] = drivers | {"batch": 1}
    nodes = ["world_simulator", "safety_monitor", "recorder"]
    if config.pedestrian_driver == "policy":
        nodes.insert(2, "pedestrian_policy")
    if exam.perception:
        nodes.insert(-1, "perception")
        world["pedestrian_odometry"] = False
    if config.pedestrian_driver == "replay":
        bag = folder / "runs" / f"{_label(name, exam.part)}_motion"
        shutil.rmtree(bag, ignore_errors=True)
        write_motion(exam.motion(name), exam.spawns(), config, bag)
        world["recorded_bag"] = str(bag)
    sections = exam.sections
    if config.pedestrian_driver == "replay":
        own = sections.values.get("world_simulator", {})
        single = {name: value for name, value in own.items() if not name.startswith("crowd.")} | {"pedestrians": 1}
        sections = Sections({**sections.values, "world_simulator": single})
    sections = sections.changed("graph", {"nodes": nodes}).changed("world_simulator", world)
    if "pedestrian_policy" in nodes:
        sections = sections.changed("pedestrian_policy", {"agent": name})
    return sections


def _conduct(exam: Exam, folder: Path, name: str) -> Conduct:
    """Return how a run went, by its record; one that has not been is a failure, too."""
    wanted = len(exam.episodes)
    record = read_record(folder / "runs" / _label(name, exam.part) / RECORD)
    if record is None:
        return Conduct(wanted, failure=f"{title_of(name)}: has not been run")
    nodes = record["results"].get("nodes", {})
    counts = _counts({node: NodeStatus.of(values) for node, values in nodes.items()}) or WorldCounts()
    failure = f"{title_of(name)}: {record['error']}" if record["error"] else ""
    refused, surplus = counts.vehicle_commands_refused, counts.vehicle_commands_surplus
    return Conduct(wanted, refused, surplus, counts.safe_stops, failure)


def _counts(nodes: Mapping[str, NodeStatus]) -> WorldCounts | None:
    """Return what the world of a graph has counted; None where it has reported nothing."""
    return nodes["world_simulator"].counts if "world_simulator" in nodes else None


def _read(exam: Exam, name: str, bag: Path, conduct: Conduct) -> RunResult:
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
        found, sight = episodes_in_bag(bag, exam, name, recover=bool(conduct.failure))
    except InvalidInput:
        if not conduct.failure:
            raise
        return RunResult([], conduct)  # whose failure says why, such as another graph's states among its own
    own = [episode for episode in found if unanswered[episode.key] < silent_ticks]
    if len(own) < len(found) and not conduct.failure:
        left = f"{len(found) - len(own)} episodes were left to the autopilot for {silent_ticks} ticks or more"
        conduct = dataclasses.replace(conduct, failure=left)
    return RunResult(own, conduct, dict(+unanswered), sight)


def episodes_in_bag(
    bag: Path, exam: Exam, pedestrian: str, *, recover: bool
) -> tuple[list[Episode], Mapping[Key, Sight]]:
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
        for tick in read_bag(bag, recover=recover):
            for number, row in enumerate(tick.state):
                if row["status"] != IDLE:
                    key = int(row["scenario"]), int(row["episode"])
                    if (begin := begun.get((*key, number))) is None:
                        raise InvalidInput(f"{bag}: episode {key[0]}:{key[1]} is another graph's, not of this exam")
                    row["kind"], row["pedestrians"] = begin["kind"], begin["pedestrians"]
            yield tick.state, tick.curvttc, tick.distance

    return _gathered(exam, ticks(), watcher, str(bag))


def _gathered(
    exam: Exam, ticks: Iterable[Tick], watcher: Watcher, source: str
) -> tuple[list[Episode], Mapping[Key, Sight]]:
    """Return the episodes of ticks in the order of their keys, and what could be seen of each."""

    def watched() -> Iterator[Tick]:
        for state, curvttc, distance in ticks:
            watcher.add(state, curvttc)
            yield state, curvttc, distance

    found = gathered(watched(), exam.world.tick, exam.scenarios, source=source)
    return sorted(found, key=lambda episode: episode.key), watcher.found
