"""Faults of a real Dask cluster: a scheduler and workers, processes on the loopback or in network namespaces.

Jobs of these tests are functions of this file, which travels by value: it is installed nowhere.
"""

import asyncio
import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from extras.cluster.dask_cluster import LocalCluster, local_cluster, until

pytest.importorskip("distributed")
import cloudpickle
from distributed import Client, KilledWorker

from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.extras.cluster import cluster
from vpsci_ros.extras.cluster.cluster import ClusterWorkers, DaskCluster
from vpsci_ros.extras.cluster.cluster_worker import compute
from vpsci_ros.runs.workers import Place, Work, Workers, computed

cloudpickle.register_pickle_by_value(sys.modules[__name__])
UNITS = 12


def squares(signs: Path, seconds: float, place: Place) -> Callable[[int], int]:
    """A job whose units sleep, write a file and return the square of their number.

    A file `signs`/KIND-NUMBER has the unit kill its process or the Dask worker; one named "waits" has all units wait
    until it is gone, and one named "large" has them write a file of 1 MB.
    """

    def do(unit: int) -> int:
        (signs / f"begun-{unit}-{os.getpid()}").touch()
        for kind, process in (("kills_process", os.getpid()), ("kills_worker", os.getppid())):
            if (signs / f"{kind}-{unit}").exists():
                os.kill(process, signal.SIGKILL)
                time.sleep(60.0)
        while (signs / "waits").exists():
            time.sleep(0.05)
        time.sleep(seconds)
        if (signs / "large").exists():
            (place.folder / "large").write_bytes(bytes(1_000_000))
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


def other_client(cluster: LocalCluster) -> Client:
    return Client(scheduler_file=str(cluster.file), set_as_default=False)


def stepped(workers: Any, size: int) -> None:
    """Let the workers go on until so many are there."""
    until(lambda: workers._step() or workers.size == size)


def client(cluster: LocalCluster, signs: Path, seconds: float, options: str = "") -> str:
    """Return a program that starts workers of `squares`, as another process does."""
    return f"""
import sys
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parents[2])]}
from pathlib import Path
from types import SimpleNamespace
import test_cluster
cluster = SimpleNamespace(file=Path({str(cluster.file)!r}))
workers = test_cluster.started(cluster, Path({str(signs)!r}), {seconds}{options})
"""


@pytest.mark.parametrize("address", ["nothere.json", "tcp://10.0.0.1"])
def test_what_is_neither_a_file_nor_an_address_with_a_port_is_refused_in_words(address: str) -> None:
    with pytest.raises(InvalidInput, match=f"--cluster {address}: no such scheduler file, and no address with a port"):
        DaskCluster(address)


@pytest.mark.parametrize("answers", ["nobody", "a silent server", "an HTTP server", "a worker"])
def test_an_address_where_something_else_than_a_scheduler_answers_is_refused_in_words(
    answers: str, tmp_path: Path
) -> None:
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        if answers == "nobody":
            server.close()
        elif answers == "an HTTP server":
            http = stack.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler))
            threading.Thread(target=http.serve_forever, daemon=True).start()
            stack.callback(http.shutdown)
            address = f"tcp://127.0.0.1:{http.server_port}"
        elif answers == "a worker":
            cluster = stack.enter_context(local_cluster(tmp_path / "cluster", 1))
            client = stack.enter_context(other_client(cluster))
            client.wait_for_workers(1)
            (address,) = client.nthreads()
        with pytest.raises(VpsciError, match=f"--cluster {address}: no scheduler answers .found .*; start one by"):
            DaskCluster(address)


