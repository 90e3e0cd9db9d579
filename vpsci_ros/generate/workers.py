"""Processes that compute units: started fresh, single-threaded, replaced when they die.

A worker gets the job once, then units, and gives their episodes back as bytes; it never touches a file, so nothing is
lost or half written when it dies. `Serial` is the same without processes, `ray_workers` the same over a cluster.
"""

import os
import signal
import threading
import time
from collections import deque
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.reduction import ForkingPickler
from multiprocessing.shared_memory import SharedMemory
from typing import Protocol

from vpsci_ros.errors import VpsciError
from vpsci_ros.generate.job import Job, Unit
from vpsci_ros.generate.simulate import Simulator

_MOST_DEATHS = 3  # in a row without a unit computed
_simulator: Simulator | None = None


class Workers(Protocol):
    """Whoever computes units."""

    size: int

    def submit(self, unit: Unit) -> None:
        """Have a unit computed, some time."""

    def collect(self) -> list[tuple[Unit, bytes]]:
        """Wait for at least one unit and return those computed, each with the bytes of its episodes."""

    def close(self) -> None:
        """Stop at once; what is not collected is lost."""


class Serial:
    """Computes units in this process, one in each `collect`."""

    size = 1

    def __init__(self, job: Job, batch: int) -> None:
        self._simulator = Simulator(job, batch)
        self._units: deque[Unit] = deque()

    def submit(self, unit: Unit) -> None:
        """Put a unit in the queue."""
        self._units.append(unit)

    def collect(self) -> list[tuple[Unit, bytes]]:
        """Compute the next unit of the queue."""
        unit = self._units.popleft()
        return [(unit, self._simulator.run(unit).to_bytes())]

    def close(self) -> None:
        """Forget the queue."""
        self._units.clear()


class Processes:
    """Computes units in `size` processes of this machine.

    A process that dies (killed, out of memory) takes its companions along; all are started anew and the units that
    were on their way are computed again. The job lies in shared memory: a process is started through a pipe, and what
    does not fit into the pipe would keep this process waiting for ever for one that dies before it has read it.
    """

    def __init__(self, job: Job, batch: int, size: int) -> None:
        self.size = size
        data = bytes(ForkingPickler.dumps(job))
        self._job = SharedMemory(create=True, size=len(data))
        assert self._job.buf is not None  # it is until close()
        self._job.buf[: len(data)] = data
        self._batch = batch
        self._running: dict[Future[bytes], Unit] = {}
        self._deaths = 0
        self._pool = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self.size, get_context("spawn"), initializer=_begin, initargs=(self._job.name, self._batch, os.getpid())
        )

    @property
    def pids(self) -> list[int]:
        """Process ids of the workers that are up."""
        return list(self._pool._processes)

    def submit(self, unit: Unit) -> None:
        """Hand a unit to the next free process."""
        try:
            self._running[self._pool.submit(_compute, unit)] = unit
        except (BrokenProcessPool, OSError):  # OSError: the pool has found out, and closes its pipes
            self._revive([unit])

    def collect(self) -> list[tuple[Unit, bytes]]:
        """Wait for a process to finish a unit.

        :raises VpsciError: processes die again and again.
        """
        while True:
            done, _ = wait(self._running, return_when=FIRST_COMPLETED)
            units = [(self._running.pop(future), future) for future in done]
            lost = [unit for unit, future in units if isinstance(future.exception(), BrokenProcessPool)]
            found = [(unit, future.result()) for unit, future in units if unit not in lost]
            if found:
                self._deaths = 0
            if lost:
                self._revive(lost)
            if found:
                return found

    def _end(self) -> None:
        """End the pool and its processes.

        A broken pool ends them itself, but for one that it is starting just then; for that it waits, and this process
        with it when it wants to end (CPython 3.11, `terminate_broken`).
        """
        processes = list(self._pool._processes.values()) if self._pool._processes else []
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        for process in processes:
            process.join()

    def _revive(self, lost: list[Unit]) -> None:
        self._deaths += 1
        if self._deaths >= _MOST_DEATHS:
            raise VpsciError(
                f"workers died {self._deaths} times in a row (out of memory, killed?) at "
                f"{', '.join(f'scenario {u.scenario} from {u.numbers[0]}' for u in lost)}; "
                "what was finished is kept: run the same command again, perhaps with fewer --workers"
            )
        lost = [*lost, *self._running.values()]
        self._running.clear()
        self._end()
        self._pool = self._start()
        for unit in lost:
            self.submit(unit)

    def close(self) -> None:
        """End the processes, also in the middle of a unit."""
        self._end()
        self._job.close()
        self._job.unlink()


def _begin(shared: str, batch: int, parent: int) -> None:
    global _simulator  # noqa: PLW0603 - a worker's one possession, made once in the process
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to deal with
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    memory = SharedMemory(shared)
    assert memory.buf is not None
    _simulator = Simulator(ForkingPickler.loads(memory.buf), batch)
    memory.close()


def _end_with(parent: int) -> None:
    """End this process when its parent is gone, which a killed parent cannot see to itself."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _compute(unit: Unit) -> bytes:
    assert _simulator is not None, "a worker computes after _begin"
    return _simulator.run(unit).to_bytes()
