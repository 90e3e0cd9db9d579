"""The search on a driver whose failures are all known: whether its intervals cover, and what it saves.

    python benchmarks/search.py [--pools 5] [--size 20000] [--budget 1000] [-o search.json]

The driver is in this process, a rule as `example_ads` has it but with eyes 0.4 s late, a nearer horizon and a higher
speed, so that it hits the default pedestrian in some of a thousand episodes. It drives every episode of each pool,
which is the truth, and then the search has its budget of them. Control: how many failures a budget drawn at random
would hold, and how many episodes at random an interval as narrow takes. Some ten minutes a pool of 20,000 on two cores.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.cli.options import read_sections
from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.exam.exam import MOVING, Exam, prepare
from vpsci_ros.exam.run import loop_with
from vpsci_ros.extras.exam_extra.search.imitation import lessons
from vpsci_ros.extras.exam_extra.search.search_exam import plain
from vpsci_ros.extras.exam_extra.search.seek import Driven, SearchConfig, seek
from vpsci_ros.resources import params_path
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.world import IDLE
from vpsci_ros.world.tick import Actions, Step

PEDESTRIAN = "learned"
LATE = 8  # [ticks] by which the driver sees the pedestrian late
CRUISE, HORIZON, MARGIN = 5.0, 1.5, 0.4  # [m/s], [s], [m]
_LENGTH, _WIDTH = 2.35 + 0.3 + MARGIN, 0.93 + 0.3 + MARGIN  # [m] from the vehicle's centre
_PLACE = ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy")
_BATCH = 1024

State = NDArray[np.void]


class LateDriver:
    """Brakes for a contact within the horizon [s], at what it saw `late` >= 1 ticks ago; else keeps its speed."""

    def __init__(self, late: int = LATE, horizon: float = HORIZON, cruise: float = CRUISE) -> None:
        self._late, self._horizon, self._cruise = late, horizon, cruise
        self._past: list[State] = []

    def act(self, state: State) -> NDArray[np.float64]:
        """Return accelerations, float64[B, 2] [m/s2], for EPISODE[B]."""
        self._past = [*self._past[-self._late :], state.copy()]
        old, seen = self._past[0], state.copy()
        same = (old["episode"] == state["episode"]) & (old["scenario"] == state["scenario"]) & (old["status"] != IDLE)
        for name in _PLACE:
            unseen = 1e4 if name == "pedestrian_x" else state[name]
            seen[name] = np.where(same, old[name], unseen)
        speed = state["vehicle_speed"]
        time_left = contact_time(seen, np.maximum(speed, 1.0), self._horizon)
        braking = -np.minimum(8.0, np.maximum(3.0, 0.5 * speed / np.maximum(time_left, 0.1)))
        along = np.where(time_left < self._horizon, braking, np.clip((self._cruise - speed) / 0.5, -2.0, 2.0))
        return np.stack([along, np.zeros_like(along)], axis=1)


def contact_time(state: State, speed: NDArray[np.float64], horizon: float) -> NDArray[np.float64]:
    """Return when the two come within the margin if both go on so [s], float64[B]; infinity: not within the horizon."""
    x, y, heading = (state[name].copy() for name in ("vehicle_x", "vehicle_y", "vehicle_heading"))
    px, py = state["pedestrian_x"].copy(), state["pedestrian_y"].copy()
    turning = state["vehicle_curvature"] * state["vehicle_speed"]
    found, step = np.full(len(state), np.inf), 0.1
    for number in range(round(horizon / step)):
        cos, sin = np.cos(heading), np.sin(heading)
        forward, left = cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x)
        met = (abs(forward) < _LENGTH) & (abs(left) < _WIDTH) & np.isinf(found)
        found[met] = number * step
        heading = heading + turning * step
        x, y = x + speed * step * np.cos(heading), y + speed * step * np.sin(heading)
        px, py = px + state["pedestrian_vx"] * step, py + state["pedestrian_vy"] * step
    return found


def drive(exam: Exam, keys: list[Key], *, learn: bool) -> Driven:
    """Return what the driver made of these episodes; lessons only where somebody is to learn from them."""
    loop, driver = loop_with(exam, PEDESTRIAN, "external", keys, _BATCH), LateDriver()

    def ticks() -> Iterator[Step]:
        while not loop.world.done:
            yield loop.step(Actions(vehicle=driver.act(loop.world.now.state)))

    failed, whole = set[Key](), list[Episode]()
    for episode in ended_episodes(ticks(), exam.world.tick, exam.scenarios):
        if episode.outcome == "collision" and episode.speed[-1] > MOVING:
            failed.add(episode.key)
        whole += [episode] if learn else []
    return Driven(keys, np.array([key in failed for key in keys]), *lessons(whole, 1))


def measure(seed: int, size: int, budget: int) -> dict[str, Any]:
    """Return what the search makes of one pool, beside the truth."""
    exam = prepare(read_sections(params_path("ads_test"), [f"world_simulator.seed={seed}"]))
    pool = [(scenario, number) for number in range(size // len(exam.run.scenarios)) for scenario in exam.run.scenarios]
    truth = drive(exam, pool, learn=False).failed
    begun = time.monotonic()
    search = SearchConfig(PEDESTRIAN, size, budget)
    plan = seek(exam, search, pool, lambda _, keys: drive(exam, keys, learn=True), lambda *_: None)
    count, driven = plan.count(), int(plan.driven.sum())
    if (plan.failed[plan.driven] != truth[plan.driven]).any():
        raise SystemExit(f"pool {seed}: an episode came out otherwise when it was driven again")
    return {
        "seed": seed,
        "truth": int(truth.sum()),
        "found": int(plan.failed.sum()),
        "at_random": driven * float(truth.mean()),
        "driven": driven,
        "count": count._asdict(),
        "plain": plain(count, driven),
        "seconds": time.monotonic() - begun,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pools", type=int, default=5, help="pools, each by a seed of its own")
    parser.add_argument("--size", type=int, default=20_000, help="episodes of a pool")
    parser.add_argument("--budget", type=int, default=1000, help="episodes that the search drives")
    parser.add_argument("--seed", type=int, default=1000, help="seed of the first pool")
    parser.add_argument("-o", type=Path, help="write the results there as JSON, too")
    arguments = parser.parse_args()
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    print(f"{machine}; load {os.getloadavg()[0]:.1f}; {software_versions()}")
    print(
        f"{'seed':>6} {'truth':>6} {'found':>6} {'random':>7} {'count':>22} {'as narrow at random':>20} {'saving':>7}"
    )
    rows = []
    for seed in range(arguments.seed, arguments.seed + arguments.pools):
        rows.append(row := measure(seed, arguments.size, arguments.budget))
        count = row["count"]
        interval = f"{count['failures']:.0f} [{count['failures_low']:.0f}, {count['failures_high']:.0f}]"
        print(
            f"{seed:>6} {row['truth']:>6} {row['found']:>6} {row['at_random']:>7.1f} {interval:>22}"
            f" {row['plain']['episodes']:>20,.0f} {row['plain']['saving']:>7.1f}",
            flush=True,
        )
    covered = sum(row["count"]["failures_low"] <= row["truth"] <= row["count"]["failures_high"] for row in rows)
    rate = sum(row["truth"] for row in rows) / (arguments.size * len(rows))
    nominal = sum(row["count"]["rate_low"] <= rate <= row["count"]["rate_high"] for row in rows)
    low, high = wilson_interval(covered, len(rows))
    print(
        f"{covered} of {len(rows)} intervals cover the pool's count (share {low:.2f} to {high:.2f}), {nominal} the "
        f"failure rate of {rate:.3%}; median saving {np.median([row['plain']['saving'] for row in rows]):.1f}"
    )
    if arguments.o:
        document = {"machine": machine, "software": software_versions(), "rows": rows}
        arguments.o.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
