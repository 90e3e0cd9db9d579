"""The host's side of work on a Dask cluster: tasks of Dask, and the processes in which they have units computed.

Units run in processes of their own, one for each thread of the Dask worker. A cancelled task kills its process, which
no thread allows; a crash kills that process, and Dask's worker stays. The processes end when Dask's scheduler says that
the command, stopped or killed, does not want them any more.
"""

import asyncio
import contextlib
import errno
import hashlib
import os
import pickle
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.metadata import distributions
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import vpsci_ros
from vpsci_ros.errors import REMEDIES, VpsciError, in_words
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.processes import ChildProcess, stop
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.record import RUN_RECORD
from vpsci_ros.runs.workers import Place

if TYPE_CHECKING:
    from distributed import Worker

_LOOK = 0.1  # [s] between looks whether a unit is still wanted
_GRACE = 10.0  # [s] that a process has to end in order
_REFUSED = b"refused: "
_DISK = tuple(REMEDIES[number] for number in (errno.ENOSPC, errno.EFBIG, errno.EROFS, errno.EACCES))


class UnitDied(VpsciError):
    """The process of a unit has died."""


class _Refused(Exception):
    """This worker computes no units of an order, and why."""


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
    own = {"software": software_versions(), "package_sha256": _package_digest(), "plugins": _plugins()}
    return own if mixed_cpus else own | {"cpu": cpu_name(), "kernels": _kernel_target()}


def _package_digest() -> str:
    """Return a SHA-256 of all files of this package: sources, weights and recordings."""
    root, digest = Path(vpsci_ros.__file__).resolve().parent, hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(root)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _kernel_target() -> list[str]:
    """Return what numba compiles kernels for: machine, CPU and its features, which decide about their last bits."""
    from numba.core.registry import cpu_target

    return [str(text) for text in cpu_target.target_context.codegen().magic_tuple()]


def _plugins() -> list[str]:
    """Return what other installed packages add to this one, with their versions."""
    return sorted(
        f"{point.group} {point.name}: {package.name} {package.version}"
        for package in distributions()
        for point in package.entry_points
        if point.group.startswith("vpsci_ros.") and package.name != "vpsci_ros"
    )


class _Child:
    """A process that makes the job of an order, then computes units."""

    def __init__(self, folder: Path) -> None:
        self._connection, there = Pipe()
        command = [sys.executable, "-m", __name__, str(there.fileno()), str(folder)]
        environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}  # other hosts may have its domain
        self.process = ChildProcess(command, folder / "log", environment, inherited=[there.fileno()])
        there.close()

    def ask(self, words: bytes, wanted: Callable[[], bool]) -> bytes:
        """Send an order or a unit, and return the answer.

        :raises Reschedule: it is not wanted any more.
        :raises EOFError: the process has died.
        :raises OSError: likewise.
        """
        from distributed import Reschedule

        self._connection.send_bytes(words)
        while not self._connection.poll(_LOOK):
            if not wanted():
                raise Reschedule
        answer = self._connection.recv_bytes()
        if answer.startswith(_REFUSED):
            raise _Refused(answer.removeprefix(_REFUSED).decode())
        return answer

    def stop(self) -> None:
        """End the process, also in the middle of a unit, with all that it started in its session."""
        stop([self.process], ((signal.SIGTERM, _GRACE), (signal.SIGKILL, _GRACE)))
        self.process.signal(signal.SIGKILL)
        self._connection.close()


class _Crew:
    """The processes of one order on this Dask worker: as many as have computed at a time.

    :ivar refused: why they compute no more units.
    """

    def __init__(self, order: bytes, folder: str) -> None:
        self._order, self.refused, self._closed = order, "", False
        self._folder = Path(tempfile.mkdtemp(prefix="vpsci-", dir=folder))
        self._all: set[_Child] = set()
        self._idle: list[_Child] = []

    def ask(self, wanted: Callable[[], bool], unit: bytes = b"") -> bytes:
        """Have an idle process, or a new one, compute a unit; empty: none.

        :raises Reschedule: it is not wanted any more.
        :raises UnitDied: the process has died.
        """
        from distributed import Reschedule

        child = None
        try:
            with contextlib.suppress(IndexError):  # of an empty list
                child = self._idle.pop()
            if child is None or child.process.status is not None:
                child = _Child(Path(tempfile.mkdtemp(dir=self._folder)))
                self._all.add(child)
                child.ask(self._order, wanted)
            answer = child.ask(unit, wanted) if unit else b""
            self._idle.append(child)
            return answer
        except BaseException as error:
            if child is not None:
                child.process.wait(_GRACE if isinstance(error, EOFError) else 0.0)  # which says how it ended
                died = f"its process {child.process.end or 'closed its connection'}"
                child.stop()
                self._all.discard(child)
            if not isinstance(error, EOFError | OSError):
                raise
            if disk := _of_disk(error):
                raise _Refused(disk) from None
            if self._closed or not wanted():
                raise Reschedule from None
            raise UnitDied(died) from None

    def close(self) -> None:
        """Stop all processes, and remove their files."""
        self._closed = True
        while self._all:
            self._all.pop().stop()
        shutil.rmtree(self._folder, ignore_errors=True)


