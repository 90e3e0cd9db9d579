"""Work on a Dask cluster against `--workers 2`, on this machine's loopback: time, CPU, bytes, and what a unit costs.

    python benchmarks/cluster.py [--episodes 20000] [--repeats 3] [--exam 64]

Starts a scheduler and two workers of one thread, and alternates both ways. Wall times of a busy machine are no measure:
take the medians' ratio, and the CPU seconds of all processes. Every dataset is compared with the first one, by hashes.
"""

import argparse
import hashlib
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

from vpsci_ros.extras.cluster.cluster import DaskCluster
from vpsci_ros.runs.processes import ChildProcess, stop
from vpsci_ros.runs.workers import Place, Work, computed

TICKS = os.sysconf("SC_CLK_TCK")
VPSCI = [sys.executable, "-m", "vpsci_ros.cli"]
DRIVER = "vpsci_ros.nodes.example_driver:ExampleDriver"


@contextmanager
def dask(folder: Path, workers: int = 2) -> Iterator[tuple[Path, list[int]]]:
    """Yield the scheduler file and the processes of a cluster."""
    file = folder / "scheduler.json"
    common = ["--no-dashboard", "--scheduler-file", str(file)]
    words = [["scheduler", "--host", "127.0.0.1", "--port", "0", *common]]
    own = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
    words += [["worker", *common, *own, "--death-timeout", "60"]] * workers
    processes = []
    for number, each in enumerate(words):
        command = [sys.executable, "-m", f"distributed.cli.dask_{each[0]}", *each[1:]]
        processes.append(ChildProcess(command, folder / f"log-{number}", os.environ))
        while not file.exists():
            time.sleep(0.1)
    try:
        yield file, [process.pid for process in processes]
    finally:
        stop(processes)


def cpu_of(processes: list[int]) -> float:
    """Return the CPU seconds of these processes and of all their children that have ended."""
    spent = 0
    for process in processes:
        spent += sum(map(int, Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:15]))
    return spent / TICKS + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of a dataset's files."""
    files = [path for path in sorted(folder.iterdir()) if path.name != "generation.json"]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files if path.is_file()}


def alternate(words: list[str], file: Path, processes: list[int], folder: Path, repeats: int) -> list[Path]:
    """Run a command on two processes and on the cluster in turn; print the ratios; return the output folders."""
    wall: dict[str, list[float]] = {"--workers": [], "--cluster": []}
    cpu: dict[str, list[float]] = {"--workers": [], "--cluster": []}
    outputs = []
    for repeat in range(repeats):
        for option, value in (("--workers", "2"), ("--cluster", str(file))):
            outputs.append(folder / f"{words[0]}-{repeat}{option}")
            begun, spent = time.monotonic(), cpu_of(processes)
            command = [*VPSCI, *words, "-q", "-o", str(outputs[-1]), option, value]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            wall[option].append(time.monotonic() - begun)
            cpu[option].append(cpu_of(processes) - spent)
    for what, found in (("wall", wall), ("CPU", cpu)):
        here, there = (statistics.median(found[option]) for option in ("--workers", "--cluster"))
        print(f"{words[0]}: {what} {here:.1f} s, on the cluster {there:.1f} s, ratio {there / here:.3f} ({found})")
    return outputs


def bytes_of(size: int, _: Place) -> Callable[[int], bytes]:
    """A job whose units return so many bytes."""
    return partial(_bytes, size)


def _bytes(size: int, number: int) -> bytes:
    return number.to_bytes(8, "little") * (size // 8)


def units(file: Path, folder: Path, size: int, count: int) -> float:
    """Return the time [s] of each of `count` units that return `size` bytes and compute nothing."""
    with closing(DaskCluster(str(file)).start(Work(partial(bytes_of, size), folder))) as workers:
        waiting, begun = iter(range(count)), time.monotonic()
        for number, found in computed(workers, lambda: next(waiting, None)):
            assert found == _bytes(size, number)
        return (time.monotonic() - begun) / count


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=20_000, help="kept, in all eight scenarios")
    parser.add_argument("--exam", type=int, default=64, help="episodes of the exam, with each pedestrian")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, dask(Path(name)) as (file, processes):
        folder = Path(name)
        for size, count in ((8, 400), (2**20, 100), (2**26, 10), (2**30, 1)):
            print(f"a unit that returns {size:,} bytes: {1e3 * units(file, folder / 'out', size, count):.1f} ms")
        words = ["generate", "--episodes", str(given.episodes // 8)]
        made = alternate(words, file, processes, folder, given.repeats)
        assert all(hashes(each) == hashes(made[0]) for each in made), "the bytes differ"
        words = ["ads-test", "--ads-class", DRIVER, "--episodes", str(given.exam // 8)]
        alternate(words, file, processes, folder, given.repeats)


if __name__ == "__main__":
    main()
