"""What spreading a dataset over a cluster costs, and what breaks first: idle workers, by Ray's own scheduler.

    python benchmarks/scale.py [--workers 2 20] [--units 8] [--kept 200] [--exam 1] [--json FILE]

A dataset of `--kept` episodes in each scenario is made by one worker, whose units are timed apart from the process
that hands them out, gathers and writes them. Then Ray runs, with so many workers at once on this machine, `--units`
units for each, which sleep as long as a unit takes and return as many bytes (`pip install 'vpsci_ros[ray]'`; each
worker is a process of some 100 MB that takes a second of CPU to start, which is not counted). Last, an exam of the
reference driving system through graphs. From these follow, on paper, a million kept episodes and a thousand exams.
"""

import argparse
import contextlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.measures import EPISODES
from vpsci_ros.generate.config import DatasetConfig
from vpsci_ros.generate.job import Unit, job_from
from vpsci_ros.generate.run import generate
from vpsci_ros.generate.simulate import computing
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.ray_workers import RayWorkers
from vpsci_ros.runs.workers import Serial, computed

MILLION, EXAMS = 1_000_000, 1000
CLUSTERS = (1, 2, 20, 200)


class Timed(Serial[Unit, tuple[int, bytes]]):
    """One worker in this process, as of a cluster, whose CPU time is kept apart [s]."""

    here = False

    def __init__(self, do: Callable[[Unit], tuple[int, bytes]]) -> None:
        super().__init__(lambda: do)
        self.seconds: list[float] = []
        self.sizes: list[int] = []

    def collect(self) -> list[tuple[Unit, tuple[int, bytes]]]:
        """Do the next unit."""
        begin = time.process_time()
        [(unit, (kept, data))] = super().collect()
        self.seconds.append(time.process_time() - begin)
        self.sizes.append(len(data))
        return [(unit, (kept, data))]


def dataset(kept: int) -> dict[str, float]:
    """Return what a unit costs its worker and the process that gathers all of them."""
    sections = load(params_dir() / "stage3_generate.yaml")
    job, config = job_from(sections), sections.get(DatasetConfig, "dataset")
    do = computing(job, config.parallel)
    do(Unit(job.scenarios[0].number, range(8)))  # compiled or loaded
    timed, targets = Timed(do), {scenario.number: kept for scenario in job.scenarios}
    with tempfile.TemporaryDirectory() as folder:
        ends = [time.process_time()]
        done = generate(
            job,
            targets,
            Path(folder) / "d",
            config,
            lambda: timed,
            report=lambda _: ends.append(time.process_time()),
        )
        ends = [ends[0], ends[-1], time.process_time()]
        files = done.description["files"].values()
        size = sum(entry["bytes"] for entry in files)
    rows = sum(row["kept"] for row in done.description["scenarios"].values())
    units = len(timed.seconds)
    return {
        "kept": rows,
        "units": units,
        "unit_cpu_s": sum(timed.seconds) / units,
        "unit_bytes": sum(timed.sizes) / units,
        "gathering_cpu_s_a_unit": (ends[1] - ends[0] - sum(timed.seconds)) / units,
        "writing_cpu_s_a_unit": (ends[2] - ends[1]) / units,
        "kept_a_unit": rows / units,
        "bytes_a_kept_episode": size / rows,
    }


def _sleeping(seconds: float, size: int) -> Callable[[int], bytes]:
    def do(_: int) -> bytes:
        time.sleep(seconds)
        return bytes(size)

    return do


def spread(workers: int, units: int, seconds: float, size: int) -> dict[str, float]:
    """Return what Ray loses with so many workers at once whose units sleep: the share of their time that is work."""
    import ray

    ray.init(num_cpus=workers, include_dashboard=False, log_to_driver=False)
    pool: RayWorkers[int, bytes] = RayWorkers(partial(_sleeping, seconds, size), "local", workers)
    with contextlib.closing(pool):
        _drain(pool, workers)  # its processes are started
        begin, used = time.perf_counter(), time.process_time()
        _drain(pool, units * workers)
        wall, cpu = time.perf_counter() - begin, time.process_time() - used
    return {
        "workers": workers,
        "units": units * workers,
        "share_of_work": units * seconds / wall,
        "handing_out_cpu_s_a_unit": cpu / (units * workers),
    }


def _drain(pool: RayWorkers[int, bytes], count: int) -> None:
    numbers: Iterator[int] = iter(range(count))
    for _ in computed(pool, lambda: next(numbers, None)):
        continue


def exam(episodes: int) -> dict[str, float]:
    """Return what an exam of the reference driving system costs, through graphs: CPU time and bytes an episode."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "vpsci_ros.cli", "ads-test", "--quiet", "--episodes", f"{episodes}"]
        begin = _children()
        subprocess.run([*command, "-o", f"{folder}/exam"], check=True, stdout=subprocess.DEVNULL)
        cpu = _children() - begin
        files = [path for path in Path(folder).rglob("*") if path.is_file()]
        driven = pl.read_parquet(f"{folder}/exam/{EPISODES}").height
        return {
            "episodes": driven,
            "cpu_s_an_episode": cpu / driven,
            "bytes_an_episode": sum(path.stat().st_size for path in files) / driven,
        }


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def on_paper(made: dict[str, float], spreads: Sequence[dict[str, float]], exams: dict[str, float]) -> dict[str, Any]:
    """Return what a million kept episodes and a thousand exams come to, and how many workers one process keeps busy.

    That process takes in the units of all, on one core and by one line, and writes the files at the end.
    """
    handing = max((row["handing_out_cpu_s_a_unit"] for row in spreads), default=0.0)
    unit, gathering, writing = (
        made["unit_cpu_s"],
        made["gathering_cpu_s_a_unit"] + handing,
        made["writing_cpu_s_a_unit"],
    )
    units, driven = MILLION / made["kept_a_unit"], EXAMS * exams["episodes"]
    return {
        "million_core_hours": units * (unit + gathering + writing) / 3600.0,
        "million_gigabytes": MILLION * made["bytes_a_kept_episode"] / 1e9,
        "million_minutes": {f"{n}": units * (max(unit / n, gathering) + writing) / 60.0 for n in CLUSTERS},
        "workers_that_one_core_gathers_from": unit / gathering,
        "workers_that_fill_10_gbit_s": 1.25e9 * unit / made["unit_bytes"],
        "thousand_exams_core_hours": driven * exams["cpu_s_an_episode"] / 3600.0,
        "thousand_exams_gigabytes": driven * exams["bytes_an_episode"] / 1e9,
    }


def main() -> None:
    """Measure, and print all as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, nargs="*", default=[2, 20])
    parser.add_argument("--units", type=int, default=8)
    parser.add_argument("--kept", type=int, default=200)
    parser.add_argument("--exam", type=int, default=1, help="episodes in each scenario")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    compile_kernels()
    print(f"dataset, {options.kept} kept episodes in each scenario ...", file=sys.stderr)
    made = dataset(options.kept)
    spreads = []
    for workers in options.workers:
        print(f"Ray, {workers} workers ...", file=sys.stderr)
        spreads.append(spread(workers, options.units, made["unit_cpu_s"], int(made["unit_bytes"])))
    print("exam ...", file=sys.stderr)
    exams = exam(options.exam)
    found = {
        "machine": cpu_name(),
        "versions": software_versions(),
        "dataset": made,
        "ray": spreads,
        "exam": exams,
        "on_paper": on_paper(made, spreads, exams),
    }
    text = json.dumps(found, indent=2)
    print(text)
    if options.json:
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