_CREWS: dict[str, _Crew] = {}  # of this Dask worker, by name


def enlist(name: str, order: bytes, slots: int) -> tuple[str, int, str]:
    """Task: start the first process of an order, and offer to compute units as long as Dask keeps this task's result.

    :param slots: units at a time; 0: one for each thread.
    :return: name of the host, number of units that it computes at a time, and why this worker is left out ("": it is
        not).
    """
    from distributed import get_worker

    worker = get_worker()
    crew, slots = _Crew(order, worker.local_directory), slots or worker.state.nthreads
    wanted = partial(_wanted, worker, worker.get_current_task(), "executing", "memory")
    try:
        crew.ask(wanted)
    except _Refused as error:
        crew.close()
        return socket.gethostname(), 0, str(error)
    _CREWS[name] = crew
    _offer(worker, name, slots)
    threading.Thread(target=_keep, args=(worker, name, crew, wanted), daemon=True).start()
    return socket.gethostname(), slots, ""


def _wanted(worker: "Worker", key: str, *states: str) -> bool:
    """Return whether this worker is to have a task in one of these states; a worker may retire in vain."""
    task = worker.state.tasks.get(key)
    at_work = worker.status.name in ("running", "paused", "closing_gracefully")
    return at_work and task is not None and task.state in states


def _offer(worker: "Worker", name: str, slots: int) -> None:
    """Have Dask's scheduler give units of an order to this worker, so many at a time; 0: none beside those it has."""
    from distributed.core import Status

    async def offered() -> None:
        if not slots:  # for the worker itself the offer stands, or it would keep what it has and not begin it
            await worker.scheduler.set_resources(worker=worker.contact_address, resources={name: 0})
            return
        await worker.set_resources(**{name: slots})
        if worker.status is Status.running:
            worker.status = Status.paused  # Dask looks for tasks that no worker could do when one begins to run, and
            worker.status = Status.running  # not when one offers something

    asyncio.run_coroutine_threadsafe(offered(), worker.loop.asyncio_loop).result(_GRACE)


def _keep(worker: "Worker", name: str, crew: _Crew, wanted: Callable[[], bool]) -> None:
    """Close a crew when it is not wanted any more."""
    while wanted():
        time.sleep(10 * _LOOK)
    _CREWS.pop(name, None)
    crew.close()
    with contextlib.suppress(Exception):  # the scheduler or this worker may have ended
        _offer(worker, name, 0)


def compute(name: str, unit: bytes) -> bytes | tuple[str, str]:
    """Task: compute a unit.

    :return: the pickled result, which Dask does not copy; or address of this worker and why it computes no units.
    :raises UnitDied: its process has died.
    :raises Reschedule: it is not wanted here any more.
    """
    from distributed import Reschedule, get_worker

    worker = get_worker()
    if (crew := _CREWS.get(name)) is None:
        _offer(worker, name, 0)
        raise Reschedule
    if not crew.refused:
        try:
            return crew.ask(partial(_wanted, worker, worker.get_current_task(), "executing"), unit)
        except _Refused as error:
            crew.refused = str(error)
    _offer(worker, name, 0)
    return worker.address, f"{socket.gethostname()}: {crew.refused}"


def _of_disk(error: BaseException | None) -> str:
    """Return in words that a disk took no more, if an error came of that; empty: it did not."""
    while error is not None and not in_words(error).endswith(_DISK):
        error = error.__cause__ or error.__context__
    return in_words(error) if error else ""


def main(descriptor: int, folder: str) -> None:
    """Run a process of an order: make the job, then compute one unit after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    connection = Connection(descriptor)
    order: Order = pickle.loads(connection.recv_bytes())
    outputs = Path(folder, "outputs")
    try:
        outputs.mkdir()
        mine = facts(mixed_cpus="cpu" not in order.facts)
        require_same("this worker", mine, order.facts, "computes", "install there what is installed here")
        root = _lay_out(order, f"{folder}/files")
        do = pickle.loads(order.job)(Place(outputs, True, root))
    except Exception as error:  # noqa: BLE001 - the command says it
        connection.send_bytes(_REFUSED + (str(error) if isinstance(error, VpsciError) else repr(error)).encode())
        return
    connection.send_bytes(b"ready")
    with contextlib.suppress(EOFError):
        while True:
            unit = pickle.loads(connection.recv_bytes())
            try:
                result: Any = do(unit)
            except Exception as error:  # noqa: BLE001 - the command raises it
                result = error
            if isinstance(result, Exception) and (disk := _of_disk(result)):
                connection.send_bytes(_REFUSED + disk.encode())
                return
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
    main(int(sys.argv[1]), sys.argv[2])
