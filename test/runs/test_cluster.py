"""Faults of a real Dask cluster: a scheduler and workers, processes on the loopback or in network namespaces.

Jobs of these tests are functions of this file, which travels by value: it is installed nowhere.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from dask_cluster import LocalCluster, local_cluster

pytest.importorskip("distributed")
import cloudpickle

from vpsci_ros.errors import VpsciError
from vpsci_ros.runs.cluster import DaskCluster
from vpsci_ros.runs.workers import Place, Workers, computed

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
    return DaskCluster(str(cluster.file)).start(partial(squares, signs, seconds), signs.parent / "out", **options)


def all_of(workers: "Workers[int, int]", units: int = UNITS) -> dict[int, int]:
    waiting = iter(range(units))
    return dict(computed(workers, lambda: next(waiting, None)))


def written(signs: Path) -> dict[int, int]:
    return {int(path.stem): int(path.read_text()) for path in (signs.parent / "out" / "sub").iterdir()}


def until(condition: Callable[[], object], seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come to pass"
        time.sleep(0.05)


def stepped(workers: Any, size: int) -> None:
    """Let the workers go on until so many are there."""
    until(lambda: workers._step() or workers.size == size)


def test_results_and_files_come_back_and_nothing_is_left_there(two: LocalCluster, signs: Path) -> None:
    workers = started(two, signs)
    assert all_of(workers) == {n: n * n for n in range(UNITS)} == written(signs)
    workers.close()
    until(lambda: not two.children())


def test_the_units_of_a_killed_worker_are_done_elsewhere(two: LocalCluster, signs: Path) -> None:
    workers = started(two, signs, 0.3)
    stepped(workers, 2)
    threading.Timer(1.0, two.kill, (0,)).start()
    assert all_of(workers) == {n: n * n for n in range(UNITS)}
    workers.close()


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
    assert len(list(signs.glob("begun-5-*"))) == 3
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
    code = f"""
import sys
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parents[1])]}
from pathlib import Path
import test_cluster
from dask_cluster import LocalCluster
cluster = LocalCluster.__new__(LocalCluster)
cluster.file = Path({str(two.file)!r})
workers = test_cluster.started(cluster, Path({str(signs)!r}), 3600.0)
try:
    test_cluster.all_of(workers)
finally:
    workers.close()
"""
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
    mixed = DaskCluster(str(two.file), mixed_cpus=True).start(partial(squares, signs, 0.0), tmp_path / "out")
    stepped(mixed, 3)
    mixed.close()
