"""Workers that compute units of work: this process, processes of this machine, or a cluster (`extras.cluster`).

A worker gets the job once, then units, and returns the result of each. A worker that dies is replaced.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.runs.plugins import PluginGroup

_MOST_DEATHS = 3  # in a row without a unit done
_GRACE = 60.0  # [s] that a worker has to stop in order, if it takes SIGTERM at all

Unit = TypeVar("Unit")
Result = TypeVar("Result")
Job = Callable[[], Callable[[Unit], Result]]
"""Made once in each worker; what it returns is called with one unit after another."""


class Place(NamedTuple):
    """The place where a worker does a job.

    :ivar folder: into which the units write their files.
    :ivar remote: another machine, perhaps.
    :ivar root: folder with copies of the files that the job reads; empty: they are where they were named.
    """

    folder: Path
    remote: bool = False
    root: str = ""

    def path(self, text: str) -> str:
        """Return where the file named `text` lies at this place; a name that is no absolute path is returned as is."""
        return self.root + text if Path(text).is_absolute() else text


PlacedJob = Callable[[Place], Callable[[Unit], Result]]
"""A job that reads files and writes files, made at a place."""


@dataclass(frozen=True)
class Work(Generic[Unit, Result]):
    """What the workers of a `Site` do.

    :ivar folder: into which the files go that the units write.
    :ivar most: units that there are to compute.
    :ivar reads: returns the user's files that the job reads, with their absolute paths.
    :ivar whole_host: a unit needs all of a machine, where there are several.
    """

    job: PlacedJob[Unit, Result]
    folder: Path
    most: int | None = None
    reads: Callable[[], Iterable[Path]] = tuple
    whole_host: bool = False


class Serial(Generic[Unit, Result]):
    """Computes units in this process, one in each `collect`."""

    size = spare = 1

    def __init__(self, job: Job[Unit, Result]) -> None:
        self._do = job()
        self._units: deque[Unit] = deque()

    def submit(self, unit: Unit) -> None:
        """Put a unit of work in the queue."""
        self._units.append(unit)

    def collect(self) -> list[tuple[Unit, Result]]:
        """Compute the next unit of the queue; return it with its result."""
        unit = self._units.popleft()
        return [(unit, self._do(unit))]

    def close(self) -> None:
        """Discard the queued units."""
        self._units.clear()


class Processes(Generic[Unit, Result]):
    """Computes units in `size` processes of this machine.

    Each process has a connection of its own, of which this process holds one end alone: what a process that dies
    (killed, out of memory) was writing ends there, so that nobody waits for the rest. Another one is started in its
    place, and its unit is done again. A pool of `concurrent.futures` or of loky, whose processes share a pipe that
    the parent can write to as well, waits for ever for a process that is killed while it writes a result.
    """

    spare = 1

    def __init__(self, job: Job[Unit, Result], size: int) -> None:
        self.size = size
        self._job = job
        self._queue: deque[Unit] = deque()
        self._processes: dict[Connection, BaseProcess] = {}
        self._running: dict[Connection, Unit | None] = {}  # of the processes that are up; None: it is idle
        self._deaths = 0
        for _ in range(size):
            self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=_work, args=(there, os.getpid()), daemon=True)
        process.start()
        there.close()
        self._processes[here] = process

    def submit(self, unit: Unit) -> None:
        """Queue a unit for the next free process."""
        self._queue.append(unit)
        self._hand_out()

    def collect(self) -> list[tuple[Unit, Result]]:
        """Wait until one or more units are finished, and return them with their results.

        :raises VpsciError: processes die again and again.
        :raises Exception: what a unit raised in its process.
        """
        found: list[tuple[Unit, Result]] = []
        while not found:
            for connection in wait(list(self._processes)):
                assert isinstance(connection, Connection)
                try:
                    said = connection.recv()
                except (EOFError, OSError):  # it has died, perhaps in the middle of what it was writing
                    self._replace(connection)
                else:
                    if isinstance(said, Exception):
                        raise said
                    if connection not in self._running:  # it says that it is up
                        self._send(connection, self._job)
                    elif (unit := self._running[connection]) is not None:
                        found.append((unit, said))
                    self._running[connection] = None
            self._hand_out()
        self._deaths = 0
        return found

    def _hand_out(self) -> None:
        for connection, unit in self._running.items():
            if unit is None and self._queue:
                self._running[connection] = self._queue.popleft()
                self._send(connection, self._running[connection])

    def _send(self, connection: Connection, what: object) -> None:
        with contextlib.suppress(OSError):  # it has died, which reading from it will show
            connection.send(what)

    def _replace(self, connection: Connection) -> None:
        """Start another process in place of one that has died, and have its unit done again."""
        self._deaths += 1
        self._stop(connection)
        unit = self._running.pop(connection, None)
        if unit is not None:
            self._queue.appendleft(unit)
        if self._deaths >= _MOST_DEATHS * self.size:
            raise VpsciError(
                f"workers died {self._deaths} times in a row (out of memory, killed?)"
                + (f" at {unit}" if unit else "")
                + "; what was finished is kept: run the same command again, perhaps with fewer --workers"
            )
        self._start()

    def _stop(self, connection: Connection) -> None:
        process = self._processes.pop(connection)
        process.terminate()
        process.join(_GRACE)
        process.kill()
        process.join()
        connection.close()

    def close(self) -> None:
        """End the processes, also in the middle of a unit."""
        for process in self._processes.values():
            process.terminate()
        for connection in list(self._processes):
            self._stop(connection)


class Workers(Protocol[Unit, Result]):
    """Workers of one job."""

    @property
    def size(self) -> int:
        """Units that they compute at a time."""

    @property
    def spare(self) -> int:
        """Further units that are worth submitting, so that no worker waits for its next one."""

    def submit(self, unit: Unit) -> None:
        """Queue a unit of work."""

    def collect(self) -> list[tuple[Unit, Result]]:
        """Wait for finished units, and return them with their results; none where `size` has grown."""

    def close(self) -> None:
        """Stop the workers, also in the middle of a unit."""


class Site(Protocol):
    """Where work is done: on this machine or on a cluster."""

    @property
    def alone(self) -> bool:
        """Whether this process computes one unit at a time."""

    @property
    def mixed_cpus(self) -> bool:
        """Whether workers may have other CPUs than this machine, and results other last bits."""

    def start(self, work: Work[Unit, Result]) -> Workers[Unit, Result]:
        """Return workers that do this work."""

    def hosts(self) -> str:
        """Return the names of the machines at work; empty for this machine."""


@dataclass(frozen=True)
class ThisMachine:
    """Work on this machine, by `count` processes; for a count of 1, by this process itself."""

    count: int = 1
    mixed_cpus = False

    @property
    def alone(self) -> bool:
        """Whether this process does the work."""
        return self.count == 1

    def start(self, work: Work[Unit, Result]) -> Workers[Unit, Result]:
        """Return workers that do this work, see `Site`."""
        return local_workers(partial(work.job, Place(work.folder)), min(self.count, work.most or self.count))

    def hosts(self) -> str:
        """Return nothing: it is this machine."""
        return ""


HERE = ThisMachine()
"""This process alone."""
CLUSTERS: PluginGroup[Any] = PluginGroup("vpsci_ros.clusters", "kind of cluster", type, {})
"""Name -> the class of its `Site`; `extras.cluster` adds "dask"."""


def cluster_at(address: str, mixed_cpus: bool) -> Site:
    """Return the Dask cluster whose scheduler is at an address.

    :raises InvalidInput: it is no address, or the folder or the library that works on clusters is not there.
    :raises VpsciError: no scheduler answers.
    """
    if "dask" not in CLUSTERS.names():
        raise InvalidInput(
            f"--cluster {address}: this vpsci_ros lacks extras/cluster; install it again, whole, or use --workers"
        )
    site: Site = CLUSTERS.find("dask")(address, mixed_cpus)
    return site


def mixed(site: Site) -> dict[str, Any]:
    """Return the fact for a run's identity whether workers may have several kinds of CPU: true or null."""
    return {"mixed_cpus": site.mixed_cpus or None}


