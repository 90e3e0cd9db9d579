"""One run of an exam: the driving system meets one pedestrian in the episodes of a part.

A ROS program drives through the graph of nodes, one episode at a time. Every other system answers through the loop in
this process, and so does the autopilot. A run leaves a record and its result (`result`).
"""

import contextlib
import dataclasses
import itertools
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, BagTick
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Key
from vpsci_ros.data.episode_block import EpisodeBlock, concat_blocks
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.drivers import Answers, Cockpit, DrivenLoop
from vpsci_ros.exam.exam import BASELINE, EXTERNAL, SIDE_BY_SIDE, SILENT_TICKS, SURPLUS_LIMIT, Exam, title_of
from vpsci_ros.exam.process import class_process, command_of, failure, running
from vpsci_ros.exam.recorded_people import write_motion
from vpsci_ros.exam.result import Conduct, RunResult, block_of_ticks, label_of, run_folder, write_episodes, write_result
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.lockstep.intervention import intervened, rows_of, write_changes
from vpsci_ros.nodes.failures import ADS, Silence, flood, never_came, second_publishers
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.runs.journal import finished, write_item_record
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.record import RUN_RECORD, read_record, write_record
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.wire.layout import EVENTS
from vpsci_ros.world import IDLE, Recorded, World
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING
from vpsci_ros.world.tick import Actions, Step

if TYPE_CHECKING:
    from vpsci_ros.nodes.graph import GraphResult

RESULT = "result.json"  # what a finished run is, and the hash of each of its files
DYING = 1.0  # [s] from the last command of a system that ends to its end
_SIDE_BY_SIDE = 64  # episodes of the autopilot


def run_with(exam: Exam, name: str, folder: Path, which: str = "") -> None:
    """Run the driving system with one pedestrian in `folder`, unless the run is finished; see `read_result`.

    :param which: label of the run in the progress; empty: it is quiet.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    run = run_folder(folder, name, exam.part)
    if is_done(exam, folder, name):
        return
    if which:
        where = f"; the ADS is expected in ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
        external = where if exam.config.examined == EXTERNAL and exam.driver is None else ""
        print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
    shutil.rmtree(run, ignore_errors=True)
    for parent in (run.parent, folder / "logs"):
        parent.mkdir(parents=True, exist_ok=True)
    log = folder / "logs" / f"ads_{label_of(name, exam.part)}.log"
    drive = run_in_process if exam.in_process else run_in_graph
    with domain_of(exam):
        drive(exam, name, run, log, quiet=not which)
    write_item_record(run / RESULT, run_identity(exam, name))


def is_done(exam: Exam, folder: Path, name: str) -> bool:
    """Return whether `folder` has the exam's finished run with the pedestrian `name`, its files unchanged."""
    run = run_folder(folder, name, exam.part)
    record = read_record(run / RUN_RECORD)
    if record is None or record["error"]:
        return False
    return finished(run / RESULT, run_identity(exam, name), "it is driven again") is not None


def run_identity(exam: Exam, name: str) -> dict[str, Any]:
    """Return what a run is, as JSON values: its pedestrian, part and episodes, and the hash of the exam's identity."""
    starts = [list(exam.head_starts.get(key, (0.0, 0.0))) for key in exam.episodes] if exam.head_starts else None
    own = {"pedestrian": name, "part": exam.part + 1, "episodes": [list(key) for key in exam.episodes]}
    changes = {"head_starts": starts, "interventions": rows_of(exam.interventions)}
    return {**own, **changes, "exam_sha256": exam.digest}


