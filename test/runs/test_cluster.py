"""Faults of a real Dask cluster: a scheduler and workers, processes on the loopback or in network namespaces.

Jobs of these tests are functions of this file, which travels by value: it is installed nowhere.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from dask_cluster import LocalCluster, local_cluster, until

pytest.importorskip("distributed")
import cloudpickle

from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.runs import cluster
from vpsci_ros.runs.cluster import ClusterWorkers, DaskCluster
from vpsci_ros.runs.cluster_worker import compute
from vpsci_ros.runs.workers import Place, Work, Workers, computed

cloudpickle.register_pickle_by_value(sys.modules[__name__])
UNITS = 12


def squares(signs: Path, seconds: float, place: Place) -> Callable[[int], int]:
    """A job whose units sleep, write a file and return the square of their number.

    A file `signs`/KIND-NUMBER has the unit kill its process or the Dask worker.
    """

    def do(unit: int) -> int:
        (signs / f"begun-{unit}-{os.getpid()}").touch()
        for kind, process in (("kills_process", os.getpid()), ("kills_worker", os.getppid())):
            if (signs / f"{kind}-{unit}").exists():
                os.kill(process, signal.SIGKILL)
                time.sleep(60.0)
        time.sleep(seconds)
        (place.folder / "sub").mkdir(exist_ok=True)
        (place.folder / "sub" / f"{unit}.txt").write_text(f"{unit * unit}")
        return unit * unit

    return do


@pytest.fixture
def signs(tmp_path: Path) -> Path:
    (tmp_path / "signs").mkdir()
    return tmp_path / "signs"


@pytest.fixture
def two(tmp_path: Path) -> Iterator[LocalCluster]:
    with local_cluster(tmp_path / "cluster") as cluster:
        yield cluster


def started(cluster: LocalCluster, signs: Path, seconds: float = 0.0, **options: bool) -> "Workers[int, int]":
    work = Work(partial(squares, signs, seconds), signs.parent / "out", **options)
    return DaskCluster(str(cluster.file)).start(work)


def all_of(workers: "Workers[int, int]", units: int = UNITS) -> dict[int, int]:
    waiting = iter(range(units))
    return dict(computed(workers, lambda: next(waiting, None)))


def written(signs: Path) -> dict[int, int]:
    return {int(path.stem): int(path.read_text()) for path in (signs.parent / "out" / "sub").iterdir()}


def stepped(workers: Any, size: int) -> None:
    """Let the workers go on until so many are there."""
    until(lambda: workers._step() or workers.size == size)


def client(cluster: LocalCluster, signs: Path, seconds: float, options: str = "") -> str:
    """Return a program that starts workers of `squares`, as another process does."""
    return f"""
import sys
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parents[1])]}
from pathlib import Path
from types import SimpleNamespace
import test_cluster
cluster = SimpleNamespace(file=Path({str(cluster.file)!r}))
workers = test_cluster.started(cluster, Path({str(signs)!r}), {seconds}{options})
"""


@pytest.mark.parametrize("address", ["nothere.json", "tcp://10.0.0.1"])
def test_what_is_neither_a_file_nor_an_address_with_a_port_is_refused_in_words(tmp_path: Path, address: str) -> None:
    with pytest.raises(InvalidInput, match=f"--cluster {address}: no such scheduler file, and no address with a port"):
        DaskCluster(address).start(Work(partial(squares, tmp_path, 0.0), tmp_path))


class FakeFuture:
    """A unit at a worker; what is called when it is done, is called at once if its worker answers."""

    def __init__(self, answer: Any) -> None:
        self._answer = answer

    def add_done_callback(self, done: Callable[[Any], None]) -> None:
        if self._answer is not None:
            threading.Thread(target=done, args=(self,), daemon=True).start()

    def result(self) -> Any:
        return self._answer

    def cancel(self) -> None:
        self._answer = None

    release = cancel


class FakeClient:
    """A client of four workers: one that gets unit 5 dies, with all answers that it has not given yet.

    :ivar sent: worker -> the units that it has got.
    """

    status = "running"

    def __init__(self) -> None:
        self.sent: dict[str, list[int]] = {f"worker-{number}": [] for number in range(4)}

    def nthreads(self) -> dict[str, int]:
        return {name: 1 for name, units in self.sent.items() if 5 not in units}

    def submit(self, function: Callable[..., Any], _: str, data: bytes, *, workers: list[str], **__: Any) -> FakeFuture:
        if function is not compute:
            return FakeFuture((workers[0], workers[0], 1, ""))
        unit = pickle.loads(data)
        self.sent[workers[0]].append(unit)
        first_of_two = unit == 4 and len(self.sent[workers[0]]) == 1 and not any(5 in got for got in self.sent.values())
        answer = pickle.dumps((unit, []))
        return FakeFuture(None if unit == 5 or first_of_two else answer)

    def cancel(self, futures: list[FakeFuture]) -> None:
        del futures

    def run(self, *_: Any, **__: Any) -> None:
        return None

    def close(self, _: float) -> None:
        self.status = "closed"


def test_a_unit_whose_answer_was_lost_with_its_worker_is_not_blamed_for_what_the_next_unit_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unit 4 was done, and unit 5 kills the worker: both had it. Each is done again alone, and only 5 kills again."""
    monkeypatch.setattr(cluster, "PATIENCE", 30.0)
    client = FakeClient()
    client.sent = {"worker-0": []}
    workers: ClusterWorkers[int, int] = ClusterWorkers(client, "", b"", tmp_path, False, Counter())  # type: ignore[arg-type]
    workers.submit(4)
    workers.submit(5)
    assert client.sent == {"worker-0": [4, 5]}
    client.sent |= {f"worker-{number}": [] for number in (1, 2, 3)}
    waiting = iter(range(6, 9))
    with pytest.raises(VpsciError, match=r"^5 killed 3 workers") as error:
        while True:
            workers.collect()
            if (unit := next(waiting, None)) is not None:
                workers.submit(unit)
    assert "4 killed" not in str(error.value)
    assert sum(5 in units for units in client.sent.values()) == 3
    assert sum(4 in units for units in client.sent.values()) == 2
    workers.close()


