"""Updates per second and memory of both stages, and what 3,000 stage-1 iterations come to.

    python test/benchmarks/bench_training.py [--threads 2] [--data near_misses.parquet]

Without data the synthetic sample stands in. Each row runs in a process of its own, so that the peak memory is its own.
Results measured so far are in test/benchmarks/results_training.md.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import torch

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.synthetic import synthetic_near_misses
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.learning.transitions import TRANSITION

WARM, MEASURED = 3, 12
ROWS = (
    ("stage 1, closed_loop (default)", {}),
    ("stage 1, closed_loop", {"rollouts": 64}),
    ("stage 1, closed_loop", {"rollout_steps": 30}),
    ("stage 1, ddpg", {"objective": "ddpg"}),
    ("stage 1, ddpg", {"objective": "ddpg", "batch_size": 64}),
    ("stage 1, ddpg", {"objective": "ddpg", "batch_size": 1024}),
    ("stage 2", {"steps": 20}),
    ("stage 2", {"steps": 100}),
)


def stage_1(table: pl.DataFrame, settings: dict[str, object]) -> float:
    """Return seconds per iteration."""
    config = replace(PretrainConfig(), episodes=WARM + MEASURED, held_out_fraction=0.0, **settings)
    times: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        pretrain(
            table,
            config,
            NetworkConfig(),
            seed=1,
            out_dir=Path(folder),
            report=lambda _: times.append(time.perf_counter()),
        )
    return (times[-1] - times[WARM - 1]) / MEASURED


def stage_2(table: pl.DataFrame, steps: int) -> float:
    """Return seconds per update, with simulated histories of `steps` steps."""
    torch.manual_seed(1)
    config = RefineConfig(critic_warm_up=0, updates_per_refresh=10**6, warm_up_steps=1)
    refiner = Refiner(config, Networks(NetworkConfig()).weights({}, {}), table, seed=1)
    rows = np.zeros(5000 // steps * steps, TRANSITION)
    rows["number"], rows["scenario"] = np.arange(len(rows)), 1
    rows["episode"], rows["step"] = np.arange(len(rows)) // steps, np.arange(len(rows)) % steps
    rows["last"] = rows["step"] == steps - 1
    refiner.add(rows)
    for i in range(WARM + MEASURED):
        if i == WARM:
            start = time.perf_counter()
        refiner.update()
    return (time.perf_counter() - start) / MEASURED


def main() -> None:
    """Print the table, or measure one row of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--row", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.row is None:
        print(f"{args.threads} thread(s)\n{'':60s}{'s/update':>10s}{'updates/s':>11s}{'3,000 in':>11s}{'memory':>10s}")
        for i in range(len(ROWS)):
            subprocess.run([sys.executable, __file__, *sys.argv[1:], "--row", str(i)], check=True)
        return
    torch.set_num_threads(args.threads)
    table = read_near_misses(args.data) if args.data else synthetic_near_misses().table
    name, settings = ROWS[args.row]
    seconds = stage_2(table, **settings) if name == "stage 2" else stage_1(table, settings)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    label = name + "".join(f", {key} = {value}" for key, value in settings.items() if key != "objective")
    print(f"{label:60s}{seconds:10.3f}{1 / seconds:11.1f}{seconds * 50:8.0f} min{memory:7.0f} MB", flush=True)


if __name__ == "__main__":
    main()