def loop_with(exam: Exam, pedestrian: str, vehicle: str, episodes: list[Key], batch: int) -> Loop:
    """Return the simulation loop of these episodes with one pedestrian, in this process.

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
            agent.load(exam.default, version=1)
    starts, size = exam.head_starts, min(batch, len(episodes))
    world = World(config, exam.scenarios, episodes, size, exam.run.seed, recorded, head_starts=starts)
    changes = exam.interventions if vehicle == "external" else {}
    return Loop(world, agents, intervene=partial(intervened, changes) if changes else None)


def autopilot_run(exam: Exam, pedestrian: str, to: Path | None = None) -> RunResult:
    """Run the rule-based autopilot with one pedestrian, many episodes side by side, and return the result.

    :param to: file into which its episodes are written.
    """
    steps = loop_with(exam, pedestrian, "autopilot", exam.episodes, _SIDE_BY_SIDE)
    block = block_of_ticks(steps, exam.scenarios)
    if to is not None:
        write_episodes(to, block, exam.world.tick, exam.scenarios)
    return RunResult(list(block.episodes(exam.world.tick, exam.scenarios, BASELINE)))


def run_in_process(exam: Exam, name: str, run: Path, log: Path, *, quiet: bool) -> None:
    """Run the driving system with one pedestrian without ROS, and write result and record into `run`.

    With `ads_test.bags` it writes a bag, too, and drives one episode after the other.
    """
    begun, config = time.monotonic(), exam.config
    run.mkdir(exist_ok=True)
    log.unlink(missing_ok=True)
    compile_kernels()
    loop = loop_with(exam, name, "external", exam.episodes, 1 if exam.driver or config.bags else SIDE_BY_SIDE)
    world = loop.world.config
    with contextlib.ExitStack() as stack:
        bars = stack.enter_context(Bars(quiet=quiet))
        drivers = stack.enter_context(_drivers(exam, log))
        cars = {key: car for car, key in enumerate(exam.episodes)}
        driven = DrivenLoop(loop, drivers(len(cars)), exam.perception, log, cars)
        ticks = driven.ticks(lambda done: bars.bar(title_of(name), done, len(exam.episodes)))
        if config.bags:
            made_by = {"made_by": "vpsci ads-test", "ads": config.examined}
            seen = list(ticks)
            write_ticks(_recorded(seen, driven.lost), world, run / "bag", made_by, scenarios=exam.scenarios)
            ticks = iter(seen)
        block = block_of_ticks(ticks, exam.scenarios).without(driven.lost)
        failure = driven.failure() or _kept_state(exam, name, block, drivers, log)
    said = f"{title_of(name)}: {failure}" if failure else ""
    conduct = Conduct(len(exam.episodes), driven.refused, failure=said)
    write_result(run, exam, block, conduct)
    write_record(
        run / RUN_RECORD,
        begun=begun,
        error=failure,
        results=dataclasses.asdict(conduct),
        inputs={exam.weights.name: exam.hashes["weights"]} if "pedestrian" in loop.agents else {},
    )


@contextlib.contextmanager
def _drivers(exam: Exam, log: Path) -> Iterator[Callable[[int], Answers]]:
    """Yield a function that makes drivers for so many cars, and returns the function that has them answer."""
    patience, spawn = exam.patience, exam.world.spawn
    with contextlib.ExitStack() as stack:
        if exam.driver is not None:
            make = stack.enter_context(exam.driver(log, patience))
            yield lambda cars: Cockpit(make, exam.scenarios, cars, spawn).answers
            return
        process = stack.enter_context(class_process(exam.config.ads_class, log, patience))

        def made(cars: int) -> Answers:
            process.make_drivers(exam.scenarios, cars, spawn)
            return process.answers

        yield made


def _kept_state(exam: Exam, name: str, block: EpisodeBlock, drivers: Callable[[int], Answers], log: Path) -> str:
    """Return, in words, that the system keeps state from one episode to the next; "" if it is not seen to.

    With the first pedestrian half of the episodes are driven again: in reverse order, and by drivers of which each
    drives several. They have to come out the same to the bit.
    """
    if not exam.config.check_state or name != exam.config.opponents[0] or len(block) < 2:
        return ""
    keys = block.keys[:: -2 if len(block) > 2 else -1]
    cars = 1 if exam.driver else len(keys) // 2
    again = DrivenLoop(loop_with(exam, name, "external", keys, cars), drivers(cars), exam.perception, log)
    second = block_of_ticks(again.ticks(lambda _: None), exam.scenarios).without(again.lost)
    before, found = ({key: values.tobytes() for key, values in each.motions()} for each in (block, second))
    other = [f"{key[0]}:{key[1]}" for key in sorted(keys) if found.get(key) != before[key]]
    if not other:
        return ""
    return (
        f"the ADS keeps state from one episode to the next, or draws random numbers of its own: {len(other)} of "
        f"{len(keys)} episodes, such as {other[0]}, came out differently when it drove them again after others; "
        "reset has to clear all state (ads_test.check_state)"
    )


def _recorded(steps: Iterable[Step], lost: Collection[Key]) -> Iterator[Step]:
    """Yield the ticks of one episode after another for a bag, numbered anew, without those that were lost."""
    number = itertools.count()
    for step in steps:
        first = step.tick.state[0]
        if first["status"] != IDLE and (int(first["scenario"]), int(first["episode"])) not in lost:
            actions = step.actions.pedestrian if step.tick.policy_frame.any() else None
            yield step._replace(tick=step.tick._replace(number=next(number)), actions=Actions(pedestrian=actions))


def domain_of(exam: Exam) -> contextlib.AbstractContextManager[object]:
    """Return a context manager that reserves a ROS domain for the exam; an empty one if external or without ROS."""
    if exam.in_process or exam.config.ads == EXTERNAL:
        return contextlib.nullcontext()
    from vpsci_ros.nodes.domain import own_domain

    return own_domain()


def run_in_graph(exam: Exam, name: str, run: Path, log: Path, *, quiet: bool) -> None:
    """Run the graph with one pedestrian, and write record, bag and result into the folder `run`.

    :param log: for what the system writes.
    :raises VpsciError: a node has failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    from vpsci_ros.nodes.graph import STOPPED, run_graph

    silent = Silence(SILENT_TICKS)
    patience = exam.patience
    reasons: list[str] = []
    begun = time.monotonic()
    with contextlib.ExitStack() as stack:
        ads = None
        if exam.config.ads != EXTERNAL:
            ads = stack.enter_context(running(command_of(exam.config.ads, exam.latency), log))

        def failed(statuses: Mapping[str, NodeStatus], idle: float) -> str:
            counts, second = counts_of(statuses), second_publishers(statuses)
            reason = f"another graph, or the ADS, publishes beside its nodes: {', '.join(second)}" if second else ""
            if counts is not None and not reason:
                late = time.monotonic() - begun > patience
                reason = flood(counts, SURPLUS_LIMIT, late=late)
                awaited = statuses["world_simulator"].awaited
                reason = reason or (never_came(counts, idle, patience, awaited) if ads else "") or silent(counts)
            if reason and ads and not failure(ads):
                time.sleep(DYING)  # a system that falls silent may be about to end with other words
            reasons.append((failure(ads) if ads else "") or reason)
            return reasons[-1]

        graph = run_graph(graph_sections(exam, name, run), run, quiet=quiet, stop_when=failed)
    counts = counts_of(graph.nodes)
    if graph.error == STOPPED:
        raise KeyboardInterrupt
    if graph.error and not any(reasons) and not (counts and counts.tick):
        world = graph.nodes.get("world_simulator", NodeStatus())
        asks = "; does the ADS publish /vehicle/cmd_accel or /vehicle/cmd_control?" if ADS in world.awaited else ""
        raise VpsciError(f"the run with {title_of(name)}: {graph.error}{asks}")
    write_result(run, exam, *result_of_graph(exam, name, graph))


