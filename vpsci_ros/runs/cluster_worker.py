"""The host's side of work on a Dask cluster: tasks of Dask, and the processes in which they have units computed.

Units run in processes of their own, one for each thread of the Dask worker. A cancelled task kills its process, which
no thread allows; a crash kills that process, and Dask's worker stays. A process that waits for longer than `IDLE` ends,
so nothing remains of a command that was killed.
"""

import contextlib
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import distributions
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.errors import VpsciError
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.provenance import cpu_name, kernel_target, package_digest, software_versions
from vpsci_ros.runs.record import RUN_RECORD
from vpsci_ros.runs.workers import Place, end_with

IDLE = 60.0  # [s] after which a process without a unit ends
_LOOK = 0.1  # [s] between looks whether a unit is still wanted
_GRACE = 10.0  # [s] that a process has to end in order
_READY, _REFUSED = b"ready", b"refused"


class Order(NamedTuple):
    """All that a host needs for a job.

    :ivar facts: of the machine that gives the order, see `facts`.
    :ivar job: a pickled `PlacedJob`.
    :ivar files: absolute path -> mode and content of the user's files that the job reads.
    :ivar cwd: the folder in which the command runs.
    """

    facts: dict[str, Any]
    job: bytes
    files: Mapping[str, tuple[int, bytes]]
    cwd: str


def facts(*, mixed_cpus: bool) -> dict[str, Any]:
    """Return all that results depend on besides the job: software, this package's files, and the CPU unless mixed."""
    own = {"software": software_versions(), "package_sha256": package_digest(), "plugins": _plugins()}
    return own if mixed_cpus else own | {"cpu": cpu_name(), "kernels": kernel_target()}


def _plugins() -> list[str]:
    """Return what other installed packages add to this one, with their versions."""
    return sorted(
        f"{point.group} {point.name}: {package.name} {package.version}"
        for package in distributions()
        for point in package.entry_points
        if point.group.startswith("vpsci_ros.") and package.name != "vpsci_ros"
    )


