"""Graphs whose processes are killed, stopped, delayed and stopped by request at random, and what must hold afterwards.

One graph runs undisturbed; its bag says what everybody's must hold. A disturbed run ends with 0 and the same bag, or
not with 0 and a record that says why, beside a bag that opens and whose content is that of the undisturbed one as far
as it goes. Nothing of it is alive ten seconds after its end, nobody prints a traceback, and nothing hangs.
"""

import contextlib
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.wire.layout import SAFETY, WORLD

NODES = ("world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder")
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP)
GRAPH = "graph"  # `vpsci graph` itself
PATIENT = 60.0  # [s] longer than any node of an undisturbed run is kept from the processor
LIMIT = 150.0  # [s] for a run, on a loaded machine
ORPHANS = 10.0  # [s] after which nobody of a run may be alive
SETTINGS = (
    *("world_simulator.scenarios=[1,8]", "world_simulator.episodes=2", "world_simulator.batch=2"),
    *("graph.progress_timeout=60.0", "recorder.chunk_size=16"),
)
COMPARED = (WORLD, SAFETY, "/vehicle/action", "/pedestrian/action")
_MARK = "VPSCI_CHAOS"


class Disturbance(NamedTuple):
    """What is done to a run: to whom, after so many seconds of it, which signal; a stop lasts `seconds`."""

    node: str
    after: float
    number: signal.Signals
    seconds: float
    action_timeout: float  # [s] of the world's patience for answers

    def __str__(self) -> str:
        lasts = f" for {self.seconds:.1f} s" if self.number == signal.SIGSTOP else ""
        patience = f", answers within {self.action_timeout:g} s"
        return f"{self.number.name} to {self.node} after {self.after:.2f} s{lasts}{patience}"


def disturbance(seed: int, lasts: float) -> Disturbance:
    """Return the disturbance of a case; `lasts`: seconds that an undisturbed run takes."""
    rng = random.Random(f"processes/{seed}")
    return Disturbance(
        node=rng.choice((*NODES, GRAPH)),
        after=rng.uniform(0.2, lasts),
        number=rng.choice(SIGNALS),
        seconds=rng.uniform(0.3, 4.0),
        action_timeout=rng.choice((2.0, PATIENT, PATIENT)),
    )


Meddle = Callable[["subprocess.Popen[bytes]", str, int], None]
"""Does something to a graph: its process, the mark in its processes' environment, its ROS domain."""


class Run(NamedTuple):
    """A run as it ended: exit status, what it printed, seconds, who is alive `ORPHANS` later, its folder."""

    status: int | None
    said: str
    seconds: float
    orphans: list[str]
    folder: Path


def run(folder: Path, disturbed: Disturbance | None = None) -> Run:
    """Run a graph, disturb it, and wait for its end."""
    if disturbed is None:
        return run_beside(folder, (f"world_simulator.action_timeout={PATIENT}",))
    settings = (f"world_simulator.action_timeout={disturbed.action_timeout}",)
    return run_beside(folder, settings, lambda graph, mark, _: _disturb(disturbed, graph, mark))


def run_beside(folder: Path, settings: tuple[str, ...], meddle: Meddle | None = None) -> Run:
    """Run a graph with these settings besides `SETTINGS`, let somebody meddle with it, and wait for its end."""
    mark = f"{os.getpid()}/{folder.name}/{time.monotonic_ns()}"
    command = [sys.executable, "-m", "vpsci_ros.cli", "graph", "--params", "stage3_generate", "-o", str(folder / "run")]
    command += [part for text in (*SETTINGS, *settings) for part in ("--set", text)]
    with own_domain(), open(folder / "said.txt", "w+") as said:
        domain, own = int(os.environ["ROS_DOMAIN_ID"]), {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", _MARK: mark}
        begun = time.monotonic()
        graph = subprocess.Popen(command, env=os.environ | own, stdout=said, stderr=said, start_new_session=True)
        try:
            if meddle is not None:
                meddle(graph, mark, domain)
            with contextlib.suppress(subprocess.TimeoutExpired):
                graph.wait(LIMIT)
            seconds = time.monotonic() - begun
            orphans = _alive_after(ORPHANS, mark) if graph.poll() is not None else []
        finally:
            for pid in _alive(mark):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            graph.wait()
        said.seek(0)
        ended = None if seconds >= LIMIT else graph.returncode
        return Run(ended, said.read(), seconds, orphans, folder / "run")


def _disturb(disturbed: Disturbance, graph: subprocess.Popen[bytes], mark: str) -> None:
    deadline = time.monotonic() + disturbed.after
    while time.monotonic() < deadline and graph.poll() is None:
        time.sleep(0.01)
    pids = [graph.pid] if disturbed.node == GRAPH else _of_node(disturbed.node, mark)
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, disturbed.number)
    if disturbed.number == signal.SIGSTOP:
        time.sleep(disturbed.seconds)
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)


