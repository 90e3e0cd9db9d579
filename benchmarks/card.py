"""Every figure of speed on one card: ours, a control or a peer of the same minutes, and the ratio of the two.

    python benchmarks/card.py [--only dataset world ...] [-o docs/speed.md]

Ten to fifteen minutes on two cores that have nothing else to do. It prints the table and writes the page, with machine,
versions and load. Whoever is compared is measured in turn, three times each, and the ratio is that of the medians. Each
part runs in a process of its own; a part that fails is a row that says why.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

from vpsci_ros.resources import params_dir
from vpsci_ros.runs.provenance import cpu_name, software_versions

ROUNDS = 3  # unless the command says otherwise
STAGE_1_UPDATES, STAGE_2_UPDATES = 3000, 5108  # of the parameter files as shipped; stage 2 with their seed, 2
FEW_UPDATES, FEW_EPISODES = 30, 12  # of the shorter of two runs; episodes: of 375 in each scenario
PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
BEGIN, END = "<!-- written by benchmarks/card.py -->", "<!-- until here -->"


Costs: TypeAlias = tuple[float, float]  # CPU time and time that passed [s]


class Row(NamedTuple):
    """A line of the card."""

    what: str
    ours: str
    control: str = ""
    ratio: float | None = None


def in_turn(ways: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Return the median of each way, all of them taken in turn."""
    found: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            found[name].append(way())
    return {name: statistics.median(values) for name, values in found.items()}


def dataset(rounds: int) -> list[Row]:
    """All of Table 10, once, by a worker for each core, after a run of which nothing counts: then all is compiled."""
    from bench_generate import end_to_end

    from vpsci_ros.cli.parameter_file import load
    from vpsci_ros.data.published import TABLE_10
    from vpsci_ros.generate.job import job_from

    sections = load(params_dir() / "stage3_generate.yaml")
    job = job_from(sections)
    workers = len(os.sched_getaffinity(0))
    end_to_end(job, dict.fromkeys(TABLE_10, 8), workers)
    run = end_to_end(job, {number: row.kept for number, row in TABLE_10.items()}, workers)
    took = f"{run['cpu_s']:,.0f} CPU s, {run['wall_s']:,.0f} s, {run['parquet_mb']:,.0f} MB written"
    return [
        Row(f"dataset: all of Table 10, {workers} workers", took),
        Row("dataset: kept episodes a CPU second", f"{run['kept'] / run['cpu_s']:,.0f}"),
    ]


def world(rounds: int) -> list[Row]:
    """The world without policies beside VMAS; best of windows, in turn."""
    from bench_world import CONFIGS, peer, rates, ticking

    slots = (64, 1024, 8192, 65536)
    ticks = {batch: ticking(CONFIGS["rule-based"], batch) for batch in slots}
    ours: dict[int, list[float]] = {batch: [] for batch in slots}
    theirs: dict[int, list[float]] = {batch: [] for batch in slots}
    note = ""
    for _ in range(rounds):
        for batch, tick in ticks.items():
            ours[batch].append(2e-6 * batch * max(rates(tick, 0.7)))
        other = peer("vmas", 0.7)
        note = str(other.get("note", ""))
        for batch in () if note else slots:
            theirs[batch].append(float(other[f"world.step, {batch} worlds"]))
    rows = []
    for batch in slots:
        median = statistics.median(ours[batch])
        control, ratio = f"VMAS {note}", None
        if theirs[batch]:
            vmas = statistics.median(theirs[batch])
            control, ratio = f"VMAS {vmas:.2f} M", median / vmas
        rows.append(Row(f"world: agent-steps a second, {batch:,} slots", f"{median:.2f} M", control, ratio))
    return rows


def rate(step: Callable[[], object], batch: int, seconds: float) -> float:
    """Return actor-steps per second of `step`, which takes `batch` rows one step further."""
    for _ in range(12):  # so that the attention window is full
        step()
    count, start = 0, time.perf_counter()
    while (spent := time.perf_counter() - start) < seconds:
        step()
        count += 1
    return batch * count / spent