class _Child:
    """A process that computes units of an order.

    :ivar refused: why it cannot.
    """

    def __init__(self, order: bytes, folder: Path) -> None:
        self._connection, there = Pipe()
        command = [sys.executable, "-m", __name__, str(there.fileno()), str(os.getpid()), str(folder)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, pass_fds=[there.fileno()], start_new_session=True
        )
        there.close()
        self.refused = ""
        try:
            self._connection.send_bytes(order)
            if self._connection.recv_bytes() == _REFUSED:
                self.refused = self._connection.recv_bytes().decode()
        except (EOFError, OSError):
            self.refused = f"its process {self.end()} before the first unit"

    def end(self) -> str:
        """Wait for the end of the process and return how it ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE)
        status = self._process.returncode
        if status is None:
            return "closed its connection"
        return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with exit status {status}"

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def compute(self, unit: bytes, wanted: Callable[[], bool]) -> bytes | None:
        """Return the pickled result of a pickled unit; None if it is not wanted any more.

        :raises EOFError: the process has died.
        :raises OSError: likewise.
        """
        self._connection.send_bytes(unit)
        while not self._connection.poll(_LOOK):
            if not wanted():
                return None
        return self._connection.recv_bytes()

    def stop(self) -> None:
        """End the process, also in the middle of a unit."""
        self._process.terminate()
        self.end()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # with all that it started in its session
        self._process.wait()
        self._connection.close()


class _Crew:
    """The processes of one order on this Dask worker."""

    def __init__(self, order: bytes, folder: str) -> None:
        self._order = order
        self._folder = Path(tempfile.mkdtemp(prefix="vpsci-", dir=folder))
        self._idle: list[_Child] = []
        self._all: set[_Child] = set()
        self._lock = threading.Lock()

    def take(self) -> _Child:
        """Return an idle process, or a new one."""
        with self._lock:
            while self._idle:
                if (child := self._idle.pop()).alive:
                    return child
                self._all.discard(child)
            number = len(self._all)
        child = _Child(self._order, Path(tempfile.mkdtemp(prefix=f"{number}-", dir=self._folder)))
        with self._lock:
            self._all.add(child)
        return child

    def give_back(self, child: _Child) -> None:
        """Take back a process that waits for a unit."""
        with self._lock:
            self._idle.append(child)

    def discard(self, child: _Child) -> None:
        """Stop a process."""
        child.stop()
        with self._lock:
            self._all.discard(child)

    def close(self) -> None:
        """Stop all processes, and remove their files."""
        with self._lock:
            children, self._idle = list(self._all), []
        for child in children:
            child.stop()
        shutil.rmtree(self._folder, ignore_errors=True)


_CREWS: dict[str, _Crew] = {}  # of this Dask worker, by name


def enlist(name: str, order: bytes) -> tuple[str, str, int, str]:
    """Task: start the first process of an order.

    :return: name of the host, its address, number of units that it computes at a time, and why this worker is left out
        ("": it is not).
    """
    from distributed import get_worker

    worker = get_worker()
    crew = _CREWS.get(name) or _Crew(order, worker.local_directory)
    child = crew.take()
    if child.refused:
        crew.close()
    else:
        crew.give_back(child)
        _CREWS[name] = crew
    return socket.gethostname(), worker.ip, worker.state.nthreads, child.refused


def compute(name: str, unit: bytes) -> bytes | str:
    """Task: compute a unit.

    :return: the pickled result, which Dask does not copy; or in words how the process died, and "" where this worker
        knows no order of that name.
    """
    from distributed import get_worker

    crew, worker = _CREWS.get(name), get_worker()
    if crew is None:
        return ""
    key = worker.get_current_task()

    def wanted() -> bool:
        task = worker.state.tasks.get(key)
        return task is not None and task.state == "executing" and worker.status.name == "running"

    child = crew.take()
    result = None
    try:
        result = None if child.refused else child.compute(unit, wanted)
        return "" if result is None else result
    except (EOFError, OSError):
        return child.end()
    finally:
        crew.discard(child) if result is None else crew.give_back(child)


def dismiss(name: str) -> None:
    """Stop the processes of an order on this Dask worker."""
    if crew := _CREWS.pop(name, None):
        crew.close()


def main(descriptor: int, parent: int, folder: str) -> None:
    """Run a process of an order: make the job, then compute one unit after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # graphs of other hosts may have the same domain
    threading.Thread(target=end_with, args=(parent,), daemon=True).start()
    connection = Connection(descriptor)
    order: Order = pickle.loads(connection.recv_bytes())
    outputs = Path(folder, "outputs")
    outputs.mkdir()
    try:
        mine = facts(mixed_cpus="cpu" not in order.facts)
        require_same("this worker", mine, order.facts, "computes", "install there what is installed here")
        root = _lay_out(order, f"{folder}/files")
        do = pickle.loads(order.job)(Place(outputs, True, root))
    except Exception as error:  # noqa: BLE001 - the command says it
        connection.send_bytes(_REFUSED)
        connection.send_bytes((str(error) if isinstance(error, VpsciError) else repr(error)).encode())
        return
    connection.send_bytes(_READY)
    while connection.poll(IDLE):
        try:
            unit = pickle.loads(connection.recv_bytes())
        except EOFError:
            return
        try:
            result: Any = do(unit)
        except Exception as error:  # noqa: BLE001 - the command raises it
            result = error
        connection.send_bytes(pickle.dumps((result, list(_taken(outputs))), pickle.HIGHEST_PROTOCOL))


def _lay_out(order: Order, root: str) -> str:
    """Make the job's files readable, and go to the folder of the command; return `Place.root`."""
    if Path(order.cwd).is_dir() and all(_has(Path(path), data) for path, (_, data) in order.files.items()):
        root = ""
    else:
        for path, (mode, data) in order.files.items():
            copy = Path(root + path)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(data)
            copy.chmod(mode)
    folder = Path(root + order.cwd)
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    return root


def _has(path: Path, data: bytes) -> bool:
    try:
        return path.read_bytes() == data
    except OSError:
        return False


def _taken(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the path and content of each file in a folder, in the order in which they were written; empty it.

    The record of a run comes last: a run whose record is there has all its files.
    """
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    for path in sorted(files, key=lambda path: (path.name == RUN_RECORD, path.stat().st_mtime_ns)):
        yield str(path.relative_to(folder)), path.read_bytes()
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
