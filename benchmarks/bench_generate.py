"""Kept episodes per hour, end to end with files written, the ratio to the paper's 244, and where the time goes.

    python benchmarks/bench_generate.py [--weights closed_loop] [--episodes 200] [--workers 2] [--batches]
                                             [--graph] [--json FILE]

`--episodes` are kept ones in each of the eight scenarios. The first part is a run of `vpsci generate` as it is. The
second simulates the same number of episodes in this process, in one thread, with a stopwatch around world, CurvTTC,
policies and the rest, and tells what simulating episodes that are never critical costs in all, which is the most that
ending them early could save. `--batches` repeats that for several numbers of episodes side by side. `--graph` runs as
many episodes through the ROS nodes, 1024 in each message, recorded to a bag and exported. Other work on the machine
makes every number worse: the CPU time beside each tells how much.
"""

import argparse
import io
import json
import os
import platform
import resource
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.data.published import KEPT_PER_HOUR, TABLE_10
from vpsci_ros.generate import simulate
from vpsci_ros.generate.generate_dataset import PARALLEL, generate, part_writers
from vpsci_ros.generate.job import Job, Unit, job_from
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.streaming import StreamingActor
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import ThisMachine
from vpsci_ros.world import World, loop

BATCHES = (64, 128, 256, 512, 1024, 2048)


class Stopwatches:
    """CPU time of this process spent in functions that are wrapped with `watch`."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.actor_steps = 0

    def count_steps(self) -> None:
        """Count the histories that actors take a step for."""
        original = StreamingActor.step

        def counted(actor: StreamingActor, *args: Any) -> Any:
            active = args[3]
            self.actor_steps += int(active.sum())
            return original(actor, *args)

        StreamingActor.step = counted  # type: ignore[method-assign, assignment]

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Time each call of `owner.name`, as a share of `part`."""
        original: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            begin = time.process_time()
            try:
                return original(*args, **kwargs)
            finally:
                self.seconds[part] += time.process_time() - begin

        setattr(owner, name, timed)