class FakeLoop:
    """A loop of asyncio in a thread."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()

    def add_callback(self, call: Callable[..., Any], *arguments: Any) -> None:
        async def run() -> None:
            if asyncio.iscoroutine(result := call(*arguments)):
                await result

        asyncio.run_coroutine_threadsafe(run(), self._loop)


class FakeFuture:
    """A task that has ended."""

    def __init__(self, key: str, answer: Any) -> None:
        self.key, self._answer = key, answer

    def add_done_callback(self, done: Callable[[Any], None]) -> None:
        done(self)

    def __await__(self) -> Iterator[Any]:
        yield from asyncio.sleep(0).__await__()
        if isinstance(self._answer, Exception):
            raise self._answer
        return self._answer

    def release(self) -> None:
        pass


class FakeClient:
    """A client of one worker: units 4 and 5 are given up at first, as unit 5 kills workers, and unit 5 again.

    :ivar sent: each unit with the number of units that were on the cluster when it came.
    """

    status = "running"

    def __init__(self) -> None:
        self.loop, self.scheduler = FakeLoop(), SimpleNamespace(ncores=lambda: {"tcp://10.0.0.1:1": 1})
        self.sent: list[tuple[int, int]] = []
        self.workers: Any = None

    def sync(self, call: Callable[[], Any], **_: Any) -> Any:
        return call()

    def submit(self, function: Callable[..., Any], _: str, data: bytes, *__: Any, key: str, **___: Any) -> FakeFuture:
        if function is not compute:
            return FakeFuture(key, ("host", 2, ""))
        unit = pickle.loads(data)
        again = unit in [sent for sent, _ in self.sent]
        self.sent.append((unit, len(self.workers._running)))
        killed = KilledWorker(key, SimpleNamespace(address="tcp://10.0.0.1:1"), 3)
        return FakeFuture(key, killed if unit == 5 or (unit == 4 and not again) else pickle.dumps((unit, [])))

    def close(self, _: float) -> None:
        self.status = "closed"


def test_a_unit_that_dask_gives_up_is_blamed_only_for_what_dies_while_it_is_alone(tmp_path: Path) -> None:
    client = FakeClient()
    client.workers = workers = ClusterWorkers(client, "", b"", tmp_path, False, Counter())  # type: ignore[arg-type]
    waiting, done = iter(range(8)), []
    with pytest.raises(VpsciError, match=r"^5 killed 4 workers, the last time tcp://10.0.0.1:1 "):
        for unit, _ in computed(workers, lambda: next(waiting, None)):
            done.append(unit)
    assert sorted(done) == [0, 1, 2, 3, 4, 6, 7]
    assert [number for unit, number in client.sent if unit in (4, 5)][2:] == [0, 0]
    assert [unit for unit, _ in client.sent][-2:] == [4, 5]
    workers.close()


@pytest.mark.parametrize(("kind", "deaths"), [("kills_process", 3), ("kills_worker", 4)])
def test_a_unit_that_kills_workers_is_named_and_the_rest_finishes(
    kind: str, deaths: int, signs: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A unit that kills Dask's workers does so twice beside others, and twice alone."""
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "1")
    (signs / f"{kind}-5").touch()
    with local_cluster(signs.parent / "cluster", 5 if kind == "kills_worker" else 2) as cluster:
        workers = started(cluster, signs)
        with pytest.raises(VpsciError, match=r"^5 killed \d workers, the last time .* the rest is finished"):
            all_of(workers)
        workers.close()
    assert len(list(signs.glob("begun-5-*"))) == deaths
    assert written(signs) == {n: n * n for n in range(UNITS) if n != 5}
    assert "given up: 5 killed" in capfd.readouterr().err


def test_a_unit_whose_only_worker_died_is_done_by_the_next_worker(tmp_path: Path, signs: Path) -> None:
    (signs / "waits").touch()
    with local_cluster(tmp_path / "cluster", 1) as cluster:
        workers = started(cluster, signs)
        workers.submit(3)
        until(lambda: list(signs.glob("begun-*")))
        cluster.kill(0)
        until(lambda: workers._step() or not workers.spare)
        (signs / "waits").unlink()
        cluster.add_worker()
        until(lambda: workers._step() or workers.spare)
        assert workers.collect() == [(3, 9)]
        workers.close()


