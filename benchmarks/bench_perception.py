"""What perception costs a graph of one episode: ticks per second and CPU time with it and without it.

    python benchmarks/bench_perception.py [--ticks 4000] [--rounds 5]

Perception has noise, misses, latency and lost tracks. The control is the same graph without the node, in turn with it,
each run in a process of its own. Printed are all rates, and the median over rounds of the ratio with its range; CPU
time is that of all processes with their start.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from bench_graph import in_one_process, sections, separate
from domain_coordinator import domain_id

from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.sections import Sections

ERRORS = {"position_noise": 0.2, "velocity_noise": 0.2, "missed": 0.05, "latency": 0.1, "lost_rate": 0.02}
WAYS = {"composed": in_one_process, "separate": separate}


def run(how: str, ticks: int, *, perceived: bool) -> tuple[float, float]:
    """Return ticks per second and CPU time [s] of one run in this process and its children."""
    chosen = sections(1, ticks, "refined", acting=True, recorder=False)
    if perceived:
        nodes = [*chosen.values["graph"]["nodes"], "perception"]
        chosen = Sections({**chosen.values, "graph": {"nodes": nodes}, "perception": ERRORS})
    with domain_id() as number, tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        rate = WAYS[how](chosen, Path(folder) / "graph")
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return rate, sum(each.ru_utime + each.ru_stime for each in used)


def measured(how: str, ticks: int, *, perceived: bool) -> tuple[float, float]:
    """Return what `run` does in a process of its own."""
    command = [sys.executable, __file__, "--ticks", str(ticks), "--one", how, *["--perceived"] * perceived]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rate, cpu = json.loads(said.splitlines()[-1])
    return rate, cpu


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=4000, help="about so many a run")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--one", choices=WAYS, help=argparse.SUPPRESS)
    parser.add_argument("--perceived", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(run(options.one, options.ticks, perceived=options.perceived)))
        return
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    print(f"{machine}; load {os.getloadavg()[0]:.1f}; {software_versions()}")
    for how in WAYS:
        found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
        for turn in range(options.rounds):
            for perceived in (bool(turn % 2), not turn % 2):
                found[perceived].append(measured(how, options.ticks, perceived=perceived))
        for k, what in enumerate(("ticks/s", "CPU s")):
            without, there = ([round(row[k], 1) for row in found[each]] for each in (False, True))
            ratios = [b / a for a, b in zip(without, there, strict=True)]
            print(
                f"{how} {what}: without {without}, with {there}; ratio {statistics.median(ratios):.2f}"
                f" ({min(ratios):.2f} to {max(ratios):.2f}), n = {options.rounds} pairs of runs",
                flush=True,
            )


if __name__ == "__main__":
    main()
