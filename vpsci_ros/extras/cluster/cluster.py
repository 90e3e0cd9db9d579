"""Work on a Dask cluster: units go to the cluster's workers, and their results and files come back to this process.

Each worker is first asked for what results depend on (`cluster_worker.facts`) and makes the job; one that differs or
refuses is left out and named. A worker that takes part offers Dask a resource of this command's name. Dask's scheduler
gives units to workers that offer it, and gives a unit to another worker when its worker retires or dies. This process
alone writes: at most two results and the units in flight are in its memory.
"""

import asyncio
import contextlib
import itertools
import json
import logging
import pickle
import queue
import re
import sys
import time
import uuid
import warnings
from collections import Counter, deque
from collections.abc import Iterable
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic

from vpsci_ros.errors import InvalidInput, VpsciError, require
from vpsci_ros.extras.cluster.cluster_worker import Order, UnitDied, compute, enlist, facts
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.workers import Result, Unit, Work, Workers

if TYPE_CHECKING:
    from distributed import Client, Future

MOST_DEATHS = 3  # of processes at one unit, which is given up then
PATIENCE = 300.0  # [s] without any worker, or without an answer of the scheduler
_ANSWERS = 10.0  # [s] that a scheduler or a worker has to answer before something is said
_CONNECTS = 5.0  # [s] that a scheduler has to answer at first
_LOOK = 1.0  # [s] between looks for workers that came or went
_SHOWN = 4  # hosts in the progress


@dataclass
class DaskCluster:
    """Work on a Dask cluster.

    :ivar address: of its scheduler, or a scheduler file.
    :ivar mixed_cpus: workers may have other CPUs than this machine.
    :raises NotInstalled: Dask is not installed.
    :raises VpsciError: no scheduler answers.
    """

    address: str
    mixed_cpus: bool = False
    alone = False
    _hosts: Counter[str] = field(default_factory=Counter)  # units at a time, by name

    def __post_init__(self) -> None:
        require("distributed")
        _scheduler_at(self.address)  # said now, not after what a command prepares

    def start(self, work: Work[Unit, Result]) -> Workers[Unit, Result]:
        """Return workers that do this work, see `Site`.

        :raises VpsciError: no scheduler answers, or every worker refuses the job.
        """
        import cloudpickle
        from distributed import Client

        files = {str(path.absolute()): (path.stat().st_mode & 0o777, path.read_bytes()) for path in work.reads()}
        order = Order(facts(mixed_cpus=self.mixed_cpus), cloudpickle.dumps(work.job), files, str(Path.cwd()))
        where = _scheduler_at(self.address)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Mismatched versions")  # asked for by name
            client = Client(**where, timeout=_ANSWERS, set_as_default=False, name="vpsci", direct_to_workers=True)
        return ClusterWorkers(client, self.address, pickle.dumps(order), work.folder, work.whole_host, self._hosts)

    def hosts(self) -> str:
        """Return the names of the hosts at work and how many units each computes at a time."""
        names = [f"{name} ({units})" for name, units in sorted(self._hosts.items()) if units]
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        return f"on {', '.join(names[:_SHOWN])}{more}" if names else ""


def _scheduler_at(address: str) -> dict[str, Any]:
    """Return how Dask names the scheduler at an address, given as such or by a scheduler file.

    :raises InvalidInput: it is neither.
    :raises VpsciError: no scheduler answers, whatever else does.
    """
    from distributed import Security, rpc

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it reports is said here, in words
    if not (is_file := Path(address).is_file()) and not re.search(r":\d+/?$", address):
        raise InvalidInput(
            f"--cluster {address}: no such scheduler file, and no address with a port; expected tcp://host:8786"
        )

    async def kind() -> str:
        where = json.loads(Path(address).read_text(encoding="utf-8"))["address"] if is_file else address
        async with rpc(where, connection_args=Security().get_connection_args("client")) as there:
            return str((await there.identity())["type"])

    try:  # by a deadline of ours: a client of Dask waits for ever for a server that does not speak
        found = asyncio.run(asyncio.wait_for(kind(), _CONNECTS))
    except Exception as error:  # noqa: BLE001 - what is no scheduler may answer anything
        found = f"{type(error).__name__}: {error}" if str(error) else f"nothing within {_CONNECTS:g} s"
    if found != "Scheduler":
        raise VpsciError(
            f"--cluster {address}: no scheduler answers (found {found}); start one by `dask scheduler`, and give its "
            "address, such as tcp://host:8786, or its scheduler file"
        )
    return {"scheduler_file": address} if is_file else {"address": address}