def test_workers_that_retire_one_after_another_while_they_compute_a_unit_are_no_deaths(
    signs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (signs / "waits").touch()
    with local_cluster(signs.parent / "cluster", 4) as cluster:
        workers = started(cluster, signs)
        stepped(workers, 4)
        workers.submit(3)
        with other_client(cluster) as client:
            for retired in range(3):
                until(lambda begun=retired: len(list(signs.glob("begun-*"))) > begun and workers._step() == [])
                client.retire_workers([name for name, keys in client.processing().items() if keys])
        (signs / "waits").unlink()
        assert workers.collect() == [(3, 9)]
        workers.close()
    assert capfd.readouterr().err == ""


def test_a_worker_whose_disk_is_full_is_left_out_and_named_and_its_units_go_elsewhere(
    tmp_path: Path, signs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (signs / "large").touch()
    limited = ["bash", "-c", 'ulimit -f 500; exec "$@"', "limited"]
    with local_cluster(tmp_path / "cluster", 1) as cluster:
        cluster.add_worker(within=limited)
        workers = started(cluster, signs)
        stepped(workers, 2)
        assert all_of(workers) == {n: n * n for n in range(UNITS)} == written(signs)
        assert workers.size == 1
        workers.close()
    said = capfd.readouterr().err
    assert "is left out: " in said
    assert "File too large; allow larger files (ulimit -f)" in said
    with local_cluster(tmp_path / "all", 0) as cluster:
        cluster.add_worker(within=limited)
        with pytest.raises(VpsciError, match=r"every worker is left out: worker tcp://.*File too large"):
            all_of(started(cluster, signs))


def test_a_busy_worker_is_waited_for_and_said(
    tmp_path: Path, signs: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_ANSWERS", 1.0)
    busy, said = signs / "busy", ""
    busy.touch()

    def wait() -> None:
        while busy.exists():
            time.sleep(0.05)

    with (
        local_cluster(tmp_path / "cluster", 1) as local,
        other_client(local) as other,
    ):
        task = other.submit(wait)
        until(lambda: any(other.processing().values()))
        found: list[dict[int, int]] = []
        thread = threading.Thread(target=lambda: found.append(all_of(started(local, signs))))
        thread.start()
        while "has not begun yet: it starts, is busy with other work" not in said:
            said += capfd.readouterr().err
            assert thread.is_alive()
        busy.unlink()
        task.result()
        thread.join()
    assert found == [{n: n * n for n in range(UNITS)}]


def test_two_commands_at_once_share_the_workers(two: LocalCluster, signs: Path) -> None:
    first, second = started(two, signs, 0.1), started(two, signs, 0.1)
    found: list[dict[int, int]] = []
    thread = threading.Thread(target=lambda: found.append(all_of(first)))
    thread.start()
    found.append(all_of(second))
    thread.join()
    assert found == [{n: n * n for n in range(UNITS)}] * 2
    first.close()
    second.close()


def test_a_lost_scheduler_is_said_and_nothing_goes_on_running(two: LocalCluster, signs: Path) -> None:
    workers = started(two, signs, 1.0)
    threading.Timer(1.5, two.scheduler.signal, (signal.SIGKILL,)).start()
    with pytest.raises(VpsciError, match=r"the scheduler is lost .* run the same command, which goes on"):
        all_of(workers, 100)
    workers.close()
    until(lambda: not two.children())
    two.scheduler.wait(60.0)
    two.start_scheduler()
    two.add_worker()
    again = started(two, signs)
    assert all_of(again) == {n: n * n for n in range(UNITS)}, "the scheduler is back"
    again.close()


def test_one_signal_ends_a_command_whose_scheduler_or_worker_hangs(two: LocalCluster, signs: Path) -> None:
    """Each unit would take an hour."""
    code = client(two, signs, 3600.0) + "try:\n    test_cluster.all_of(workers)\nfinally:\n    workers.close()\n"
    for hanging in (two.scheduler, two.workers[0]):
        for sign in signs.iterdir():
            sign.unlink()
        process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
        until(lambda: len(list(signs.glob("begun-*"))) >= 2)
        hanging.signal(signal.SIGSTOP)
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.communicate(timeout=120)[1]
        hanging.signal(signal.SIGCONT)
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
        until(lambda: not list(two.file.parent.rglob("vpsci-*")))


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