def counts_of(nodes: Mapping[str, NodeStatus]) -> WorldCounts | None:
    """Return the counts that the world simulator has reported; None if it has reported none."""
    return nodes["world_simulator"].counts if "world_simulator" in nodes else None


def graph_sections(exam: Exam, name: str, run: Path) -> Sections:
    """Return the parameters of the graph for a run with one pedestrian in the folder `run`."""
    config = exam.with_pedestrian(name, "external")
    world: dict[str, Any] = {"vehicle_driver": "external", "pedestrian_driver": config.pedestrian_driver, "batch": 1}
    nodes = ["world_simulator", "safety_monitor", "recorder"]
    if exam.head_starts or exam.interventions:
        changes = run.with_name(f"{run.name}_changes.json")
        write_changes(changes, exam.head_starts, exam.interventions)
        world["episode_changes"] = str(changes)
    sections = exam.sections
    if config.pedestrian_driver == "policy":
        nodes.insert(2, "pedestrian_policy")
        sections = sections.changed("pedestrian_policy", {"agent": name})
    if exam.perception:
        nodes.insert(-1, "perception")
    if config.pedestrian_driver == "replay":
        bag = run.with_name(f"{run.name}_motion")
        shutil.rmtree(bag, ignore_errors=True)
        write_motion(exam.motion(name), exam.spawns(), config, bag)
        own = sections.values.get("world_simulator", {})
        single = {name: value for name, value in own.items() if not name.startswith("crowd.")} | {"pedestrians": 1}
        sections = Sections({**sections.values, "world_simulator": single})
        world["recorded_bag"] = str(bag)
    return sections.changed("graph", {"nodes": nodes}).changed("world_simulator", world)


