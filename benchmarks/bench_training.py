"""Updates per second and memory of both stages, what 3,000 stage-1 episodes come to, and how all that grows.

    python benchmarks/bench_training.py [--threads 1] [--data near_misses.parquet] [--updates 12] [--json FILE]

Without data it learns from right_turns. Each row runs in a process of its own, so that the peak memory is its own.
A row is the mean of `--updates` updates after three. Other work on the machine makes the wall time worse; the CPU time
beside it is what one free core would take, as long as there is one thread. The time of 3,000 stage-1 episodes (an
episode of Algorithm 1 is one update of all networks) is extrapolated from the row, by both.
Figures of a run are in docs/speed.md.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import torch

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.learning.transitions import TRANSITION
from vpsci_ros.parameters import build
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.runs.provenance import cpu_name, software_versions

WARM = 3
EPISODES = 3000  # Table 8
SIZES = (64, 256, 1024)  # steps in a batch; 256 is Table 8's
LENGTHS = (10, 30, 100)  # steps of a history
Clock = tuple[float, float]  # wall, CPU [s]


def rows() -> list[tuple[str, str, dict[str, Any]]]:
    """Return (what grows, stage, settings) of every row."""
    closed, ddpg = {"objective": "closed_loop"}, {"objective": "ddpg"}
    found: list[tuple[str, str, dict[str, Any]]] = [("", "1", closed), ("", "1", ddpg), ("", "2", {})]
    for objective in (closed, ddpg):
        found += [("batch", "1", objective | {"replay.batch_size": n}) for n in SIZES]
    found += [("batch", "1", closed | {"imitation.rollouts": n}) for n in (8, 32, 128)]
    found += [("batch", "2", {"replay.batch_size": n}) for n in SIZES]
    found += [("length", "1", ddpg | {"steps": n}) for n in LENGTHS]
    found += [("length", "1", closed | {"imitation.rollout_steps": n}) for n in (5, 15, 30)]
    found += [("length", "2", {"steps": n}) for n in LENGTHS]
    return found


def clock() -> Clock:
    """Return the time on the wall and that of this process's threads on CPUs [s]."""
    return time.perf_counter(), time.process_time()


def per_update(begin: Clock, end: Clock, updates: int) -> Clock:
    """Return seconds an update."""
    return (end[0] - begin[0]) / updates, (end[1] - begin[1]) / updates


def stage_1(table: pl.DataFrame, updates: int, steps: int | None = None, **settings: object) -> Clock:
    """Time iterations of stage 1; with `steps`, every recorded history is cut to so many, or left out if shorter."""
    if steps is not None:
        long = table.filter(pl.len().over("interaction") > steps, pl.col("step") <= steps)
        table = long.filter((pl.col("curvttc") < 5.0).any().over("interaction"))
        if table.is_empty():
            raise SystemExit(f"no near miss has {steps} steps")
    config = build(PretrainConfig, {"episodes": WARM + updates, "held_out_fraction": 0.0} | settings, "benchmark")
    times: list[Clock] = []
    with tempfile.TemporaryDirectory() as folder:
        options = {"seed": 1, "out_dir": Path(folder), "report": lambda _: times.append(clock())}
        pretrain(table, config, NetworkConfig(), **options)
    return per_update(times[WARM - 1], times[-1], updates)


def stage_2(table: pl.DataFrame, updates: int, steps: int = 20, **settings: object) -> Clock:
    """Time updates of stage 2 with simulated histories of `steps` steps, rehearsal of real near misses included."""
    torch.manual_seed(1)
    quick = {"ddpg.critic_warm_up": 0, "refresh.updates": 10**6, "updates.warm_up_steps": 1}
    config = build(RefineConfig, quick | settings, "benchmark")
    refiner = Refiner(config, Networks(NetworkConfig()).weights({}, {}), table, seed=1)
    made = np.zeros(5000 // steps * steps, TRANSITION)
    made["number"], made["scenario"] = np.arange(len(made)), 1
    made["episode"], made["step"] = np.arange(len(made)) // steps, np.arange(len(made)) % steps
    made["last"] = made["step"] == steps - 1
    refiner.add(made)
    for _ in range(WARM):
        refiner.update()
    begin = clock()
    for _ in range(updates):
        refiner.update()
    return per_update(begin, clock(), updates)


def measure(number: int, data: Path | None, updates: int) -> dict[str, Any]:
    """Return what row `number` came to, in this process."""
    grows, stage, settings = rows()[number]
    table = read_near_misses(data or "right_turns")
    wall, cpu = (stage_1 if stage == "1" else stage_2)(table, updates, **settings)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"grows": grows, "stage": stage, **settings, "wall_s": wall, "cpu_s": cpu, "memory_mb": memory}


def show(row: dict[str, Any]) -> None:
    """Print a row."""
    numbers = ("grows", "stage", "wall_s", "cpu_s", "memory_mb")
    what = f"stage {row['stage']}" + (f", {row['objective']}" if "objective" in row else "")
    what += "".join(f", {name} {value}" for name, value in row.items() if name not in (*numbers, "objective"))
    wall, cpu = row["wall_s"], row["cpu_s"]
    total = f"{wall * EPISODES / 60:8.1f} {cpu * EPISODES / 60:8.1f}" if row["stage"] == "1" else ""
    print(f"{what:45s}{wall:8.3f} {cpu:7.3f} {1 / wall:8.1f}{row['memory_mb']:8.0f}{total:>18s}", flush=True)


def main() -> None:
    """Print the tables, or measure one row of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--updates", type=int, default=12)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--row", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.row is not None:
        torch.set_num_threads(args.threads)
        print(json.dumps(measure(args.row, args.data, args.updates)))
        return
    machine = {"cpu": cpu_name(), "cores": len(os.sched_getaffinity(0)), "threads": args.threads}
    machine |= {"load_average": round(os.getloadavg()[0], 2), "updates": args.updates, "software": software_versions()}
    print(f"{machine['cpu']}, {machine['cores']} cores, load average {machine['load_average']} before the start")
    print(
        ", ".join(f"{name} {version}" for name, version in machine["software"].items()), f"\n{args.threads} thread(s)"
    )
    print(f"{'':45s}{'s/update':>8s} {'CPU s':>7s} {'1/s':>8s}{'MB':>8s}{'3,000: min, CPU':>18s}")
    done: list[dict[str, Any]] = []
    titles = {"": "as the parameters are", "batch": "by size of the batch", "length": "by length of the histories"}
    for number, (grows, _, _) in enumerate(rows()):
        if number == 0 or grows != done[-1]["grows"]:
            print(f"-- {titles[grows]}")
        command = [sys.executable, __file__, "--threads", f"{args.threads}", "--updates", f"{args.updates}"]
        command += ["--row", f"{number}", *(["--data", str(args.data)] if args.data else [])]
        done.append(json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.splitlines()[-1]))
        show(done[-1])
        if args.json:
            args.json.write_text(json.dumps({"machine": machine, "rows": done}, indent=2) + "\n")
    print("3,000: stage-1 episodes, minutes of wall time and of CPU time, extrapolated from the mean of the row")


if __name__ == "__main__":
    main()
