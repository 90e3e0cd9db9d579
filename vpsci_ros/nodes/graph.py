"""A graph of nodes as processes, which are started, watched and stopped together.

The graph has one leading node, whose end is the end of the run: the world simulator, or, in stage 1, the learner.
Any other process that ends on its own ends the run with an error that names it. The recorder is stopped last.
"""

import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.data.corpus import corpus_files
from vpsci_ros.documents import dump_yaml, in_utf8
from vpsci_ros.errors import InvalidInput, VpsciError, in_words
from vpsci_ros.learning.training_config import LearnerConfig, require_learnable
from vpsci_ros.nodes import failures
from vpsci_ros.nodes.domain import only_graph, require_security
from vpsci_ros.nodes.node_config import GraphConfig, section_classes
from vpsci_ros.nodes.shared_memory import remove_left_behind
from vpsci_ros.nodes.status import PIPE, NodeStatus, StatusPipe
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.parameters import as_ros_parameters, pick, refuse_unknown, settings_of, table
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_file import load_policy, require_source
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import require_empty_folder, sha256, write_text
from vpsci_ros.runs.output_folder import FolderLock
from vpsci_ros.runs.processes import ChildProcess, CoreTime, core_time, stop
from vpsci_ros.runs.record import RUN_RECORD, write_record
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.runs.stop_request import StopRequest, stop_requested_by_signals
from vpsci_ros.world import WorldConfig

StopWhen = Callable[[Mapping[str, NodeStatus], float], str]
STOP_STEPS = ((signal.SIGINT, 30.0), (signal.SIGKILL, 30.0))  # sent, and given so long [s]
POLL = 0.1  # [s]
WEIGHTS_OF_STAGE = {"pretrain": "pretrained.safetensors", "refine": "refined.safetensors"}  # what a learner leaves
STOPPED = "stopped on request"  # error of a graph that Ctrl-C or SIGTERM ends


@dataclass
class GraphResult:
    """The result of a run of a graph: its error, the nodes' last reports, exit statuses and bag.

    :ivar error: why the run failed; empty when it ran to its end and is complete.
    :ivar wall_time: of the run [s].
    :ivar nodes: the last report of each node.
    :ivar exits: node -> exit status of its process.
    :ivar recording: the bag, after its checksums were compared; None where there is none or it is damaged.
    """

    folder: Path
    error: str = ""
    wall_time: float = 0.0
    nodes: dict[str, NodeStatus] = field(default_factory=dict)
    exits: dict[str, int] = field(default_factory=dict)
    recording: Bag | None = None

    @property
    def bag(self) -> Path:
        """The bag's folder, when the graph has a recorder."""
        return self.folder / "bag"


def _never(nodes: Mapping[str, NodeStatus], idle: float) -> str:
    """Return no reason to stop."""
    return ""