def _alive(mark: str) -> Iterator[int]:
    """Yield the processes of a run, by the mark in their environment."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
                if state != "Z" and f"{_MARK}={mark}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                    yield int(entry.name)


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    return ""


def _of_node(node: str, mark: str) -> list[int]:
    return [pid for pid in _alive(mark) if f"vpsci_ros.nodes {node} " in _command(pid)]


def _alive_after(seconds: float, mark: str) -> list[str]:
    deadline = time.monotonic() + seconds
    while (alive := list(_alive(mark))) and time.monotonic() < deadline:
        time.sleep(0.05)
    return [_command(pid) for pid in alive]


def content(bag: Path) -> dict[str, str]:
    """Return a hash of every compared message of a bag by topic and stamp; what is whole of one that is damaged.

    The answers to the last tick are left out: the world is done then, and waits for nobody.
    """
    messages = list(digests(Bag(bag, recover=True)))
    end = max((at for _, at, _ in messages), default=0)
    return {f"{topic} {at}": digest for topic, at, digest in messages if at < end or topic == WORLD}


def digests(bag: Bag) -> Iterator[tuple[str, int, str]]:
    """Yield topic, stamp [ns] and a hash of every compared message of a bag."""
    for raw in bag.messages(COMPARED):
        yield raw.topic, raw.time, hashlib.sha256(raw.data[12:]).hexdigest()


def defects(case: Run, disturbed: Disturbance, undisturbed: dict[str, str]) -> list[str]:
    """Return what does not hold of a disturbed run, one sentence each."""
    found = defects_of_end(case)
    if case.status is None:
        return found
    killed = disturbed.node == GRAPH and disturbed.number == signal.SIGKILL and case.status == -signal.SIGKILL
    record = case.folder / "run.json"
    error = json.loads(record.read_text())["error"] if record.is_file() else None
    began = case.folder.is_dir() and any(case.folder.iterdir())
    if case.status == 0 and error != "":
        found.append(f"status 0, but its record says {error!r}")
    if case.status != 0 and not error and not killed and (began or not case.said.strip()):
        found.append(f"status {case.status}, but no record that says why")
    return found + _of_bag(case, undisturbed)


def defects_of_end(case: Run) -> list[str]:
    """Return who of a run is alive, what was printed that nobody should see, and whether it never ended."""
    found = [f"alive {ORPHANS:g} s after the end: {name[:60]}" for name in case.orphans]
    logs = [path.read_text(errors="replace") for path in case.folder.glob("log/*.log")]
    if any("Traceback (most recent call last)" in text for text in (case.said, *logs)):
        found.append("somebody printed a traceback")
    return found if case.status is not None else [*found, f"it ran for more than {LIMIT:g} s"]


def _of_bag(case: Run, undisturbed: dict[str, str]) -> list[str]:
    bag = case.folder / "bag"
    if not bag.is_dir() or not any(bag.glob("*.mcap")):
        return ["status 0 without a bag"] if case.status == 0 else []
    try:
        if not (bag / "metadata.yaml").exists():
            repair_bag(bag)
        bag_info(bag)
        held = content(bag)
    except InvalidInput as error:
        empty = any(text in str(error) for text in ("no message", "nothing was recorded"))
        return [] if empty and case.status != 0 else [f"its bag does not open: {error}"]
    if case.status == 0 and held != undisturbed:
        return [f"status 0, but its bag holds {len(held)} messages of {len(undisturbed)}, or others"]
    differing = {key for key in held if undisturbed.get(key) not in (None, held[key])}
    return _explained(case, differing, held)


def _explained(case: Run, differing: set[str], held: dict[str, str]) -> list[str]:
    """Messages may differ from the undisturbed ones only where the run says that answers were missing."""
    if not differing or "missing" in case.said or "answers" in case.said:
        return []
    return [f"{len(differing)} of {len(held)} messages differ from those of the undisturbed run, without a word"]


def undisturbed() -> tuple[dict[str, str], float]:
    """Return the content of an undisturbed run's bag, and how many seconds it took."""
    with tempfile.TemporaryDirectory() as folder:
        whole = run(Path(folder))
        if whole.status != 0:
            raise AssertionError(f"the undisturbed run failed: {whole.said}")
        return content(whole.folder / "bag"), whole.seconds
