"""A run of an exam through the graph of nodes, for a driving system that is a ROS program, and its result."""

import contextlib
import dataclasses
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, BagTick
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Key
from vpsci_ros.data.episode_block import EpisodeBlock, concat_blocks
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.exam_config import EXTERNAL, SILENT_TICKS, SURPLUS_LIMIT, title_of
from vpsci_ros.exam.process import command_of, failure, running
from vpsci_ros.exam.recorded_people import write_motion
from vpsci_ros.exam.result import Conduct, block_of_ticks, write_result
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.failures import ADS, Silence, flood, never_came, second_publishers
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.wire.layout import EVENTS
from vpsci_ros.world.state import IDLE, VEHICLE_ACTION_MISSING

if TYPE_CHECKING:
    from vpsci_ros.nodes.graph import GraphResult

_STOPPED = "stopped on request"
DYING = 1.0  # [s] from the last command of a system that ends to its end


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
    from vpsci_ros.nodes.graph import run_graph

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
    if graph.error == _STOPPED:
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
    if config.head_starts:
        world["head_starts"] = list(config.head_starts)
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