def test_results_and_files_come_back_and_nothing_is_left_there(two: LocalCluster, signs: Path) -> None:
    workers = started(two, signs)
    assert all_of(workers) == {n: n * n for n in range(UNITS)} == written(signs)
    workers.close()
    until(lambda: not two.children())


@pytest.mark.parametrize("kind", ["kills_process", "kills_worker"])
def test_a_unit_that_kills_three_workers_is_named_and_the_rest_finishes(
    kind: str, two: LocalCluster, signs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (signs / f"{kind}-5").touch()
    for _ in range(2 if kind == "kills_worker" else 0):
        two.add_worker()
    workers = started(two, signs)
    with pytest.raises(VpsciError, match=r"^5 killed 3 workers, the last time .* the rest is finished"):
        all_of(workers)
    workers.close()
    assert 3 <= len(list(signs.glob("begun-5-*"))) <= 4  # one death may be counted for a unit just finished
    assert written(signs) == {n: n * n for n in range(UNITS) if n != 5}
    assert "given up: 5 killed 3 workers" in capfd.readouterr().err


def test_a_lost_scheduler_is_said_and_nothing_goes_on_running(two: LocalCluster, signs: Path) -> None:
    workers = started(two, signs, 1.0)
    threading.Timer(1.5, two.scheduler.signal, (signal.SIGKILL,)).start()
    with pytest.raises(VpsciError, match=r"the scheduler is lost .* run the same command, which goes on"):
        all_of(workers, 100)
    workers.close()
    until(lambda: not two.children())


def test_a_worker_that_joins_late_gets_work(tmp_path: Path, signs: Path) -> None:
    with local_cluster(tmp_path / "cluster", 1) as cluster:
        workers = started(cluster, signs, 0.3)
        cluster.add_worker()
        stepped(workers, 2)
        assert all_of(workers) == {n: n * n for n in range(UNITS)}
        workers.close()
        processes = {path.name.rpartition("-")[2] for path in signs.glob("begun-*")}
        assert len(processes) == 2


def test_nothing_goes_on_running_after_ctrl_c_or_a_kill(two: LocalCluster, signs: Path) -> None:
    """Each unit would take an hour."""
    code = client(two, signs, 3600.0) + "try:\n    test_cluster.all_of(workers)\nfinally:\n    workers.close()\n"
    for number, least in ((signal.SIGINT, 0), (signal.SIGKILL, 1)):
        for sign in signs.iterdir():
            sign.unlink()
        process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
        until(lambda: len(list(signs.glob("begun-*"))) >= 2)
        process.send_signal(number)
        said = process.communicate(timeout=60)[1]
        assert process.returncode != 0
        assert least or "KeyboardInterrupt" in said
        running = {path.name.rpartition("-")[2] for path in signs.glob("begun-*")}
        until(lambda pids=running: not pids & set(two.children()))


def test_a_worker_that_differs_is_left_out_and_named(
    two: LocalCluster, signs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The third worker has another numpy, as its metadata say; a fourth has another CPU for numba's kernels."""
    metadata = tmp_path / "other" / "numpy-0.1.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 0.1\n")
    two.add_worker(PYTHONPATH=str(metadata.parent))
    two.add_worker(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    workers = started(two, signs)
    seen = ""
    deadline = time.monotonic() + 120.0
    while seen.count("left out") < 2 and time.monotonic() < deadline:
        workers._step()
        seen += capfd.readouterr().err
    assert "computes with software.numpy = '0.1', and this one has" in seen
    assert "computes with kernels = " in seen
    assert workers.size == 2
    workers.close()
    mixed = DaskCluster(str(two.file), mixed_cpus=True).start(Work(partial(squares, signs, 0.0), tmp_path / "out"))
    stepped(mixed, 3)
    mixed.close()


def test_workers_killed_again_and_again_change_nothing(tmp_path: Path, signs: Path) -> None:
    """Each worker has Dask's nanny, which starts it again; one is killed whenever eight more units have begun."""
    with local_cluster(tmp_path / "cluster", 0) as cluster:
        for _ in range(2):
            cluster.add_worker("--nanny")
        workers = started(cluster, signs, 0.2)
        over = threading.Event()

        def kill() -> None:
            begun = 0
            while not over.wait(0.1):
                running = cluster.restarted()
                if running and len(list(signs.glob("begun-*"))) >= begun + 8:
                    begun += 8
                    os.kill(running[0], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        try:
            assert all_of(workers, 60) == {n: n * n for n in range(60)} == written(signs)
        finally:
            over.set()
            killer.join()
            workers.close()


@pytest.fixture
def hosts() -> Iterator[list[list[str]]]:
    """Two network namespaces joined by a cable, as two hosts: the words that run a command in each."""
    names = [f"vpsci-{os.getpid()}-{n}" for n in (1, 2)]
    for name in names:
        if subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False).returncode:
            pytest.skip("network namespaces need root")
    try:
        ends = [f"v{os.getpid()}n{n}" for n in (1, 2)]
        lines = [
            ["link", "add", ends[0], "netns", names[0], "type", "veth", "peer", "name", ends[1], "netns", names[1]]
        ]
        for n, (name, end) in enumerate(zip(names, ends, strict=True), 1):
            lines += [["-n", name, "addr", "add", f"10.77.0.{n}/24", "dev", end]]
            lines += [["-n", name, "link", "set", device, "up"] for device in (end, "lo")]
        for line in lines:
            subprocess.run(["ip", *line], check=True)
        yield [["ip", "netns", "exec", name] for name in names]
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "del", name], check=False)


