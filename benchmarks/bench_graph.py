"""Speed of the graph of nodes: lock-step ticks per second by transport and number of parallel episodes.

    python benchmarks/bench_graph.py [--ticks 2000] [--batches 1 1024] [--quick] [--weights FILE] [--json FILE]

Every row is a run of its own from spawn to end; the rate is counted from the first tick to the last. `separate`: each
node in a process; `composed`: all in one; `engine`: the same episodes without nodes, as the control. The graph with
policies is world, monitor and both policies (the shipped `people` unless given); without policies the
rule-based pair drives. Some minutes on two cores.
"""

import argparse
import json
import os
import platform
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from domain_coordinator import domain_id

from vpsci_ros.nodes.graph import run_graph
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.world import World, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.world_config import WorldConfig

EPISODE_TICKS = 200  # at most; with the default episode_time
TRANSPORTS = {"shared memory": "DEFAULT", "UDP": "UDPv4"}  # FASTDDS_BUILTIN_TRANSPORTS; its default takes shared memory
RULES = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}
PERCEPTION = {"position_noise": 0.2, "velocity_noise": 0.2, "missed": 0.05, "latency": 0.1, "lost_rate": 0.02}
POLICIES = ("vehicle_policy", "pedestrian_policy")


def sections(
    batch: int, ticks: int, weights: str, *, acting: bool = True, more: Sequence[str] = (), composed: bool = False
) -> Sections:
    """Return parameters of a run of about `ticks` ticks; `more` nodes take part."""
    scenarios = [1] if batch == 1 else [1, 2, 3, 4, 5, 6, 7, 8]
    episodes = max(1, batch * ticks // EPISODE_TICKS // len(scenarios))
    nodes = ["world_simulator", "safety_monitor", *POLICIES * acting, *more]
    world = {"batch": batch, "episodes": episodes, "scenarios": scenarios} | ({} if acting else RULES)
    chosen = {"graph": {"nodes": nodes, "composed": composed}, "world_simulator": world}
    return Sections(
        chosen
        | {policy: {"weights": weights} for policy in POLICIES * acting}
        | {name: PERCEPTION for name in more if name == "perception"}
    )


def rate_of(chosen: Sections) -> float:
    """Return the ticks per second of a graph, in separate processes or composed in one."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_graph(chosen, Path(folder) / "run", quiet=True)
    if result.error:
        raise SystemExit(result.error)
    return float(result.nodes["world_simulator"].figures["ticks_per_second_mean"])


def engine(chosen: Sections, weights: str) -> float:
    """Return the ticks per second of the same episodes without nodes."""
    run, config = chosen.get(RunConfig, "world_simulator"), chosen.get(WorldConfig, "world_simulator")
    world = World(config, load_scenarios(run.scenarios), run.queue(), run.batch, run.seed)
    agents = policies(load_policy(weights), world)
    steps = iter(Loop(world, agents=agents))
    next(steps)  # compilation is not what is measured
    begun = time.perf_counter()
    count = sum(1 for _ in steps)
    return count / (time.perf_counter() - begun)


def runs(batches: list[int], *, quick: bool) -> list[dict[str, Any]]:
    """Return what to measure."""
    rows: list[dict[str, Any]] = []
    for batch in batches:
        for transport in [*TRANSPORTS][: 1 if quick else None]:
            rows += [{"how": "separate", "batch": batch, "transport": transport}]
        rows.append({"how": "separate", "batch": batch, "recorder": True})
        rows += [{"how": how, "batch": batch} for how in ("composed", "engine")]
    for batch in sorted({1, *batches, 4096}):
        rows += [{"how": how, "batch": batch, "acting": False} for how in ("separate", "composed", "engine")]
    defaults = {"transport": "shared memory", "recorder": False, "acting": True}
    return [defaults | row for row in rows]


def measure(row: dict[str, Any], ticks: int, weights: str) -> float:
    """Return the ticks per second of one row."""
    flags = {"acting": row["acting"], "more": ["recorder"] * row["recorder"], "composed": row["how"] == "composed"}
    # A batch of episodes ends within 200 ticks, the last few of them nearly alone, so larger batches run a few rounds.
    chosen = sections(row["batch"], ticks if row["batch"] == 1 else EPISODE_TICKS * 2, weights, **flags)
    os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = TRANSPORTS[row["transport"]]
    return engine(chosen, weights) if row["how"] == "engine" else rate_of(chosen)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 1024])
    parser.add_argument("--ticks", type=int, default=2000, help="about so many ticks a run of one episode at a time")
    parser.add_argument("--weights", default="people", help="safetensors file, or the name of shipped weights")
    parser.add_argument("--quick", action="store_true", help="events and shared memory only")
    parser.add_argument("--json", type=Path, help="write the results there, too")
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    print(f"{machine}; load {os.getloadavg()[0]:.1f}; {software_versions()}")
    print(
        f"{'policies':>8} {'nodes':>9} {'transport':>13} {'recorder':>8} {'parallel':>8} {'ticks/s':>8}"
        f" {'episode-ticks/s':>15}"
    )
    rows = []
    with domain_id() as number:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        for row in runs(arguments.batches, quick=arguments.quick):
            rate = measure(row, arguments.ticks, arguments.weights)
            rows.append(row | {"ticks_per_second": rate, "episode_ticks_per_second": rate * row["batch"]})
            transport, recorder = ("", "") if row["how"] == "engine" else (row["transport"], row["recorder"])
            print(
                f"{'yes' if row['acting'] else 'no':>8} {row['how']:>9} {transport:>13}"
                f" {'yes' if recorder else '':>8} {row['batch']:>8,} {rate:>8,.0f} {rate * row['batch']:>15,.0f}",
                flush=True,
            )
    if arguments.json:
        document = {"machine": machine, "software": software_versions(), "rows": rows}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
