"""The runs of an exam: a driving system, or the autopilot, meets one pedestrian after the other on the same episodes.

The driving system drives through the graph of nodes, in lock-step, one episode at a time, or, as a Python class, in
this process; so does the autopilot. What a run of a driving system came to is read from its bag. Many episodes are
driven in parts, each a run of its own, by workers side by side where there are several.
"""

import contextlib
import dataclasses
import os
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.episode import Key
from vpsci_ros.errors import VpsciError
from vpsci_ros.exam.class_process import class_process
from vpsci_ros.exam.cockpit import Answers, Cockpit
from vpsci_ros.exam.collect import bag_of, conduct_of, counts_of, episodes_of, joined, label_of, read_run
from vpsci_ros.exam.config import EXTERNAL, PERSON, ExamConfig, title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_process import SIDE_BY_SIDE, InProcess
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.on_hosts import elsewhere, files_needed, unpack
from vpsci_ros.exam.process import command_of, failure, running
from vpsci_ros.exam.recorded_people import write_motion
from vpsci_ros.exam.report import BASELINE, Conduct
from vpsci_ros.exam.sight import Watcher
from vpsci_ros.exam.socket_driver import connected
from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.failures import ADS, Silence, flood, never_came, second_publishers
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.ray_workers import RayWorkers
from vpsci_ros.runs.record import RECORD, write_record
from vpsci_ros.runs.sections import Sections
from vpsci_ros.runs.workers import Workers, computed, local_workers
from vpsci_ros.world import Recorded, World
from vpsci_ros.world.counts import WorldCounts
from vpsci_ros.world.intervention import InterventionConfig, Interventions
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.monitor import MonitorConfig

_BATCH = 64  # episodes side by side, of the autopilot
_STOPPED = "stopped on request"
DYING = 1.0  # [s] from the last command of a system that ends to its end


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
    workers: int | None = None,
    ray: str | None = None,
    quiet: bool,
    what: str = "",
) -> dict[str, RunResult]:
    """Have the ADS meet one pedestrian after the other; what is done in `folder` is not done again.

    With a run in which not one episode is driven it ends: no need to have that said once for each.

    :param workers: runs side by side, each in a process of its own; what comes out does not depend on their number.
    :param ray: address of the cluster on whose hosts they run, see `on_hosts`; None: on this machine.
    :param what: these runs are, for who waits.
    :raises VpsciError: a node has failed, or workers die again and again.
    :raises KeyboardInterrupt: stopped on request.
    """
    parts = exam.parts()
    runs = [Run(name, number) for name in pedestrians for number in range(len(parts))]
    waiting, found, begun = iter(runs), dict[Run, RunResult](), time.monotonic()
    alone = ray is None and (workers or 1) == 1
    titles = {run: f"{what}{n} of {len(runs)}" for n, run in enumerate(runs, 1)} if alone and not quiet else {}
    here = partial(conductor, parts, titles)

    def following() -> Run | None:
        return None if any(not result.episodes for result in found.values()) else next(waiting, None)

    pool: Workers[Run, RunResult | bytes]
    if ray is None:
        pool = local_workers(partial(here, folder), min(workers or 1, len(runs)))
    else:
        done_before = [run for run in runs if not conduct_of(parts[run.part], folder, run.pedestrian).failure]
        found |= {run: here(folder)(run) for run in done_before}
        waiting = iter([run for run in runs if run not in found])
        pool = RayWorkers(partial(elsewhere, here, parts[0], files_needed(parts[0])), ray, workers)
    with contextlib.closing(pool), Bars(quiet=quiet or alone) as bars:
        for run, result in computed(pool, following, ahead=0):
            if isinstance(result, bytes):
                unpack(result, folder)
                result = here(folder)(run)  # noqa: PLW2901 - now that it has been driven, it is read
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

    :param titles: of the runs, for who waits; a run without one is quiet.
    """

    def conduct(run: Run) -> RunResult:
        with domain_of(parts[0].config):
            return run_with(parts[run.part], run.pedestrian, folder, titles.get(run, ""), quiet=run not in titles)

    return conduct


def domain_of(config: ExamConfig) -> contextlib.AbstractContextManager[object]:
    """Return the context in which graphs have a ROS domain of their own; none without a graph of the exam's."""
    if config.in_process or config.ads in (EXTERNAL, PERSON):
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
    label = label_of(name, exam.part)
    if conduct_of(exam, folder, name).failure:
        if not quiet:
            domain, port = os.environ.get("ROS_DOMAIN_ID") or 0, exam.config.socket
            where = f"at port {port} of 127.0.0.1" if exam.config.in_process else f"in ROS domain {domain}"
            external = f"; the ADS is expected {where}" if exam.config.examined == EXTERNAL else ""
            print(f"{which}: {title_of(name)}, {len(exam.episodes)} episodes{external}", file=sys.stderr)
        shutil.rmtree(folder / "runs" / label, ignore_errors=True)
        (_run_in_process if exam.person or exam.config.in_process else _run)(exam, name, folder, quiet)
    return read_run(exam, name, bag_of(folder, label), conduct_of(exam, folder, name))


