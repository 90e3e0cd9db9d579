"""Lock-step ticks per second of the whole graph in separate processes, beside the same episodes in process.

    python test/benchmarks/bench_graph.py [--batches 1 1024] [--ticks 2000] [--weights FILE]

Untrained weights are used where no file is given; the cost of a step does not depend on their values.
"""

import argparse
import os
import platform
import tempfile
import time
from pathlib import Path

from domain_coordinator import domain_id

from vpsci_ros.config import RunConfig, WorldConfig, pick
from vpsci_ros.learning.config import NetworkConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.rollout import policies, rollout
from vpsci_ros.learning.weights import load_weights, save_weights
from vpsci_ros.nodes.graph import run_graph
from vpsci_ros.provenance import software_versions
from vpsci_ros.world import World, load_scenarios
from vpsci_ros.world.monitor import MonitorConfig

NODES = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy"]


def sections(batch: int, ticks: int, weights: str, recorder: bool) -> dict:
    """Return parameters of a run of about `ticks` ticks: an episode lasts up to 200."""
    scenarios = [1] if batch == 1 else [1, 2, 3, 4, 5, 6, 7, 8]
    episodes = max(1, batch * ticks // 200 // len(scenarios))
    return {
        "graph": {"nodes": NODES + ["recorder"] * recorder},
        "world_simulator": {"batch": batch, "episodes": episodes, "scenarios": scenarios},
        "vehicle_policy": {"weights": weights},
        "pedestrian_policy": {"weights": weights},
    }


def in_process(chosen: dict, weights: str) -> tuple[int, float]:
    """Return (ticks, seconds) of the same episodes without nodes."""
    run = pick(RunConfig, chosen["world_simulator"], "benchmark")
    world = World(WorldConfig(), load_scenarios(run.scenarios), run.queue(), run.batch, run.seed)
    steps = rollout(world, MonitorConfig(), policies(load_weights(weights), world, seed=1, explore=False))
    next(steps)  # compilation is not what is measured
    begun = time.perf_counter()
    count = sum(1 for _ in steps)
    return count, time.perf_counter() - begun


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 1024])
    parser.add_argument("--ticks", type=int, default=2000, help="about so many ticks a run")
    parser.add_argument("--weights", default="", help="safetensors file")
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores; {software_versions()}")
    with domain_id() as number, tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        weights = arguments.weights or str(Path(folder) / "initial.safetensors")
        if not arguments.weights:
            save_weights(weights, Networks(NetworkConfig()).weights({}, {}))
        print(f"{'parallel':>10} {'recorder':>9} {'ticks':>7} {'graph ticks/s':>14} {'in process':>11} {'ratio':>6}")
        for batch in arguments.batches:
            for recorder in (False, True):
                chosen = sections(batch, arguments.ticks, weights, recorder)
                result = run_graph(chosen, Path(folder) / f"{batch}{recorder}", quiet=True)
                if result.error:
                    raise SystemExit(result.error)
                rate = result.progress["world_simulator.ticks_per_second_mean"]
                ticks, seconds = in_process(chosen, weights)
                print(
                    f"{batch:>10,} {'yes' if recorder else 'no':>9} {ticks:>7,} {rate:>14,.0f}"
                    f" {ticks / seconds:>11,.0f} {rate * seconds / ticks:>6.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
