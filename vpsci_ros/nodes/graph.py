"""A whole graph as processes: started together, watched, and stopped cleanly, however it ends.

The graph has one leading node, whose end is the end of the run: the world simulator, or, in stage 1, the learner.
Any other process that ends on its own ends the run with an error that names it. The recorder is stopped last.
"""

import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import yaml

from vpsci_ros.config import SECTIONS, GraphConfig, pick, require_one_noise
from vpsci_ros.data.bag_repair import repair_bag
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.learning.config import RefineConfig
from vpsci_ros.nodes.watch import WATCH, Watch
from vpsci_ros.parameters import as_ros_parameters, table
from vpsci_ros.provenance import require_empty_folder, sha256, software_versions, written_whole
from vpsci_ros.resources import weights_path
from vpsci_ros.world import WorldConfig

STOP_PATIENCE = 30.0  # [s] from SIGINT to SIGKILL
POLL = 0.1  # [s]


@dataclass
class GraphResult:
    """How a run of a graph ended: `error` is empty when it ran to its end."""

    folder: Path
    error: str = ""
    wall_time: float = 0.0
    progress: dict[str, float] = field(default_factory=dict)
    exits: dict[str, int] = field(default_factory=dict)

    @property
    def bag(self) -> Path:
        """The bag's folder, when the graph has a recorder."""
        return self.folder / "bag"


def run_graph(
    sections: dict[str, dict[str, Any]],
    folder: str | Path,
    *,
    quiet: bool = False,
    stop_when: Callable[[Watch], str] | None = None,
) -> GraphResult:
    """Run a graph to its end and return how it went; a run that fails or is interrupted returns with `error` set.

    :param sections: section -> values, as `vpsci_ros.config.load` returns them.
    :param folder: output folder, empty or new: bag/, learner/, log/, params.yaml (resolved), run.json.
    :param stop_when: asked again and again; an answer ends the run, and is its `error`.
    :raises InvalidInput: a parameter is refused, there are no such weights, or the folder is not empty; nothing has
        been started then.
    """
    resolved = resolve(sections, Path(folder))
    weights = sorted({values["weights"] for values in resolved.values() if values.get("weights")})
    hashes = {name: sha256(weights_path(name)) for name in weights}
    folder = require_empty_folder(folder)
    parameters = folder / "params.yaml"
    chosen = pick(GraphConfig, resolved["graph"], "graph")
    layout = as_ros_parameters(resolved, any_namespace=bool(chosen.namespace))
    parameters.write_text(yaml.safe_dump(layout, sort_keys=False), encoding="utf-8")
    result = GraphResult(folder)
    begun = time.monotonic()
    with _interruptible(), Processes(chosen.nodes, parameters, folder / "log", chosen.namespace) as processes:
        try:
            with Watch(resolved, quiet=quiet) as watch:
                result.error = _follow(processes, watch, chosen, stop_when)
                result.progress = watch.summary()
        except KeyboardInterrupt:
            result.error = "stopped on request"
        finally:
            result.exits = processes.stop()
    result.wall_time = time.monotonic() - begun
    _settle_bag(result, processes)
    if "learner" in processes.running:
        from vpsci_ros.analysis.learning_figures import save_learning  # with torch, which no other graph needs here

        save_learning(folder / "learner")
    _write_record(result, resolved, hashes)
    return result


def resolve(sections: dict[str, dict[str, Any]], folder: Path) -> dict[str, dict[str, Any]]:
    """Return every parameter of every node of the graph, defaults filled in, paths under `folder`, peers set.

    :raises InvalidInput: a value is refused, two of them do not go together, or the list of nodes makes no graph.
    """
    graph = pick(GraphConfig, sections.get("graph", {}), "graph")
    if "world_simulator" not in graph.nodes and "learner" not in graph.nodes:
        raise InvalidInput(f"graph.nodes = {graph.nodes}: expected world_simulator or learner among them, to lead")
    resolved: dict[str, dict[str, Any]] = {"graph": asdict(graph)}
    for node in graph.nodes:
        values = dict(sections.get(node, {}))
        values["peers"] = [*graph.nodes, WATCH]
        if node == "recorder":
            values["bag"] = str(folder / "bag")
        if node == "learner":
            values["output"] = str(folder / "learner")
        resolved[node] = {}
        for config in SECTIONS[node]:
            pick(config, values, node)
            resolved[node] |= {row.name: values.get(row.name, row.default) for row in table(config)}
    if "learner" in resolved and "world_simulator" in resolved:
        refine = pick(RefineConfig, resolved["learner"], "learner")
        refine.require_known_world(pick(WorldConfig, resolved["world_simulator"], "world_simulator"))
        require_one_noise(resolved)
    return resolved