def autopilot_run(exam: Exam, pedestrian: str) -> RunResult:
    """Return what a run of the rule-based autopilot with one pedestrian comes to, many episodes side by side."""
    steps = loop_with(exam, pedestrian, "autopilot", exam.episodes, _BATCH)
    ticks = ((step.tick.state, step.assessment.curvttc, step.assessment.distance) for step in steps)
    found, sight = episodes_of(exam, ticks, Watcher(exam.scenarios), BASELINE)
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
            agent.load(load_policy(exam.weights), version=1)
    world = World(config, exam.scenarios, episodes, min(batch, len(episodes)), exam.run.seed, recorded)
    monitor = exam.sections.get(MonitorConfig, "safety_monitor")
    changes = exam.sections.get(InterventionConfig, "world_simulator")
    interventions = Interventions(changes, exam.scenarios, lane_following=config.lane_following)
    return Loop(world, monitor, agents, interventions=interventions if vehicle == "external" else None)


def _run(exam: Exam, name: str, folder: Path, quiet: bool) -> None:
    """Run the graph with one pedestrian; an ADS that fails is in the run's record."""
    from vpsci_ros.nodes.graph import run_graph

    silent, label = Silence(exam.config.silent_ticks), label_of(name, exam.part)
    graph = exam.sections.get(GraphConfig, "graph")
    patience = graph.progress_timeout
    reasons: list[str] = []
    begun = time.monotonic()
    with contextlib.ExitStack() as stack:
        ads = None
        if exam.config.ads != EXTERNAL:
            log = folder / "logs" / f"ads_{label}.log"
            ads = stack.enter_context(running(command_of(exam.config.ads, exam.latency), log))

        def failed(statuses: Mapping[str, NodeStatus], idle: float) -> str:
            counts, second = counts_of(statuses), second_publishers(statuses)
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
    counts = counts_of(result.nodes)
    if result.error == _STOPPED:
        raise KeyboardInterrupt
    if result.error and not any(reasons) and not (counts and counts.tick):
        world = result.nodes.get("world_simulator", NodeStatus())
        asks = "; does the ADS publish /vehicle/cmd_accel or /vehicle/cmd_control?" if ADS in world.awaited else ""
        raise VpsciError(f"the run with {title_of(name)}: {result.error}{asks}")


def _run_in_process(exam: Exam, name: str, folder: Path, quiet: bool) -> None:
    """Have the ADS meet one pedestrian without ROS, and leave a bag and a record as a graph does.

    A class drives many episodes side by side, a program behind a socket, or a person, one after the other.
    """
    begun, label = time.monotonic(), label_of(name, exam.part)
    log = folder / "logs" / f"ads_{label}.log"
    log.unlink(missing_ok=True)
    config, patience = exam.config, exam.sections.get(GraphConfig, "graph").progress_timeout
    compile_kernels()
    loop = loop_with(exam, name, "external", exam.episodes, SIDE_BY_SIDE if config.ads_class else 1)
    seats = len(loop.world.state) // loop.world.config.pedestrians
    with contextlib.ExitStack() as stack:
        bars = stack.enter_context(Bars(quiet=quiet))
        if config.ads_class and not exam.person:
            process = stack.enter_context(class_process(config.ads_class, log, patience))
            process.seat(exam.scenarios, seats)
            answers: Answers = process.answers
        else:
            make = exam.person or stack.enter_context(connected(config, log, exam.world.tick, patience))
            answers = Cockpit(make, exam.scenarios, seats, 0.0 if exam.person else patience).answers
        drivers = InProcess(loop, answers, exam.perception, log)
        steps = drivers.episodes(exam.episodes, lambda done: bars.bar(title_of(name), done, len(exam.episodes)))
        made_by = {"made_by": "vpsci ads-test", "ads": config.examined}
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
        bag = folder / "runs" / f"{label_of(name, exam.part)}_motion"
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