@contextlib.contextmanager
def on_hosts(hosts: list[list[str]], folder: Path) -> Iterator[LocalCluster]:
    """Yield a cluster whose scheduler and two workers are on the first host, and one worker on the second."""
    folder.mkdir()
    with contextlib.closing(LocalCluster(folder, host="10.77.0.1", within=hosts[0])) as cluster:
        for host, ip in ((0, 1), (0, 1), (1, 2)):
            cluster.add_worker("--host", f"10.77.0.{ip}", within=hosts[host])
        yield cluster


def test_a_unit_that_needs_a_host_has_one_to_itself(hosts: list[list[str]], signs: Path, tmp_path: Path) -> None:
    with on_hosts(hosts, tmp_path / "cluster") as cluster:
        code = client(cluster, signs, 0.5, ", whole_host=True") + (
            "test_cluster.stepped(workers, 2)\n"
            "import time; end = time.monotonic() + 3\n"
            "while time.monotonic() < end: workers._step()\n"
            "assert workers.size == 2, workers.size\n"
            "assert test_cluster.all_of(workers) == {n: n * n for n in range(12)}\n"
            "workers.close()\n"
        )
        subprocess.run([*hosts[0], sys.executable, "-c", code], check=True, timeout=300)
    assert len({path.name.rpartition("-")[2] for path in signs.glob("begun-*")}) == 2


def test_each_graph_of_an_exam_runs_on_a_host_of_its_own(hosts: list[list[str]], tmp_path: Path) -> None:
    """The example drives: alone and with the walker, one episode each; the second host has no path to its files."""
    with on_hosts(hosts, tmp_path / "cluster") as cluster:
        words = ["--params", "ads_test", "--episodes", "1", "--set", "ads_test.pedestrians=[walker]", "-q"]
        words += ["--set", "world_simulator.scenarios=[104]", "--set", "ads_test.baseline=false"]
        command = [sys.executable, "-m", "vpsci_ros.cli", "ads-test", *words, "-o", str(tmp_path / "exam")]
        command += ["--cluster", str(cluster.file), "--allow-standing"]
        found = subprocess.run([*hosts[0], *command], capture_output=True, text=True, timeout=900, check=False)
        assert found.returncode == 0, found.stdout + found.stderr
        until(lambda: not cluster.children())
    runs = sorted(path.name for path in (tmp_path / "exam" / "runs").iterdir())
    assert runs == ["alone", "walker"]
    assert all((tmp_path / "exam" / "runs" / run / "1" / "frames.parquet").is_file() for run in runs)
