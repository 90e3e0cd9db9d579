"""Episodes read from what this package leaves behind: the folder of a dataset, a bag, or the folder of an exam."""

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import bag_files
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.dataset_index import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.export.episode import Episode, Motion, motion
from vpsci_ros.world import ENDED, OUTCOME_NAMES, RUNNING, Scenario, load_scenario
from vpsci_ros.world.sharing import episode_rows

_EXAM = "exam.json"
_ALONE = "alone"  # of an exam's runs the one without a pedestrian
_ODOMETRY = 0  # number of the scenario of a bag that holds odometry alone


def read_episodes(source: str | Path) -> Iterator[Episode]:
    """Yield the episodes of a dataset (kept ones), of a bag (those that ended in it) or of an exam (of every run).

    Episodes of an exam have the pedestrian's name before their own: "learned_LocationA_PedCross_S-N_000012".

    :raises InvalidInput: none of these, or one that is damaged.
    """
    source = Path(source)
    if (source / DESCRIPTION).is_file():
        yield from _of_dataset(source)
    elif (source / _EXAM).is_file():
        runs = [path for path in sorted((source / "runs").glob("*/bag")) if path.parent.name != _ALONE]
        if not runs:
            raise InvalidInput(f"{source}: an exam without a finished run; let it come to its end")
        for bag in runs:
            for episode in _of_bag(bag):
                yield dataclasses.replace(episode, name=f"{bag.parent.name}_{episode.name}")
    else:
        _require_bag(source)
        yield from _of_bag(source)


def _require_bag(source: Path) -> None:
    try:
        bag_files(source)
    except InvalidInput as error:
        raise InvalidInput(
            f"{source}: expected the folder of a dataset ({DESCRIPTION}), of an exam ({_EXAM}) or a bag; {error}"
        ) from None


def _of_dataset(folder: Path) -> Iterator[Episode]:
    dataset = Dataset(folder)
    outcomes = {(row[0], row[1]): row[2] for row in dataset.index().select("scenario", "count", "outcome").rows()}
    for name, counts in dataset.scenarios.items():
        if not counts["kept"]:
            continue
        road = _scenario(name)
        for arrays in dataset.episodes(name):
            for rows in np.split(np.arange(len(arrays.count)), arrays.first[1:]):
                count, frames = int(arrays.count[rows[0]]), arrays.lengths[rows[0]]
                columns = arrays.values[rows, :frames].astype(np.float64).transpose(0, 2, 1)
                label = f"{name}_{count:06d}"
                yield Episode(
                    name=label,
                    number=count,
                    scenario=road,
                    period=dataset.period,
                    outcome=outcomes[counts["number"], count],
                    vehicle=motion(columns[0, :4], f"{folder}: vehicle of {label}"),
                    pedestrians=tuple(motion(each[4:8], f"{folder}: pedestrian of {label}") for each in columns),
                    curvttc=columns[:, 9].min(axis=0),
                )


def _of_bag(bag: Path) -> Iterator[Episode]:
    """Yield the episodes of a bag as they end; an episode whose beginning was not recorded begins where it does."""
    frames: dict[tuple[int, int], list[tuple[NDArray[np.void], float]]] = {}
    ended = 0
    for tick in read_bag(bag):
        for rows in episode_rows(tick.state):
            record = tick.state[rows[0]]
            key = int(record["scenario"]), int(record["episode"])
            if record["status"] == RUNNING or key in frames:
                frames.setdefault(key, []).append((tick.state[rows], float(tick.curvttc[rows].min())))
            if record["status"] == ENDED and key in frames:
                ended += 1
                yield _from_records(bag, *key, tick.period, frames.pop(key))
    if not ended:
        raise InvalidInput(f"{bag}: no episode ended while it was recorded")


def _from_records(
    bag: Path, scenario: int, number: int, period: float, rows: list[tuple[NDArray[np.void], float]]
) -> Episode:
    people: Any = np.array([records for records, _ in rows])
    state = people[:, 0]
    road = None if scenario == _ODOMETRY else _scenario(scenario)
    label = f"{road.name if road else 'odometry'}_{number:06d}"
    heading, speed = np.unwrap(state["vehicle_heading"]), state["vehicle_speed"]
    vehicle = Motion(state["vehicle_x"], state["vehicle_y"], heading, speed * np.cos(heading), speed * np.sin(heading))
    columns = np.stack([people[f"pedestrian_{name}"] for name in ("x", "y", "vx", "vy")])
    return Episode(
        name=label,
        number=number,
        scenario=road,
        period=period,
        outcome=OUTCOME_NAMES[int(state["outcome"][-1])],
        vehicle=vehicle,
        pedestrians=tuple(motion(each, f"{bag}: pedestrian of {label}") for each in columns.transpose(2, 0, 1)),
        curvttc=np.array([curvttc for _, curvttc in rows]),
    )


@functools.cache
def _scenario(which: int | str) -> Scenario:
    return load_scenario(which)