def result_of_graph(exam: Exam, name: str, graph: "GraphResult") -> tuple[EpisodeBlock, Conduct, Counter[Key]]:
    """Return the result of a graph's run, see `RunResult`: episodes with fewer than 20 ticks unanswered by the ADS.

    :raises InvalidInput: the bag cannot be read, though the run came to its end.
    """
    counts = counts_of(graph.nodes) or WorldCounts()
    failure = f"{title_of(name)}: {graph.error}" if graph.error else ""
    refused, surplus = counts.vehicle_commands_refused, counts.vehicle_commands_surplus
    conduct = Conduct(len(exam.episodes), refused, surplus, counts.safe_stops, failure)
    nothing = concat_blocks([]), conduct, Counter[Key]()
    if graph.error and not graph.bag.is_dir():
        return nothing  # it failed before the recorder wrote anything
    bag = Bag(graph.bag, recover=True) if graph.error else graph.recording or Bag(graph.bag)
    events = bag.topics().get(EVENTS)
    if events is not None and not events.messages:
        return nothing  # no episode has begun
    unanswered: Counter[Key] = Counter()

    try:
        found = block_of_bag(bag, exam, lambda events: unanswered.update(unanswered_in(events)))
    except InvalidInput:
        if not graph.error:
            raise
        return nothing  # whose failure says why, such as another graph's states among its own
    own = found.without([key for key, ticks in unanswered.items() if ticks >= SILENT_TICKS])
    if (left := len(found) - len(own)) and not graph.error:
        text = f"{left} episodes were left to the autopilot for {SILENT_TICKS} ticks or more"
        conduct = dataclasses.replace(conduct, failure=text)
    return own, conduct, unanswered


def unanswered_in(events: NDArray[np.void]) -> Iterator[Key]:
    """Yield the key of the episode at each tick, of EVENT[n], that the ADS left unanswered."""
    missing = events[(events["kind"] == VEHICLE_ACTION_MISSING) & (events["slot"] == 0)]  # of other pedestrians too
    return zip(missing["scenario"].tolist(), missing["episode"].tolist(), strict=True)


def block_of_bag(bag: Bag, exam: Exam, take_events: Callable[[NDArray[np.void]], None] | None = None) -> EpisodeBlock:
    """Return the episodes that end in a bag's ticks.

    :param take_events: called with the EVENT[n] of each message of events.
    :raises InvalidInput: it cannot be read, or holds an episode that is not of this exam.
    """
    own = set(exam.episodes)

    def ticks() -> Iterator[BagTick]:
        for tick in read_bag(bag, take_events=take_events):
            for row in tick.state[tick.state["status"] != IDLE]:
                if (key := (int(row["scenario"]), int(row["episode"]))) not in own:
                    raise InvalidInput(f"{bag.path}: episode {key[0]}:{key[1]} is another graph's, not of this exam")
            yield tick

    return block_of_ticks(ticks(), exam.scenarios)
