"""Pairs per second of CurvTTC, single and batched, beside the 2D-TTC method measured in the same run.

    python benchmarks/bench_curvttc.py [--repeats 30] [--json FILE]

The control is a few lines of numpy that stand in for the 2D-TTC package: two rectangles on straight lines, every corner
of each cast along the relative velocity against every side of the other. It is not that package itself, which goes
through pandas and is slower still.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
from numba import njit

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, curvttc, curvttc_pair
from vpsci_ros.safety.inputs import Floats

SIZES = (VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS, 10.0)
LOOP = 100_000


def pairs(count: int, touching: float, rng: np.random.Generator) -> Floats:
    """Return the nine state arguments of `curvttc`, float64[9, count], a part `touching` of which touch within 10 s.

    Those that touch meet on the vehicle's arc at a random time of its next 10 s; the others are around it, within
    30 m, at any velocity, and do not touch.
    """
    kept: dict[bool, list[Floats]] = {True: [], False: []}
    wanted = {True: round(count * touching), False: count - round(count * touching)}
    while any(sum(part.shape[1] for part in kept[k]) < wanted[k] for k in kept):
        n = 2 * count
        heading, speed, curvature = rng.uniform(-np.pi, np.pi, n), rng.uniform(0.0, 8.0, n), rng.uniform(-0.15, 0.15, n)
        walk, start = rng.normal(0.0, 1.0, (2, n)), rng.uniform(-30.0, 30.0, (2, n))
        meet = rng.random(n) * np.minimum(10.0, 0.5 * np.pi / np.maximum(speed * np.abs(curvature), 1e-9))
        half = 0.5 * speed * curvature * meet
        chord = speed * meet * np.sinc(half / np.pi)
        there = np.stack([chord * np.cos(heading + half), chord * np.sin(heading + half)])
        aimed = rng.random(n) < touching
        start = np.where(aimed, there + rng.normal(0.0, 1.0, (2, n)) - walk * meet, start)
        state = np.stack([np.zeros(n), np.zeros(n), heading, speed, curvature, *start, *walk])
        state = state[:, clearance(0.0, 0.0, heading, *start) > 0.0]
        touch = np.isfinite(curvttc(*state))
        for kind, part in kept.items():
            part.append(state[:, touch == kind])
    both = [np.concatenate(kept[kind], axis=1)[:, : wanted[kind]] for kind in kept]
    state = np.concatenate(both, axis=1)
    return np.ascontiguousarray(state[:, rng.permutation(count)])


def straight_ttc(state: Floats) -> Floats:
    """Return the 2D TTC of two rectangles by numpy: the control. The pedestrian is a square as wide as its disc."""
    x, y, heading, speed, _, ped_x, ped_y, ped_vx, ped_vy = state
    u, v = ped_vx - speed * np.cos(heading), ped_vy - speed * np.sin(heading)
    vehicle = corners(x, y, heading, VEHICLE_LENGTH, VEHICLE_WIDTH)
    walker = corners(ped_x, ped_y, np.arctan2(ped_vy, ped_vx), 2 * PEDESTRIAN_RADIUS, 2 * PEDESTRIAN_RADIUS)
    first = np.full(len(x), np.inf)
    for moving, still, sign in ((walker, vehicle, 1.0), (vehicle, walker, -1.0)):
        for i in range(4):
            for j in range(4):
                ax, ay = still[0][j], still[1][j]
                ex, ey = still[0][(j + 1) % 4] - ax, still[1][(j + 1) % 4] - ay
                dx, dy = ax - moving[0][i], ay - moving[1][i]
                across = sign * (u * ey - v * ex)
                with np.errstate(divide="ignore", invalid="ignore"):
                    when, where = (dx * ey - dy * ex) / across, sign * (dx * v - dy * u) / across
                hit = (when >= 0.0) & (where >= 0.0) & (where <= 1.0)
                first = np.minimum(first, np.where(hit, when, np.inf))
    return first


def corners(x: Floats, y: Floats, heading: Floats, length: float, width: float) -> tuple[list[Floats], list[Floats]]:
    """Return the corners of rectangles in order, x and y of each."""
    fx, fy = 0.5 * length * np.cos(heading), 0.5 * length * np.sin(heading)
    lx, ly = -0.5 * width * np.sin(heading), 0.5 * width * np.cos(heading)
    return [x + fx + lx, x - fx + lx, x - fx - lx, x + fx - lx], [y + fy + ly, y - fy + ly, y - fy - ly, y + fy - ly]


@njit
def pair_loop(state: Floats, count: int) -> float:
    """Call the kernel `count` times, as other numba code does; the sum keeps the calls."""
    total = 0.0
    for i in range(count):
        k = i % state.shape[1]
        s = state[:, k]
        total += min(curvttc_pair(s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8], 4.69, 1.85, 0.3, 10.0), 10.0)
    return total


def seconds(call: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the best and the median time of a call [s], after one that is not counted."""
    call()
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return min(times), float(np.median(times))


def machine() -> str:
    """Return CPU, cores, load, and versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        model = next(
            (line.split(":")[1].strip() for line in info.read_text().splitlines() if "model name" in line), model
        )
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    versions = f"Python {platform.python_version()}, numpy {np.__version__}, numba {numba.__version__}"
    return f"{model}, {len(os.sched_getaffinity(0))} cores, load {load}; {versions}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--json", type=Path, help="write the figures here, too")
    arguments = parser.parse_args()
    rng = np.random.default_rng(1)
    print(machine())
    print(f"{'':44} {'M pairs/s, best':>16} {'median':>8} {'control':>8}")
    figures: dict[str, object] = {"machine": machine()}
    for count, touching in ((1_000, 0.06), (1_000, 0.79), (1_000_000, 0.06), (1_000_000, 0.79)):
        state = pairs(count, touching, rng)
        repeats = arguments.repeats if count > 1_000 else 20 * arguments.repeats
        best, median = (count / t / 1e6 for t in seconds(lambda state=state: curvttc(*state), repeats))
        control = count / seconds(lambda state=state: straight_ttc(state), max(3, repeats // 20))[0] / 1e6
        name = f"batch of {count:,}, {touching:.0%} touching"
        figures[name] = {"best": best, "median": median, "control": control}
        print(f"{name:44} {best:16.1f} {median:8.1f} {control:8.2f}", flush=True)
    for touching in (0.06, 0.79):
        state = pairs(1_000, touching, rng)
        best, median = (t / LOOP * 1e6 for t in seconds(lambda state=state: pair_loop(state, LOOP), arguments.repeats))
        name = f"single pair inside numba code, {touching:.0%} touching"
        figures[name] = {"best_us": best, "median_us": median}
        print(f"{name:44} {best:13.2f} us {median:5.2f} us")
    one = [float(value) for value in state[:, 0]]
    best, median = (t / 1000 * 1e6 for t in seconds(lambda: [curvttc(*one) for _ in range(1000)], arguments.repeats))
    figures["single checked call from Python"] = {"best_us": best, "median_us": median}
    print(f"{'single checked call from Python':44} {best:13.2f} us {median:5.2f} us")
    print("control: numpy stand-in for the 2D-TTC package (straight lines, two rectangles), same run, best time")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
