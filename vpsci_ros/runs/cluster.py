"""Work on a Dask cluster: units go to the cluster's workers, and their results and files come back to this process.

Each worker is first asked for what results depend on (`cluster_worker.facts`) and makes the job; one that differs or
refuses is left out and named. This process alone writes: at most two results and the units in flight are in its memory.
A unit whose worker dies is done again elsewhere, up to `MOST_DEATHS` times; then it is named, and the rest goes on.
Nobody knows which of its units a worker was computing as it died, for the last answers may be lost with it. So each of
them is done again on a worker that has nothing else to do: only the unit that kills is there when that one dies, too.
"""

import contextlib
import itertools
import logging
import pickle
import queue
import re
import sys
import time
import uuid
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic

from vpsci_ros.errors import InvalidInput, VpsciError, require
from vpsci_ros.runs.cluster_worker import Order, compute, dismiss, enlist, facts
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.workers import Result, Unit, Work, Workers

if TYPE_CHECKING:
    from distributed import Client, Future

MOST_DEATHS = 3  # of workers at one unit, which is given up if that is more than half of all deaths
PATIENCE = 300.0  # [s] without any worker
_ANSWERS = 10.0  # [s] that a scheduler has to answer
_LOOK = 1.0  # [s] between looks for workers that came or went
_SHOWN = 4  # hosts in the progress
_HOST_TAKEN = "another worker has this host"


@dataclass
class DaskCluster:
    """Work on a Dask cluster.

    :ivar address: of its scheduler, or a scheduler file.
    :ivar mixed_cpus: workers may have other CPUs than this machine.
    """

    address: str
    mixed_cpus: bool = False
    alone = False
    _hosts: Counter[str] = field(default_factory=Counter)  # units at a time, by name

    def start(self, work: Work[Unit, Result]) -> Workers[Unit, Result]:
        """Return workers that do this work, see `Site`.

        :raises NotInstalled: Dask is not installed.
        :raises VpsciError: no scheduler answers, or every worker refuses the job.
        """
        require("distributed")
        import cloudpickle

        files = {str(path.absolute()): (path.stat().st_mode & 0o777, path.read_bytes()) for path in work.reads()}
        order = Order(facts(mixed_cpus=self.mixed_cpus), cloudpickle.dumps(work.job), files, str(Path.cwd()))
        client = _connected(self.address)
        return ClusterWorkers(client, self.address, pickle.dumps(order), work.folder, work.whole_host, self._hosts)

    def hosts(self) -> str:
        """Return the names of the hosts at work and how many units each computes at a time."""
        names = [f"{name} ({units})" for name, units in sorted(self._hosts.items()) if units]
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        return f"on {', '.join(names[:_SHOWN])}{more}" if names else ""


def _connected(address: str) -> "Client":
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it reports is said here, in words
    given = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
    if "address" in given and not re.search(r":\d+/?$", address):
        raise InvalidInput(
            f"--cluster {address}: no such scheduler file, and no address with a port; expected tcp://host:8786"
        )
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Mismatched versions")  # asked for by name
            return Client(**given, timeout=_ANSWERS, set_as_default=False, name="vpsci", direct_to_workers=True)
    except (OSError, TimeoutError, ValueError) as error:
        raise VpsciError(
            f"--cluster {address}: no scheduler answers ({str(error) or type(error).__name__}); start one by `dask "
            "scheduler`, and give its address, such as tcp://host:8786, or its scheduler file"
        ) from None


@dataclass(eq=False)
class _Task(Generic[Unit]):
    """A submitted unit: its worker and future, once it has them, and how many workers died that had it."""

    unit: Unit
    worker: str = ""
    future: "Future | None" = None
    deaths: int = 0


@dataclass
class _Member:
    """A worker at work: name and address of its host, and how many units it computes at a time."""

    host: str
    ip: str
    slots: int