def policies(rounds: int) -> list[Row]:
    """The shipped actor, one thread, beside a library's matrix product of the same thread."""
    import numpy as np

    from vpsci_ros.policy.streaming import StreamingActor
    from vpsci_ros.policy.weights import load_weights
    from vpsci_ros.resources import weights_path

    weights = load_weights(weights_path("closed_loop")).actor("vehicle")
    flops = 2e-9 * sum(array.size for array in weights.tensors.values() if array.ndim == 2)  # of the matrices alone
    square = np.random.default_rng(0).normal(size=(1024, 1024)).astype(np.float32)
    rows = []
    for batch in (1, 64, 1024):
        seen = np.random.default_rng(0).normal(size=(batch, 6)).astype(np.float32)
        others = np.full(batch, 3.0), np.zeros(batch, bool), np.ones(batch, bool)  # CurvTTC, reset, active
        step = partial(StreamingActor(weights, batch).step, seen, *others)
        ways = {"ours": partial(rate, step, batch, 0.7), "product": partial(rate, lambda: square @ square, 1, 0.7)}
        found = in_turn(ways, rounds)
        done, product = found["ours"] * flops, found["product"] * 2e-9 * len(square) ** 3
        ours = f"{found['ours']:,.0f} actor-steps/s, {done:.1f} GFLOP/s"
        rows.append(Row(f"policy: batch {batch:,}", ours, f"numpy {product:.0f} GFLOP/s", done / product))
    return rows


def graph(rounds: int) -> list[Row]:
    """The graph of nodes beside the loop without nodes and a bare chain of processes, at one episode and at 1,024."""
    from bench_graph import engine, rate_of, sections
    from chain import rounds_per_second
    from domain_coordinator import domain_id

    from vpsci_ros.nodes.domain import set_defaults

    set_defaults()
    rows = []
    for batch, ticks, size in ((1, 3000, 260), (1024, 400, 99_600)):  # size: of a state in bytes
        ways: dict[str, Callable[[], float]] = {
            "loop": partial(engine, sections(batch, ticks, "people"), "people"),
            "chain": partial(rounds_per_second, 2000, size),
        }
        controls = {}
        for how, control in (("composed", "loop"), ("separate", "chain")):
            for node in ("", "recorder", *["perception"] * (batch == 1)):
                name = f"{how} with {node}" if node else how
                controls[name] = how if node else control
                ways[name] = partial(
                    rate_of,
                    sections(batch, ticks, "people", more=(node,) if node else (), composed=how == "composed"),
                )
        with domain_id() as number:
            os.environ["ROS_DOMAIN_ID"] = str(number)
            found = in_turn(ways, rounds)
        for name, control in controls.items():
            rate, beside = found[name], found[control]
            rows.append(
                Row(
                    f"graph: ticks/s, {batch:,} episode{'s' if batch > 1 else ''}, {name}",
                    f"{rate:,.0f}",
                    f"{control} {beside:,.0f}",
                    rate / beside,
                )
            )
    return rows


def first_use(_: int) -> list[Row]:
    """From an empty cache of kernels: to the first generated episode, and to the first tick of a graph."""
    base = [sys.executable, "-m", "vpsci_ros.cli"]
    few = ["--params", str(params_dir() / "stage3_generate.yaml"), "--set", "world_simulator.scenarios=[1]"]
    commands = {
        "`vpsci generate` of an episode": [*base, "generate", *few, "--episodes", "1", "-o"],
        "`vpsci graph`, to its first tick": [
            *base,
            "graph",
            "--quiet",
            *few,
            "--set",
            "world_simulator.episodes=1",
            "-o",
        ],
    }
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (what, command) in enumerate(commands.items()):
            environment = os.environ | {"XDG_CACHE_HOME": f"{folder}/cache{number}"}
            environment.pop("NUMBA_CACHE_DIR", None)  # that of this process
            first, second = (_seconds(command, Path(folder) / f"{number}{again}", environment) for again in "ab")
            rows.append(Row(f"first use: {what}", f"{first:.1f} s", f"the second time {second:.1f} s"))
    return rows