def run_graph(
    sections: Sections, folder: str | Path, *, quiet: bool = False, stop_when: StopWhen = _never
) -> GraphResult:
    """Run a graph of nodes to its end and return the result.

    A run that fails, is interrupted, or ends with anything missing returns with `error` set; the reasons are in
    `vpsci_ros.nodes.failures`, and docs/promises.md lists them.

    :param sections: as `vpsci_ros.cli.parameter_file.load` returns them.
    :param folder: output folder, empty or new: bag/, log/, params.yaml (resolved), run.json, and what a learner writes.
    :param stop_when: called about ten times a second with the nodes' latest reports and for how long nothing has
        happened [s]; an answer ends the run, and is its `error`.
    :raises InvalidInput: a parameter is refused, there are no such weights or no such source of them, another graph
        runs in this ROS domain, DDS security is requested and not to be had, or the folder is not empty; nothing
        has been started then.
    """
    require_security()
    resolved = resolve(sections, Path(folder))
    _require_sources(resolved)
    values = [Path(folder), *(value for own in resolved.values.values() for value in own.values())]
    if odd := next((value for value in values if in_utf8(str(value)) != str(value)), None):
        raise InvalidInput(f"{odd}: not in UTF-8, as ROS 2 expects its parameters; give another path")
    hashes = {name: sha256(path) for name, path in sorted(_weights(resolved).items())}
    chosen = resolved.get(GraphConfig, "graph")
    begun = time.monotonic()
    with contextlib.ExitStack() as stack:
        stack.enter_context(only_graph(chosen.namespace))
        stack.enter_context(contextlib.closing(FolderLock(folder)))
        folder = require_empty_folder(folder)
        result = GraphResult(folder)
        requested = stack.enter_context(stop_requested_by_signals())  # nothing cuts the record short
        with _collecting_errors(result):
            parameters = folder / "params.yaml"
            layout = as_ros_parameters(resolved.values, any_namespace=bool(chosen.namespace))
            write_text(parameters, dump_yaml(layout))
            compile_kernels()
            processes = NodeProcesses(
                chosen.nodes, parameters, folder / "log", chosen.namespace, composed=chosen.composed
            )
            _run_to_the_end(result, resolved, processes, quiet, requested, stop_when)
        result.wall_time = time.monotonic() - begun
        learner = resolved.values.get("learner")
        near_misses = [] if learner is None else corpus_files(learner.get("near_misses", []))
        with _collecting_errors(result):
            write_record(
                folder / RUN_RECORD,
                begun=begun,
                error=result.error,
                results={
                    "nodes": {node: asdict(status) for node, status in result.nodes.items()},
                    "exit_status": result.exits,
                },
                inputs=hashes | {str(path): sha256(path) for path in near_misses if path.is_file()},
            )
    return result


def _weights(resolved: Sections) -> dict[str, Path]:
    """Return the files of all weights that the nodes begin with, by their names in the parameters.

    :raises InvalidInput: there is no such file.
    """
    found: dict[str, Path] = {}
    for node, values in resolved.values.items():
        if name := values.get("weights"):
            found[name] = resolved.get(LearnerConfig, node).start() if node == "learner" else weights_path(name)
    return found


def _require_sources(resolved: Sections) -> None:
    """Refuse a source that the weights of a policy's node do not have; weights to come are checked by the node.

    :raises InvalidInput: see `vpsci_ros.policy.policy_file.require_source`.
    """
    for values in resolved.values.values():
        if values.get("people") and values.get("weights"):
            require_source(load_policy(values["weights"]), values["people"])


def _run_to_the_end(
    result: GraphResult,
    resolved: Sections,
    processes: "NodeProcesses",
    quiet: bool,
    requested: StopRequest,
    stop_when: StopWhen,
) -> None:
    """Start and watch the processes, stop them, and complete what they leave; fill `result` in."""
    with processes:
        try:
            with Watch(resolved, quiet=quiet) as watch:
                result.error = _follow(processes, watch, resolved.get(GraphConfig, "graph"), requested, stop_when)
        finally:
            result.exits = processes.stop()
            result.nodes = processes.statuses(0.0)
    _settle(result, processes)
    result.error = result.error or "; ".join(_incomplete(result, processes, resolved))


def resolve(sections: Sections, folder: Path) -> Sections:
    """Return every parameter of the graph's nodes: given values, defaults, paths in `folder`, and peers.

    :raises InvalidInput: a value is refused, two of them do not go together, or the list of nodes makes no graph.
    """
    graph = sections.get(GraphConfig, "graph")
    if "world_simulator" not in graph.nodes and "learner" not in graph.nodes:
        raise InvalidInput(f"graph.nodes = {graph.nodes}: expected world_simulator or learner among them, to lead")
    resolved = {"graph": settings_of(graph)}
    for node in graph.nodes:
        values = {**sections.values.get(node, {}), "peers": list(graph.nodes)}
        if node == "recorder":
            values["bag"] = str(folder / "bag")
        if node == "learner":
            values["output"] = str(folder)
        kinds = section_classes(node, values)
        refuse_unknown(values, {row.name: row for kind in kinds for row in table(kind)}, node)
        resolved[node] = settings_of(*(pick(kind, values, node) for kind in kinds))
    chosen = Sections(resolved)
    drives = resolved.get("vehicle_policy", {}).get("weights")
    if "world_simulator" in resolved and drives and isinstance(load_policy(drives), Bank):
        chosen = chosen.changed("world_simulator", {"lane_following": True})  # its car does not steer
    if "world_simulator" in resolved and resolved.get("learner", {}).get("stage") == "refine":
        require_learnable(chosen.get(WorldConfig, "world_simulator"))
    return chosen