class ClusterWorkers(Generic[Unit, Result]):
    """Computes units on the workers of a cluster; one that joins later gets units, too.

    :param order: pickled `Order`.
    :param folder: into which the files of the units go.
    :param whole_host: one unit at a time on each host.
    :param hosts: units at a time by name of the host, kept up to date.
    :raises VpsciError: every worker refuses the job, or there is none for `PATIENCE`.
    """

    def __init__(
        self, client: "Client", address: str, order: bytes, folder: Path, whole_host: bool, hosts: Counter[str]
    ) -> None:
        self._client, self._address, self._order, self._folder = client, address, order, folder
        self._whole_host, self._hosts = whole_host, hosts
        self._name, self._numbers = f"vpsci-{uuid.uuid4().hex[:12]}", itertools.count()
        self._asked: dict[str, Future] = {}  # address -> what it answers
        self._members: dict[str, _Member] = {}
        self._left_out: dict[str, str] = {}
        self._queue: deque[_Task[Unit]] = deque()
        self._running: list[_Task[Unit]] = []  # in the order in which they were sent
        self._lost: list[str] = []
        self._deaths = 0
        self._finished: queue.Queue[tuple[_Task[Unit] | str, Any]] = queue.Queue(1)
        self._closed, self._looked, self._manned = False, 0.0, time.monotonic()
        try:
            while not self._members:
                self._step()
        except BaseException:
            self.close()
            raise

    @property
    def size(self) -> int:
        """Units that the workers compute at a time; units that are given up count, for nothing comes of them."""
        return sum(member.slots for member in self._members.values()) + len(self._lost)

    @property
    def spare(self) -> int:
        """Further units that are worth submitting: one waits behind each that is computed."""
        return sum(member.slots for member in self._members.values())

    def submit(self, unit: Unit) -> None:
        """Queue a unit for the cluster."""
        self._queue.append(_Task(unit))
        self._hand_out()

    def collect(self) -> list[tuple[Unit, Result]]:
        """Wait for a finished unit, write its files, and return it with its result; none where a worker has joined.

        :raises VpsciError: the scheduler or all workers are lost, or what remains killed `MOST_DEATHS` workers each.
        :raises Exception: what a unit raised.
        """
        size = self.size
        while self.size <= size:
            if not self._running and not self._queue and self._lost:
                raise VpsciError(
                    f"{'; '.join(self._lost)} (out of memory, a crash?); the rest is finished and kept: run the same "
                    "command again, perhaps on workers with more memory"
                )
            if found := self._step():
                return found
        return []

    def _step(self) -> list[tuple[Unit, Result]]:
        """Look for workers, hand out units, and wait a moment for a finished one."""
        if time.monotonic() - self._looked >= _LOOK:
            self._look()
            self._looked = time.monotonic()
        self._hand_out()
        try:
            task, answer = self._finished.get(timeout=_LOOK)
        except queue.Empty:
            return []
        if isinstance(task, str):
            self._admit(task, answer)
            return []
        if task not in self._running:  # its worker has gone since
            return []
        self._running.remove(task)
        if isinstance(answer, Exception):
            raise answer
        if isinstance(answer, bytes):
            result, files = pickle.loads(answer)
            if isinstance(result, Exception):
                raise result
            self._write(files)
            return [(task.unit, result)]
        if not answer:
            self._leave(task.worker)  # and ask it again
        self._deaths += bool(answer)
        self._again(task, f"its process {answer}" if answer else "")
        return []

    def _write(self, files: Iterable[tuple[str, bytes]]) -> None:
        for name, data in files:
            path = self._folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as part:
                part.write_bytes(data)

    def _look(self) -> None:
        """Ask for the cluster's workers: new ones are enlisted, units of those that have gone are done again.

        :raises VpsciError: the scheduler is lost, or there has been no worker for `PATIENCE`.
        """
        try:
            if self._client.status != "running":
                raise OSError(self._client.status)
            there = set(self._client.nthreads())
        except (OSError, TimeoutError) as error:
            raise VpsciError(
                f"--cluster {self._address}: the scheduler is lost ({str(error) or type(error).__name__}); what is "
                "finished is kept: start it again and run the same command, which goes on"
            ) from None
        for worker in [*self._members, *self._left_out, *self._asked]:
            if worker not in there:
                self._leave(worker)
        for worker in there - self._members.keys() - self._left_out.keys() - self._asked.keys():
            self._asked[worker] = self._sent(worker, worker, enlist, self._order)
        if self._members:
            self._manned = time.monotonic()
        elif there and there <= self._left_out.keys():
            raise VpsciError(f"--cluster {self._address}: every worker is left out: {self._reasons()}")
        elif time.monotonic() - self._manned > PATIENCE:
            raise VpsciError(f"--cluster {self._address}: no worker for {PATIENCE:g} s; start some by `dask worker`")

    def _reasons(self) -> str:
        return "; ".join(f"{worker}: {reason}" for worker, reason in self._left_out.items())

    def _admit(self, worker: str, answer: Any) -> None:
        """Take a worker's answer: it is at work, or left out."""
        if self._asked.pop(worker, None) is None:
            return
        host, ip, slots, reason = ("", "", 0, _in_words(answer)) if isinstance(answer, Exception) else answer
        if not reason and self._whole_host and any(member.ip == ip for member in self._members.values()):
            self._left_out[worker] = _HOST_TAKEN
        elif reason:
            self._left_out[worker] = f"{host}: {reason}" if host else reason
            self._say(f"worker {worker} is left out: {self._left_out[worker]}")
        else:
            self._members[worker] = member = _Member(host, ip, 1 if self._whole_host else slots)
            self._hosts[host] += member.slots

    def _leave(self, worker: str) -> None:
        """Forget a worker, and have its units done again."""
        self._left_out.pop(worker, None)
        self._asked.pop(worker, None)
        member = self._members.pop(worker, None)
        if member is None:
            return
        self._hosts.subtract({member.host: member.slots})
        self._left_out = {name: why for name, why in self._left_out.items() if why != _HOST_TAKEN}
        lost = [task for task in self._running if task.worker == worker]
        self._deaths += bool(lost)
        for task in lost:
            self._running.remove(task)
            assert task.future is not None
            task.future.cancel()
            self._again(task, f"worker {worker} on {member.host} was lost")

    def _again(self, task: _Task[Unit], death: str) -> None:
        """Queue a unit again, or give it up.

        :param death: how the worker died at it; empty: it did not.
        """
        task.deaths += bool(death)
        if task.deaths < MOST_DEATHS or 2 * task.deaths <= self._deaths:  # most workers died at others: not its fault
            self._queue.appendleft(task)
            return
        self._lost.append(f"{task.unit} killed {task.deaths} workers, the last time {death}")
        self._say(f"given up: {self._lost[-1]}")

    def _hand_out(self) -> None:
        """Send queued units to the workers with the least to do, at most two for each that it computes at a time.

        A unit that a worker died with gets a worker for itself.
        """
        load = Counter(task.worker for task in self._running)
        alone = {task.worker for task in self._running if task.deaths}
        while self._queue and (free := self._members.keys() - alone):
            worker = min(sorted(free), key=lambda name: load[name] / self._members[name].slots)
            most = 1 if self._queue[0].deaths or self._whole_host else 2 * self._members[worker].slots
            if load[worker] >= most:
                return
            task = self._queue.popleft()
            alone |= {worker} if task.deaths else set()
            task.worker, load[worker] = worker, load[worker] + 1
            self._running.append(task)
            task.future = self._sent(task, worker, compute, pickle.dumps(task.unit))

    def _sent(self, task: "_Task[Unit] | str", worker: str, function: Callable[..., Any], data: bytes) -> "Future":
        """Have a worker call a function; its answer comes through the queue, in which few fit."""
        from distributed import CancelledError

        def finished(future: "Future") -> None:
            try:
                answer: Any = future.result()
            except CancelledError:
                return
            except Exception as error:  # noqa: BLE001 - raised or said where it is taken
                answer = error
            while not self._closed:
                with contextlib.suppress(queue.Full):
                    self._finished.put((task, answer), timeout=_LOOK)
                    break
            future.release()

        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            key = f"{self._name}-{next(self._numbers)}"
            future = self._client.submit(
                function, self._name, data, key=key, workers=[worker], allow_other_workers=False, pure=False
            )
        future.add_done_callback(finished)
        return future

    def _say(self, text: str) -> None:
        print(f"  cluster: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Stop the units on the cluster, and leave it."""
        self._closed = True
        self._hosts.clear()
        with contextlib.suppress(Exception):  # it may be lost
            self._client.cancel([task.future for task in self._running] + list(self._asked.values()))
            asked = [*self._members, *self._left_out]  # one whose host another worker has waits there with a process
            self._client.run(dismiss, self._name, workers=asked, on_error="ignore")
        with contextlib.suppress(Exception):
            self._client.close(_LOOK)


def _in_words(error: Exception) -> str:
    """Return why a worker could not be asked."""
    return f"{type(error).__name__}: {error}"
