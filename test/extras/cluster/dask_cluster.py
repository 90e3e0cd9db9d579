"""A Dask cluster of processes on this machine's loopback, or in network namespaces, that ends with the test."""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from vpsci_ros.runs.processes import ChildProcess, stop

WORKER = ("--nthreads", "1", "--no-dashboard", "--death-timeout", "60")
COMPUTES = "vpsci_ros.extras.cluster.cluster_worker"  # the module that such a process runs
PATIENCE = 60.0  # [s]


def until(condition: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come to pass"
        time.sleep(0.05)


class LocalCluster:
    """A scheduler and its workers, each a process as `dask scheduler` and `dask worker` start it.

    :ivar file: the scheduler file.
    """

    def __init__(self, folder: Path, *, port: int = 0, host: str = "127.0.0.1", within: Sequence[str] = ()) -> None:
        self._folder, self.file = folder, folder / "scheduler.json"
        self.workers: list[ChildProcess] = []
        self._host = host
        self.start_scheduler(port, within)

    def start_scheduler(self, port: int = 0, within: Sequence[str] = ()) -> None:
        """Start the scheduler, and wait until it has written its file."""
        self.file.unlink(missing_ok=True)
        words = ["--host", self._host, "--port", str(port), "--no-dashboard", "--no-show", "--idle-timeout", "600"]
        self.scheduler = self._process("scheduler", [*words, "--scheduler-file", str(self.file)], within)
        deadline = time.monotonic() + PATIENCE
        while not self.file.exists():
            assert time.monotonic() < deadline, self.scheduler.log.read_text()
            assert not self.scheduler.end, self.scheduler.log.read_text()
            time.sleep(0.05)

    def add_worker(self, *words: str, cwd: Path | None = None, within: Sequence[str] = (), **environment: str) -> None:
        """Start a worker of one thread; without `--nanny` nothing restarts it."""
        given = () if "--nanny" in words else ("--no-nanny",)
        words = ("--scheduler-file", str(self.file), "--local-directory", str(self._folder), *given, *words)
        self.workers.append(self._process("worker", [*WORKER, *words], within, cwd, environment))

    def _process(
        self, name: str, words: Sequence[str], within: Sequence[str], cwd: Path | None = None, environment=None
    ) -> ChildProcess:
        log = self._folder / f"{name}-{len(self.workers)}.log"
        enter = [] if cwd is None else ["env", "-C", str(cwd)]
        command = [*within, *enter, sys.executable, "-m", f"distributed.cli.dask_{name}", *words]
        return ChildProcess(command, log, {**os.environ, **(environment or {})})

    def kill(self, number: int) -> None:
        """Kill a worker as a crash does."""
        self.workers[number].signal(signal.SIGKILL)

    def restarted(self) -> list[int]:
        """Return the processes that nannies have started and would start again."""
        nannies = {worker.pid for worker in self.workers}
        found = []
        for path in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                words = path.read_text().rpartition(")")[2].split()
                command = path.with_name("cmdline").read_bytes()
                if int(words[1]) in nannies and b"spawn_main" in command:
                    found.append(int(path.parent.name))
        return found

    def children(self) -> list[str]:
        """Return the processes that compute units of this cluster's workers."""
        found = []
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                words = path.read_bytes().decode(errors="replace").split("\0")
                if COMPUTES in words and any(str(self._folder) in word for word in words):
                    found.append(path.parent.name)
        return found

    def close(self) -> None:
        """Stop all processes."""
        stop([*self.workers, self.scheduler], ((signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0)))


@contextlib.contextmanager
def local_cluster(folder: Path, workers: int = 2) -> Iterator[LocalCluster]:
    """Yield a cluster with workers of one thread on the loopback."""
    folder.mkdir(exist_ok=True)
    with contextlib.closing(LocalCluster(folder)) as cluster:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
