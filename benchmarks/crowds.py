"""Do generated pedestrians behave among each other as recorded ones do? Measured alike around one moving car.

    python benchmarks/crowds.py FOLDER[:FORMAT] ... [--episodes 40] [--pedestrians 4] [--weights refined]
                                     [--seed 7] [--set NAME=VALUE ...]

A scene is a car that moves, once a second, with two to eight pedestrians within ten metres of it. Recorded: folders of
a format that `vpsci import` reads as clips of tracks (vci-dut, vci-citr). Generated: episodes of all scenarios.
Intervals (95%) come from resampling whole clips, or episodes. `--set` changes the world's parameters. Two minutes.
"""

import argparse
from collections.abc import Callable, Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from vpsci_ros.data.importers.importer import Clip
from vpsci_ros.data.importers.vci import FRAME_RATES, read_folder
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.parameters import build
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop

Floats = NDArray[np.float64]
NEAR = 10.0  # [m] from the car's centre
MOVING, STANDING = 0.5, 0.3  # [m/s] of the car at least, of a pedestrian who waits at most
MOST = 8
ALIKE = np.cos(np.radians(45.0))  # of the angle between two who walk in the same direction
EVERY = 10  # steps of 0.1 s from one scene to the next


def scene(people: Floats) -> dict[str, list[float]]:
    """Return what is measured of float64[n, 4], the x, y [m], vx, vy [m/s] of pedestrians around a car."""
    pace = np.hypot(people[:, 2], people[:, 3])
    walks = pace >= STANDING
    found: dict[str, list[float]] = {"waiting": (~walks).astype(float).tolist(), "pace": pace[walks].tolist()}
    apart = np.hypot(*(people[:, None, :2] - people[None, :, :2]).transpose(2, 0, 1)) + np.diag(
        np.full(len(pace), np.inf)
    )
    found["gap"] = apart.min(axis=1).tolist()
    if walks.sum() >= 2:
        found["spread"] = [float(pace[walks].std(ddof=1))]
    for i, j in combinations(np.flatnonzero(walks), 2):
        cosine = float(people[i, 2:] @ people[j, 2:] / (pace[i] * pace[j]))
        found.setdefault("same", []).append(float(cosine > ALIKE))
        found.setdefault("opposite", []).append(float(cosine < -ALIKE))
        if cosine > ALIKE and apart[i, j] < 2.0:
            found.setdefault("beside", []).append(abs(float(pace[i] - pace[j])))
    return found


def recorded(clips: Iterator[Clip]) -> Iterator[tuple[str, dict[str, list[float]]]]:
    """Yield the scenes of clips, each with the clip's name."""
    for clip in clips:
        for car in clip.vehicles:
            for k in range(car.first, car.last + 1, EVERY):
                at = k - car.first
                if car.values["speed"][at] <= MOVING:
                    continue
                there = [track for track in clip.pedestrians if track.first <= k <= track.last]
                people = np.array(
                    [[track.values[name][k - track.first] for name in ("x", "y", "vx", "vy")] for track in there]
                ).reshape(-1, 4)
                place = np.array([car.values["x"][at], car.values["y"][at]])
                people = people[np.hypot(*(people[:, :2] - place).T) < NEAR]
                if 2 <= len(people) <= MOST:
                    yield clip.name, scene(people)


def generated(
    config: WorldConfig, episodes: int, weights: str, seed: int
) -> Iterator[tuple[str, dict[str, list[float]]]]:
    """Yield the scenes of simulated episodes, each with the episode's name."""
    queue = [(scenario, number) for number in range(episodes) for scenario in range(1, 9)]
    world = World(config, load_scenarios(range(1, 9)), queue, 64, seed)
    every = EVERY * round(0.1 / config.tick)
    for step in Loop(world, agents=policies(load_policy(weights), world)):
        state = step.tick.state.reshape(-1, config.pedestrians)
        for slots in state[(state["status"][:, 0] == RUNNING) & (state["frame"][:, 0] % every == 0)]:
            if slots["vehicle_speed"][0] <= MOVING:
                continue
            rows = slots[slots["status"] == RUNNING]
            away = np.hypot(rows["pedestrian_x"] - rows["vehicle_x"], rows["pedestrian_y"] - rows["vehicle_y"])
            names = [f"pedestrian_{name}" for name in ("x", "y", "vx", "vy")]
            people = np.array([rows[name] for name in names]).T[away < NEAR]
            if len(people) >= 2:
                yield f"{rows['scenario'][0]}:{rows['episode'][0]}", scene(people)