class NodeProcesses:
    """The processes of a graph, one for each node or, if `composed`, one for all; run in a `with` block."""

    def __init__(
        self, nodes: list[str], parameters: Path, logs: Path, namespace: str = "", *, composed: bool = False
    ) -> None:
        self.leader = "world_simulator" if "world_simulator" in nodes else "learner"
        self.logs = logs
        others = [node for node in nodes if node != self.leader]
        self._groups = [[self.leader, *others]] if composed else [[node] for node in nodes]
        self._arguments = ["--ros-args", "--params-file", str(parameters)]
        self._arguments += ["-r", f"__ns:={namespace}"] if namespace else []
        self.running: dict[str, ChildProcess] = {}
        self._pipes: dict[str, StatusPipe] = {}
        self._core_times: dict[ChildProcess, CoreTime] = {}

    def __enter__(self) -> "NodeProcesses":
        self.logs.mkdir(mode=0o700)
        for group in self._groups:
            self._start(group)
        return self

    def _start(self, group: list[str]) -> None:
        """Start a process of one node or several; the log of the first is that of all."""
        pipes = {node: StatusPipe() for node in group}
        self._pipes |= pipes
        command = [sys.executable, "-m", "vpsci_ros.nodes", ",".join(group), *self._arguments]
        # Idle threads of torch must not keep the nodes from a core.
        environment = {"OMP_WAIT_POLICY": "PASSIVE"} | dict(os.environ)
        ends = {node: pipe.write_end for node, pipe in pipes.items()}
        environment[PIPE] = ",".join(f"{node}={ends[node]}" for node in group)
        log = self.logs / f"{group[0]}.log"
        process = ChildProcess(command, log, environment, holds_signals=True, inherited=list(ends.values()))
        for node, pipe in pipes.items():
            self.running[node] = process
            pipe.started()
            if node != group[0]:
                (self.logs / f"{node}.log").symlink_to(log.name)

    def __exit__(self, *_: object) -> None:
        self.stop()
        for pipe in self._pipes.values():
            pipe.close()

    def ended(self) -> dict[str, int]:
        """Return node -> exit status, for the nodes whose process has ended."""
        now = {process: process.status for process in self.running.values()}  # composed nodes end together
        return {node: status for node, process in self.running.items() if (status := now[process]) is not None}

    def statuses(self, seconds: float) -> dict[str, NodeStatus]:
        """Read the pipes for a time [s], and return the latest report of each node that has sent one."""
        until = time.monotonic() + seconds
        while True:
            left = until - time.monotonic()
            select.select([pipe.read_end for pipe in self._pipes.values() if pipe.open], [], [], max(0.0, left))
            for pipe in self._pipes.values():
                pipe.read()
            if left <= 0.0:
                return {node: pipe.latest for node, pipe in self._pipes.items() if pipe.latest}

    def hindered(self) -> float:
        """Return for how long [s] since the last call a process could not run; of several processes the longest.

        It waited for a core; or, before the first report of each of its nodes, it imported and compiled. A process that
        stands still uses no core, and a node that reports and then computes for ever does not go on.
        """
        longest = 0.0
        for process in set(self.running.values()):
            before, now = self._core_times.get(process, CoreTime()), core_time(str(process.pid))
            self._core_times[process] = now
            starts = any(not self._pipes[node].latest for node, own in self.running.items() if own is process)
            computed = now.computed - before.computed if starts else 0.0
            longest = max(longest, computed + now.waited - before.waited)
        return longest

    def stop(self) -> dict[str, int]:
        """Stop all processes, the recorder's last, by force if need be; return node -> exit status."""
        stop([process for node, process in self.running.items() if node != "recorder"], STOP_STEPS)
        stop([process for node, process in self.running.items() if node == "recorder"], STOP_STEPS)
        remove_left_behind()
        return self.ended()

    def explain(self, node: str) -> str:
        """Return a sentence about the end of a node's process."""
        return failures.ended(node, self.running[node])