class Processes:
    """The graph's processes, each logging to a file; all are gone when the `with` block is left."""

    def __init__(self, nodes: list[str], parameters: Path, logs: Path, namespace: str = "") -> None:
        self.leader = "world_simulator" if "world_simulator" in nodes else "learner"
        self.logs = logs
        self._nodes = nodes
        self._arguments = ["--ros-args", "--params-file", str(parameters)]
        self._arguments += ["-r", f"__ns:={namespace}"] if namespace else []
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Processes":
        self.logs.mkdir()
        for node in self._nodes:
            self.start(node)
        return self

    def start(self, node: str) -> None:
        """Start a node; its log goes on where one of the same name has stopped."""
        with open(self.logs / f"{node}.log", "ab") as log:
            self.running[node] = subprocess.Popen(
                [sys.executable, "-m", f"vpsci_ros.nodes.{node}", *self._arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=_environment(),
                start_new_session=True,  # Ctrl-C reaches this process only, which stops the others in order
                preexec_fn=_die_with_parent,  # noqa: PLW1509 - one call of the C library, no Python lock
            )

    def __exit__(self, *_: object) -> None:
        self.stop()

    def ended(self) -> dict[str, int]:
        """Return the exit status of each process that has ended."""
        return {node: process.returncode for node, process in self.running.items() if process.poll() is not None}

    def stop(self) -> dict[str, int]:
        """Ask all processes to stop, the recorder last; return their exit statuses. Those that do not are killed."""
        last = [node for node in self.running if node == "recorder"]
        for group in ([node for node in self.running if node not in last], last):
            for node in group:
                if self.running[node].poll() is None:
                    self.running[node].send_signal(signal.SIGINT)
            deadline = time.monotonic() + STOP_PATIENCE
            for node in group:
                try:
                    self.running[node].wait(max(0.0, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    self.running[node].kill()
                    self.running[node].wait()
        return {node: process.returncode for node, process in self.running.items()}

    def explain(self, node: str, status: int) -> str:
        """Return one line on how a process ended, with the last error line of its log."""
        how = f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with exit status {status}"
        lines = (self.logs / f"{node}.log").read_text(encoding="utf-8", errors="replace").splitlines()
        said = next((line for line in reversed(lines) if "error" in line.lower()), "")
        return f"{node} {how}" + (f": {said.strip()}" if said else "") + f" (log: {self.logs / node}.log)"


def _follow(
    processes: Processes, watch: Watch, graph: GraphConfig, stop_when: Callable[[Watch], str] | None = None
) -> str:
    """Wait for the end of the run; return what went wrong, or nothing."""
    restarts = graph.restarts
    while True:
        watch.spin(POLL)
        ended = processes.ended()
        if processes.leader in ended and ended[processes.leader] == 0:
            watch.drain()
            return ""
        for node, status in ended.items():
            if status > 0 or not node.endswith("_policy") or restarts == 0:
                return processes.explain(node, status)
            restarts -= 1
            watch.hold(node)
            processes.start(node)
        if stop_when is not None and (reason := stop_when(watch)):
            return reason
        if watch.idle_time() > graph.progress_timeout:
            return f"no progress for {graph.progress_timeout:g} s; the nodes' logs are in {processes.logs}"


def _settle_bag(result: GraphResult, processes: Processes) -> None:
    """Complete the bag of a recorder that was killed."""
    if "recorder" in processes.running and not (result.bag / "metadata.yaml").exists():
        try:
            repair_bag(result.bag)
        except VpsciError as error:
            result.error = f"{result.error}; {error}".removeprefix("; ")


def _write_record(result: GraphResult, resolved: dict[str, dict[str, Any]], weights: dict[str, str]) -> None:
    near_misses = resolved.get("learner", {}).get("near_misses", [])
    record = {
        "error": result.error,
        "wall_time_sec": round(result.wall_time, 3),
        "progress": result.progress,
        "exit_status": result.exits,
        "weights_sha256": weights,
        "near_misses_sha256": {path: sha256(path) for path in near_misses if Path(path).is_file()},
        "software": software_versions(),
    }
    with written_whole(result.folder / "run.json") as path:
        path.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def _environment() -> dict[str, str]:
    environment = dict(os.environ)
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    environment.setdefault("PYTHONUNBUFFERED", "1")
    environment.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # idle threads of torch must not keep the nodes from a core
    return environment


def _die_with_parent() -> None:
    """In the child: have the kernel stop it should this process be killed (Linux)."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Treat SIGTERM as Ctrl-C for as long as children have to be stopped in order."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread: signals go there
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