def cpu_seconds() -> float:
    """Return what this process and its children that have ended have used."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def end_to_end(job: Job, targets: Mapping[int, int], workers: int) -> dict[str, float]:
    """Generate a dataset, of so many kept episodes by scenario, and return its rate, its times and the memory of it."""
    folder, used = Path(tempfile.mkdtemp()), cpu_seconds()
    begin = time.perf_counter()
    done = generate(job, targets, folder / "d", partial(part_writers, job, PARALLEL, ThisMachine(workers)))
    wall = time.perf_counter() - begin
    rows = done.description["scenarios"].values()
    kept = sum(row["kept"] for row in rows)
    size = sum(entry["bytes"] for name, entry in done.description["files"].items() if name.endswith(".parquet"))
    shutil.rmtree(folder)
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return {
        "workers": workers,
        "kept": kept,
        "simulated": sum(row["simulated"] for row in rows),
        "computed": done.computed,
        "wall_s": wall,
        "cpu_s": cpu_seconds() - used,
        "simulating_s": done.seconds[0],
        "writing_s": done.seconds[1],
        "kept_per_hour": 3600.0 * kept / wall,
        "times_the_paper": 3600.0 * kept / wall / KEPT_PER_HOUR,
        "table_10_minutes": sum(row.kept for row in TABLE_10.values()) / kept * wall / 60.0,
        "parquet_mb": size / 1e6,
        "memory_mb": (own.ru_maxrss + workers * children.ru_maxrss) / 1e3,  # no more than that
    }


def breakdown(job: Job, batch: int, episodes: int, watches: Stopwatches) -> dict[str, float]:
    """Simulate units in this process and return CPU seconds by part."""
    simulator = simulate.Simulator(job, batch)
    simulator(Unit(job.scenarios[0].number, range(8)))  # compiled or loaded
    watches.seconds.clear()
    watches.actor_steps = 0
    kept = uncritical_frames = frames = 0
    begin = time.process_time()
    for scenario in job.scenarios:
        part = simulator(Unit(scenario.number, range(episodes)))
        kept += int(part.kept.sum())
        frames += int(part.records["frames"].sum())
        uncritical_frames += int(part.records["frames"][part.records["failed"][:, 0]].sum())
    total = time.process_time() - begin
    parts = {name: watches.seconds[name] for name in ("policy", "CurvTTC", "world", "collecting")}
    uncritical = (total - parts["policy"]) * uncritical_frames / frames
    return {
        "batch": batch,
        "episodes": episodes * len(job.scenarios),
        "kept": kept,
        "actor_steps": watches.actor_steps,
        "total": total,
        **parts,
        "rest": total - sum(parts.values()),
        "kept_per_cpu_hour": 3600.0 * kept / total,
        "never_critical": uncritical,
    }


def through_graph(sections: Sections, episodes: int) -> dict[str, float]:
    """Run so many episodes of each scenario through the nodes, export the bag, and return the rate."""
    from domain_coordinator import domain_id
    from rich.console import Console

    from vpsci_ros.bags.export import export_bag
    from vpsci_ros.nodes.graph import run_graph

    folder = Path(tempfile.mkdtemp())
    sections = sections.changed("world_simulator", {"episodes": episodes, "batch": 1024})
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    begin = time.perf_counter()
    with domain_id() as number:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        result = run_graph(sections, folder / "run", quiet=True)
    if result.error:
        raise SystemExit(f"the graph failed: {result.error}")
    middle = time.perf_counter()
    quiet = Console(file=io.StringIO())
    description = export_bag(folder / "run" / "bag", folder / "d", console=quiet)
    end = time.perf_counter()
    shutil.rmtree(folder)
    rows = description["scenarios"].values()
    kept = sum(row["kept"] for row in rows)
    return {
        "kept": kept,
        "simulated": sum(row["simulated"] for row in rows),
        "running_s": middle - begin,
        "exporting_s": end - middle,
        "kept_per_hour": 3600.0 * kept / (end - begin),
    }


def main() -> None:
    """Measure, print, and write the numbers where asked to."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--weights", default="people")
    arguments.add_argument("--episodes", type=int, default=200)
    arguments.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    arguments.add_argument("--batches", action="store_true")
    arguments.add_argument("--graph", action="store_true")
    arguments.add_argument("--json", type=Path)
    options = arguments.parse_args()
    sections = load(params_dir() / "stage3_generate.yaml")
    for agent in ("vehicle", "pedestrian"):
        sections = sections.changed(f"{agent}_policy", {"weights": options.weights})
    job = job_from(sections)

    targets = {scenario.number: options.episodes for scenario in job.scenarios}
    run = end_to_end(job, targets, options.workers)
    print(
        f"{run['kept']:,} kept of {run['simulated']:,} episodes in {run['wall_s']:.1f} s by {options.workers} workers"
        f" ({run['cpu_s']:.1f} s of CPU; writing {run['writing_s']:.1f} s, {run['parquet_mb']:.0f} MB)\n"
        f"{run['kept_per_hour']:,.0f} kept an hour, {run['times_the_paper']:,.0f} times the paper's; "
        f"Table 10 at this rate: {run['table_10_minutes']:.1f} min; memory below {run['memory_mb']:,.0f} MB"
    )
    watches = Stopwatches()
    watches.count_steps()
    watches.watch(PolicyAgent, "act", "policy")
    watches.watch(loop, "assess", "CurvTTC")
    watches.watch(World, "advance", "world")
    watches.watch(EpisodeFrames, "store", "collecting")
    watches.watch(EpisodeFrames, "take", "collecting")
    watches.watch(simulate, "apply_filters", "collecting")
    watches.watch(simulate, "concat_blocks", "collecting")
    tables = []
    per_scenario = max(64, int(run["simulated"] / len(job.scenarios)))
    for batch in BATCHES if options.batches else (PARALLEL,):
        tables.append(breakdown(job, batch, per_scenario, watches))
        print("  ".join(f"{k} {v:,.2f}" if isinstance(v, float) else f"{k} {v:,}" for k, v in tables[-1].items()))
    graph = through_graph(sections, per_scenario) if options.graph else None
    if graph is not None:
        print(
            f"through the graph: {graph['kept']:,} kept of {graph['simulated']:,} in {graph['running_s']:.1f} s and "
            f"{graph['exporting_s']:.1f} s of export: {graph['kept_per_hour']:,.0f} kept an hour"
        )
    if options.json is not None:
        machine = {"cpu": job.description()["cpu"], "cores": os.cpu_count(), "platform": platform.platform()}
        found = {"machine": machine, "end_to_end": run, "cpu_seconds_one_thread": tables, "graph": graph}
        text = json.dumps(found, indent=2)
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