def mean(values: Floats, counts: Floats) -> Floats:
    """Return the means of float64[n] in resamples, float64[count], that take each value so many times."""
    return np.asarray((counts @ values) / counts.sum(axis=-1))


def median(values: Floats, counts: Floats) -> Floats:
    """Return the medians of float64[n] in resamples, likewise."""
    order = np.argsort(values)
    passed = np.cumsum(counts[..., order], axis=-1)
    return np.asarray(values[order][(passed >= 0.5 * passed[..., -1:]).argmax(axis=-1)])


MEASURES: dict[str, tuple[str, str, Callable[[Floats, Floats], Floats]]] = {
    "pedestrians who stand, share": ("waiting", "", mean),
    "to the nearest other one, median": ("gap", "m", median),
    "pace of those who walk, median": ("pace", "m/s", median),
    "standard deviation of the paces of a scene, median": ("spread", "m/s", median),
    "pairs in the same direction, share": ("same", "", mean),
    "pairs in opposite directions, share": ("opposite", "", mean),
    "difference of pace of neighbours (2 m), median": ("beside", "m/s", median),
}


def table(scenes: list[tuple[str, dict[str, list[float]]]], seed: int) -> dict[str, str]:
    """Return each measure with its interval and n, in words."""
    found = {}
    for title, (key, _, statistic) in MEASURES.items():
        values = np.array([value for _, each in scenes for value in each.get(key, [])])
        owners = np.array([name for name, each in scenes for _ in each.get(key, [])])
        if not len(values):
            found[title] = "-"
            continue
        low, high = interval(statistic(values, cluster_counts(owners, seed)))
        here = float(statistic(values, np.ones(len(values))))
        found[title] = f"{here:.2f} ({low:.2f} to {high:.2f}; n = {len(values)})"
    return found


def main() -> None:
    """Measure and print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", help="clips, as FOLDER:FORMAT")
    parser.add_argument("--episodes", type=int, default=40, help="of each scenario")
    parser.add_argument("--pedestrians", type=int, default=4)
    parser.add_argument("--weights", default="people")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--set", action="append", default=[], help="a parameter of the world, NAME=VALUE")
    options = parser.parse_args()
    values = dict(each.split("=", 1) for each in options.set)
    chosen = {name: yaml.safe_load(value) for name, value in values.items()}
    config = build(WorldConfig, {"pedestrians": options.pedestrians} | chosen, "--set")
    columns: dict[str, dict[str, str]] = {}
    for item in options.folders:
        folder, _, form = item.partition(":")
        form = form or Path(folder).name.replace("_", "-")
        if form not in FRAME_RATES:
            parser.error(f"{item}: expected a format of {', '.join(FRAME_RATES)}")
        scenes = list(recorded(read_folder(Path(folder), form)))
        title = f"{form}, {len({name for name, _ in scenes})} clips, {len(scenes)} scenes"
        columns[title] = table(scenes, options.seed)
    scenes = list(generated(config, options.episodes, options.weights, options.seed))
    columns[f"generated, {len({name for name, _ in scenes})} episodes, {len(scenes)} scenes"] = table(
        scenes, options.seed
    )
    print("| | unit | " + " | ".join(columns) + " |")
    print("|---|---|" + "---|" * len(columns))
    for title, (_, unit, _) in MEASURES.items():
        print(f"| {title} | {unit} | " + " | ".join(column[title] for column in columns.values()) + " |")


if __name__ == "__main__":
    main()