def _seconds(command: list[str], output: Path, environment: Mapping[str, str]) -> float:
    """Return how long a command takes to its end, or to the line in a world's log that says that it begins [s]."""
    begun, log = time.perf_counter(), output / "log" / "world_simulator.log"
    with subprocess.Popen([*command, str(output)], env=environment, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not (log.is_file() and "ready: " in log.read_text(encoding="utf-8")):
            time.sleep(0.01)
        taken = time.perf_counter() - begun
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return taken


def learning(_: int) -> list[Row]:
    """Both stages as shipped, each from a short run and one of twice the length: what both do once counts once."""
    with tempfile.TemporaryDirectory() as folder:
        base = [sys.executable, "-m", "vpsci_ros.cli"]
        runs = []
        for times in (1, 2):
            out, settings = Path(folder, f"1_{times}"), f"learner.episodes={times * FEW_UPDATES}"
            cost = _used([*base, "pretrain", "--quiet", "--set", settings, "-o", str(out)])
            runs.append((times * FEW_UPDATES, cost))
        found = [_extrapolated("stage 1", STAGE_1_UPDATES, *runs)]
        start, runs = f"learner.weights={folder}/1_1/pretrained.safetensors", []
        for times in (1, 2):
            out, settings = Path(folder, f"2_{times}"), f"world_simulator.episodes={times * FEW_EPISODES}"
            cost = _used([*base, "refine", "--quiet", "--set", start, "--set", settings, "-o", str(out)])
            log = (out / "refine_log.csv").read_text(encoding="utf-8").splitlines()
            updates = float(dict(zip(log[0].split(","), log[-1].split(","), strict=True))["updates"])
            runs.append((int(updates), cost))
        return [*found, _extrapolated("stage 2", STAGE_2_UPDATES, *runs)]


def _extrapolated(stage: str, whole: int, first: tuple[int, Costs], second: tuple[int, Costs]) -> Row:
    """Return the row of a stage with `whole` updates, on the line through two runs: their updates, their costs."""
    beyond = (whole - second[0]) / (second[0] - first[0])
    cpu, wall = (late + beyond * (late - early) for early, late in zip(first[1], second[1], strict=True))
    what = f"learning: {stage}, extrapolated from {first[0]} and {second[0]} of its {whole:,} updates"
    return Row(what, f"{cpu:.0f} CPU s, {wall:.0f} s")


def _used(command: list[str]) -> Costs:
    """Run a command of the package to its end; return the CPU time and the time that it took [s]."""
    begun, before = time.perf_counter(), os.times()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return cpu, time.perf_counter() - begun


PARTS = {part.__name__: part for part in (dataset, world, policies, graph, first_use, learning)}


def measured(name: str, rounds: int) -> list[Row]:
    """Return the rows of a part, measured in a process of its own."""
    command = [sys.executable, __file__, "--part", name, "--rounds", str(rounds)]
    threads = (
        dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1") if name in ("policies", "learning") else {}
    )
    environment = os.environ | threads
    result = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    if result.returncode:
        return [Row(name, "failed", (result.stderr.strip().splitlines() or ["without a word"])[-1])]
    return [Row(*row) for row in json.loads(result.stdout.strip().splitlines()[-1])]


def page(before: str, rows: list[Row], machine: str, minutes: float) -> str:
    """Return the page with another table, and what is written by hand below it."""
    cells = [(*row[:3], "" if row.ratio is None else f"{row.ratio:.2f}") for row in rows]
    table = ["| what | ours | control | ratio |", "|---|---|---|---|", *(f"| {' | '.join(each)} |" for each in cells)]
    made = f"{machine}. Taken in {minutes:.0f} minutes.\n\n" + "\n".join(table) + "\n"
    head, begin, rest = before.partition(BEGIN)
    return head + begin + "\n" + made + END + rest.partition(END)[2]


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=[*PARTS])
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("-o", "--output", type=Path, default=PAGE)
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        print(json.dumps(PARTS[options.part](options.rounds)))
        return
    versions = ", ".join(f"{name} {version}" for name, version in software_versions().items())
    today = f"{datetime.now(timezone.utc):%-d %B %Y}"
    where = f"{cpu_name()}, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f} before"
    machine = f"{today}, {where}; {versions}"
    print(machine)
    begun, rows = time.perf_counter(), list[Row]()
    for name in options.only:
        for row in measured(name, options.rounds):
            rows.append(row)
            ratio = "" if row.ratio is None else f"{row.ratio:.2f}"
            print(f"{row.what:60} {row.ours:>36} {row.control:>48} {ratio:>7}", flush=True)
    minutes = (time.perf_counter() - begun) / 60
    options.output.write_text(page(PAGE.read_text(encoding="utf-8"), rows, machine, minutes), encoding="utf-8")
    print(f"written: {options.output}, in {minutes:.1f} minutes")


if __name__ == "__main__":
    main()