def _follow(
    processes: NodeProcesses, watch: Watch, graph: GraphConfig, requested: StopRequest, stop_when: StopWhen
) -> str:
    """Wait for the end of the run; return the reason for a failure, or ""."""
    while True:
        statuses = processes.statuses(POLL)
        watch.take(statuses)
        watch.excuse(processes.hindered())
        if requested.is_set():
            return STOPPED
        ended = processes.ended()
        if ended.get(processes.leader) == 0:
            return ""
        if ended and (reason := stop_when(statuses, watch.idle_time())):
            return reason
        if ended:
            return processes.explain(next(iter(ended)))
        idle = watch.idle_time()
        reason = stop_when(statuses, idle) or failures.stands_still(idle, graph, processes.logs, statuses)
        if reason := reason or failures.hangs(processes.running, statuses, processes.logs):
            return reason


def _settle(result: GraphResult, processes: NodeProcesses) -> None:
    """Complete the bag of a recorder that was killed, and draw what a learner has logged."""
    with _collecting_errors(result):
        if "recorder" in processes.running and not (result.bag / "metadata.yaml").exists():
            repair_bag(result.bag)
    if "learner" in processes.running:
        from vpsci_ros.report.learning import save_learning  # with torch, which no other graph needs here

        with _collecting_errors(result):
            save_learning(result.folder)


@contextlib.contextmanager
def _collecting_errors(result: GraphResult) -> Iterator[None]:
    """Collect the error of a block and go on, so that the other files of the run are still written."""
    text = ""
    try:
        yield
    except VpsciError as error:
        text = str(error)
    except OSError as error:
        text = in_words(error)
    result.error = "; ".join(part for part in (result.error, text) if part)


def _incomplete(result: GraphResult, processes: NodeProcesses, resolved: Sections) -> list[str]:
    """Return a clause for each thing that is missing from a run that ended without an error; [] if it is complete."""
    failed = {processes.running[node]: node for node, status in reversed(result.exits.items()) if status != 0}
    missing = [processes.explain(node) for node in failed.values()]
    nodes, requested = list(processes.running), 0
    if "world_simulator" in nodes:
        requested = resolved.get(RunConfig, "world_simulator").total
    if "learner" in nodes:
        weights = result.folder / WEIGHTS_OF_STAGE[resolved.get(LearnerConfig, "learner").stage]
        missing += [] if weights.is_file() else [f"the learner ended without {weights}"]
    recorded = None
    try:
        if "recorder" in nodes:
            result.recording = Bag(result.bag)
            recorded = _recorded(result.recording)
    except InvalidInput as error:
        result.recording = None
        return [*missing, str(error)]
    return missing + failures.incomplete(requested, nodes, result.nodes, recorded, failed.values())


def _recorded(bag: Bag) -> failures.RecordedCounts:
    """Return the numbers of messages in a bag, and those that its recorder counted.

    :raises InvalidInput: the bag is not whole.
    """
    run = bag_run(bag)
    held = {name: topic.messages for name, topic in bag.topics().items()}
    return failures.RecordedCounts(run.count("seen"), run.count("refused"), run.count("written"), held)