@dataclass
class _Member:
    """A worker: its processes, while Dask keeps this future; since when; its host, and units at a time: 0 at first."""

    processes: "Future"
    since: float
    host: str = ""
    slots: int = 0


class ClusterWorkers(Generic[Unit, Result]):
    """Computes units on the workers of a cluster; one that joins later gets units, too.

    Dask gives a unit up (`KilledWorker`) after the deaths of more workers than its `allowed-failures`; it counts them
    for all units that a worker has, and cannot say which one killed. So that no innocent unit is blamed, such a unit
    waits until nothing else is done, and is done once more, alone.

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
        self._members: dict[str, _Member] = {}  # by address
        self._left_out: dict[str, str] = {}
        self._running: dict[str, tuple[Future, Unit]] = {}
        self._queue, self._suspects, self._trial = deque[Unit](), deque[Unit](), ""  # the key of a unit that is alone
        self._lost: list[str] = []
        self._answers: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
        self._room = asyncio.Semaphore(2)  # of results that have come and are not taken
        self._said: set[str] = set()
        self._looked, self._manned = 0.0, time.monotonic()
        self._answered = self._manned
        try:
            while not self.spare:
                self._step()
        except BaseException:
            self.close()
            raise

    @property
    def size(self) -> int:
        """Units that the workers compute at a time; units that wait for a trial or are given up count, too."""
        return max(1, self.spare) + len(self._suspects) + len(self._lost)

    @property
    def spare(self) -> int:
        """Further units that are worth submitting: one waits behind each that is computed."""
        return sum(member.slots for member in self._members.values())

    def submit(self, unit: Unit) -> None:
        """Queue a unit for the cluster."""
        self._queue.append(unit)
        self._hand_out()

    def collect(self) -> list[tuple[Unit, Result]]:
        """Wait for a finished unit, write its files, and return it with its result; none where a worker has joined.

        :raises VpsciError: the scheduler or all workers are lost, or only units remain that kill workers.
        :raises Exception: what a unit raised.
        """
        size = self.size
        while self.size <= size:
            if not self._running and not self._queue and not self._suspects and self._lost:
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
            key, answer = self._answers.get(timeout=_LOOK)
        except queue.Empty:
            return []
        self._client.loop.add_callback(self._room.release)
        if key in self._running:
            return self._take(key, answer)
        for worker in [name for name, member in self._members.items() if member.processes.key == key]:
            self._admit(worker, answer)
        return []

    def _take(self, key: str, answer: Any) -> list[tuple[Unit, Result]]:
        """Take what came of a unit."""
        from distributed import KilledWorker

        (_, unit), on_trial = self._running.pop(key), key == self._trial
        self._trial = "" if on_trial else self._trial
        if isinstance(answer, bytes):
            result, files = pickle.loads(answer)
            if isinstance(result, Exception):
                raise result
            self._write(files)
            return [(unit, result)]
        if isinstance(answer, tuple):  # its worker cannot go on
            self._queue.appendleft(unit)
            self._leave_out(*answer)
        elif isinstance(answer, KilledWorker) and not on_trial:
            self._suspects.append(unit)
        elif isinstance(answer, KilledWorker | UnitDied):
            deaths = answer.allowed_failures + 1 if isinstance(answer, KilledWorker) else MOST_DEATHS
            last = answer.last_worker.address if isinstance(answer, KilledWorker) else answer
            self._lost.append(f"{unit} killed {deaths} workers, the last time {last}")
            self._say(f"given up: {self._lost[-1]}")
        elif isinstance(answer, CancelledError):
            raise self._lost_scheduler(answer)
        else:
            raise answer
        return []

    def _write(self, files: Iterable[tuple[str, bytes]]) -> None:
        for name, data in files:
            path = self._folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path) as part:
                part.write_bytes(data)

    def _look(self) -> None:
        """Ask for the cluster's workers: new ones are enlisted, those that have gone are forgotten.

        :raises VpsciError: the scheduler is lost, or there has been no worker for `PATIENCE`.
        """
        from distributed.comm import get_address_host

        now, client = time.monotonic(), self._client
        try:
            if client.status != "running":
                raise OSError(client.status)
            there = set(client.sync(client.scheduler.ncores, callback_timeout=_ANSWERS))
        except TimeoutError as error:
            if time.monotonic() - self._answered > PATIENCE:
                raise self._lost_scheduler(error) from None
            self._say("the scheduler does not answer; waiting")
            return
        except OSError as error:
            raise self._lost_scheduler(error) from None
        self._answered = now
        for worker in (self._members.keys() | self._left_out.keys()) - there:
            self._forget(worker)
            self._left_out.pop(worker, None)
        for worker in sorted(there - self._members.keys() - self._left_out.keys()):
            if not self._whole_host or get_address_host(worker) not in map(get_address_host, self._members):
                processes = self._sent(enlist, self._order, int(self._whole_host), workers=[worker], priority=9)
                self._members[worker] = _Member(processes, now)
        if self._members:
            self._manned = now
        elif there:
            reasons = "; ".join(f"worker {worker}: {reason}" for worker, reason in self._left_out.items())
            raise VpsciError(f"--cluster {self._address}: every worker is left out: {reasons}")
        elif now - self._manned > PATIENCE:
            raise VpsciError(f"--cluster {self._address}: no worker for {PATIENCE:g} s; start some by `dask worker`")
        for worker, member in self._members.items():
            if not member.slots and now - member.since > _ANSWERS:
                self._say(f"worker {worker} has not begun yet: it starts, is busy with other work, or hangs; waiting")

    def _lost_scheduler(self, error: BaseException) -> VpsciError:
        why = "its connection broke" if isinstance(error, CancelledError) else str(error) or type(error).__name__
        return VpsciError(
            f"--cluster {self._address}: the scheduler is lost ({why}); what is finished is kept: start it again and "
            "run the same command, which goes on"
        )

    def _admit(self, worker: str, answer: Any) -> None:
        """Take a worker's answer: it is at work, or left out.

        :raises VpsciError: the scheduler is lost.
        """
        if isinstance(answer, CancelledError):
            raise self._lost_scheduler(answer)
        host, slots, reason = ("", 0, f"{type(answer).__name__}: {answer}") if isinstance(answer, Exception) else answer
        if reason:
            self._leave_out(worker, f"{host}: {reason}" if host else reason)
            return
        member = self._members[worker]
        member.host, member.slots = host, slots
        self._hosts[host] += slots

    def _leave_out(self, worker: str, reason: str) -> None:
        if self._forget(worker):
            self._left_out[worker] = reason
            self._say(f"worker {worker} is left out: {reason}")

    def _forget(self, worker: str) -> bool:
        """Release a worker's processes, which end then; return whether it was there."""
        if member := self._members.pop(worker, None):
            member.processes.release()
            self._hosts.subtract({member.host: member.slots})
        return member is not None

    def _hand_out(self) -> None:
        """Give Dask the queued units; a suspect when there is nothing else to do."""
        while self._queue and not self._trial:
            self._send(self._queue.popleft())
        if self._suspects and not self._running:
            self._trial = self._send(self._suspects.popleft())

    def _send(self, unit: Unit) -> str:
        """Give Dask a unit; return its key. What a unit raises is an answer: `retries` are for a process that dies."""
        future = self._sent(compute, pickle.dumps(unit), resources={self._name: 1}, retries=MOST_DEATHS - 1)
        self._running[future.key] = future, unit
        return str(future.key)

    def _sent(self, *call: Any, **options: Any) -> "Future":
        """Have a worker call a function with this command's name and arguments; its answer comes to `_answers`."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            key = f"{self._name}-{next(self._numbers)}"
            future = self._client.submit(call[0], self._name, *call[1:], key=key, pure=False, **options)
        future.add_done_callback(lambda done: self._client.loop.add_callback(self._fetch, done))
        return future

    async def _fetch(self, future: "Future") -> None:
        await self._room.acquire()
        try:
            answer = await future
        except Exception as error:  # noqa: BLE001 - raised or said where it is taken
            answer = error
        self._answers.put((future.key, answer))

    def _say(self, text: str) -> None:
        """Say something, once."""
        if text not in self._said:
            self._said.add(text)
            print(f"  cluster: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Stop the units on the cluster, and leave it."""
        self._hosts.clear()
        with contextlib.suppress(Exception):  # it may be lost, or hang
            self._client.close(_CONNECTS)  # which Dask's scheduler takes as no more wanting anything, now or later