def local_workers(job: Job[Unit, Result], count: int) -> Workers[Unit, Result]:
    """Return `count` worker processes on this machine; for a count of 1, this process computes the units itself."""
    return Serial(job) if count == 1 else Processes(job, count)


def computed(
    workers: Workers[Unit, Result], next_unit: Callable[[], Unit | None], *, ahead: bool = True
) -> Iterator[tuple[Unit, Result]]:
    """Submit units and yield each with its result.

    :param next_unit: returns what is worth doing next; None: nothing, as things are.
    :param ahead: submit more units than the workers compute at a time, so that none waits.
    """
    running = 0
    while True:
        while running < workers.size + ahead * workers.spare and (unit := next_unit()) is not None:
            workers.submit(unit)
            running += 1
        if not running:
            return
        for done in workers.collect():
            running -= 1
            yield done


def _work(connection: Connection, parent: int) -> None:
    """Be a worker process: receive the job, then compute one unit after another until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to deal with
    threading.Thread(target=end_with, args=(parent,), daemon=True).start()
    try:
        connection.send(None)  # it is up
        job: Job[Any, Any] = connection.recv()
        do = job()
        while True:
            connection.send(do(connection.recv()))
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        return  # the parent has gone, or requested a stop
    except Exception as error:  # noqa: BLE001 - the parent raises it
        connection.send(error)


def end_with(parent: int) -> None:
    """End this process when its parent is gone, which a killed parent cannot see to itself."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
