"""Agent-steps per second of the world without policies, beside other simulators measured in the same run.

    python benchmarks/bench_world.py [--seconds 1.0] [--pedestrians 1] [--peers] [--json FILE]

An agent-step is one tick of one vehicle or one pedestrian; with `--pedestrians`, every episode has so many. Counted in
are routes, autopilot and walker, CurvTTC of every slot at every tick, hand-over, events, the end of episodes and the
start of fresh ones from the queue. In "rule-based" the autopilot and the walker act for whole episodes, in "handed
over" both agents are under policies from CurvTTC < 5 s on, whose answers are zeros and cost nothing. Of several windows
the best and the median are shown: other work on the machine can only slow a window down.

Peers (benchmarks/peers.py) are VMAS, libsumo and highway-env, each in a process of its own; those that are not
installed are left out with a note.
"""

import argparse
import itertools
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import Actions

BATCHES = (1, 64, 1024, 8192, 65536)
CONFIGS = {
    "rule-based": WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot"),
    "handed over": WorldConfig(),
}
PEERS = ("vmas", "libsumo", "highway-env")
WINDOWS = 7


def ticking(config: WorldConfig, batch: int) -> Callable[[], None]:
    """Return a function that takes `batch` slots through one tick; the queue never ends."""
    queue = ((scenario, number) for number in itertools.count() for scenario in range(1, 9))
    world = World(config, load_scenarios(range(1, 9)), queue, batch, 1)
    rows = batch * config.pedestrians
    loop, zeros = Loop(world), Actions(np.zeros((rows, 2)), np.zeros((rows, 2)))

    def tick() -> None:
        world.advance(loop.assessment, zeros)

    for _ in range(240):  # compiled, and the slots at different times of their episodes
        tick()
    return tick


def rates(tick: Callable[[], None], seconds: float) -> list[float]:
    """Return calls per second in each of `WINDOWS` windows."""
    found = []
    for _ in range(WINDOWS):
        calls, begin = 0, time.perf_counter()
        while (spent := time.perf_counter() - begin) < seconds / WINDOWS or calls < 3:
            tick()
            calls += 1
        found.append(calls / spent if calls else 0.0)
    return found


def peer(name: str, seconds: float) -> dict[str, float | str]:
    """Measure one peer in a process of its own; {"note": why} where that does not work."""
    command = [sys.executable, str(Path(__file__).with_name("peers.py")), name, "--seconds", str(seconds)]
    result = subprocess.run(command, check=False, capture_output=True, text=True, timeout=600)
    if result.returncode:
        return {"note": (result.stderr.strip().splitlines() or ["ended without a word"])[-1]}
    measured: dict[str, float | str] = json.loads(result.stdout.strip().splitlines()[-1])
    return measured


def main() -> None:
    """Measure, print and, if asked to, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1.0, help="spent on each number")
    parser.add_argument("--pedestrians", type=int, default=1, help="of an episode")
    parser.add_argument("--peers", action="store_true", help="measure the other simulators too")
    parser.add_argument("--json", type=Path, help="write the numbers here")
    options = parser.parse_args()
    machine = f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f} at the start"
    report: dict[str, object] = {"machine": machine, "numba": numba.__version__, "numpy": np.__version__}
    print(f"{machine}\nmillion agent-steps a second, best (median) of {WINDOWS} windows")
    print(f"{'slots':>8} " + " ".join(f"{name:>18}" for name in CONFIGS))
    rows = []
    for batch in BATCHES:
        row: dict[str, object] = {"slots": batch}
        text = f"{batch:>8} "
        for name, config in CONFIGS.items():
            several = replace(config, pedestrians=options.pedestrians)
            agents = batch * (1 + options.pedestrians)
            found = [1e-6 * agents * rate for rate in rates(ticking(several, batch), options.seconds)]
            row[name] = {"best": max(found), "median": float(np.median(found))}
            text += f"{max(found):>10.2f} ({np.median(found):5.2f}) "
        rows.append(row)
        print(text, flush=True)
    report["world"] = rows
    if options.peers:
        report["peers"] = {name: peer(name, options.seconds) for name in PEERS}
        for name, measured in report["peers"].items():  # type: ignore[attr-defined]
            print(f"{name}: {measured.pop('note')}" if "note" in measured else f"{name}:", end="")
            print("".join(f"\n    {what}: {value:.3f} M" for what, value in measured.items()), flush=True)
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
