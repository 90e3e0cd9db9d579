"""Episodes collected from the ticks of a world, a bag or a running graph, each yielded when it ends."""

from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode, Floats, Key, Listed, filled
from vpsci_ros.world import Scenario
from vpsci_ros.world.state import ENDED, IDLE, OUTCOME_NAMES, RUNNING
from vpsci_ros.world.tick import Step

NO_SCENARIO = 0  # number that stands for none: of a bag that holds odometry alone
_FIELDS = ("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature",
           "pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy", "controlled")  # fmt: skip


class RecordedTick(NamedTuple):
    """The world and the safety monitor's answer at one tick; NaN where the bag has no answer."""

    number: int
    period: float  # [s] from one tick to the next
    state: NDArray[np.void]  # EPISODE[B]; fields that the message does not carry are 0
    curvttc: Floats  # [B] [s]
    distance: Floats  # [B] [m]
    time: int = 0  # [ns] log time in the bag


SeenTick = Step | RecordedTick
"""A tick of the loop, or of a bag."""


def gathered(
    ticks: Iterable[SeenTick],
    period: float,
    scenarios: Iterable[Scenario],
    *,
    wanted: Collection[Key] | None = None,
    source: str = "",
) -> Iterator[Episode]:
    """Yield episodes as they end; an episode whose beginning was not seen starts at its first seen tick.

    :param period: time from one tick to the next [s].
    :param scenarios: those that may occur, found by their numbers.
    :param wanted: only these episodes; no tick is taken after the last of them has ended.
    """
    roads = {scenario.number: scenario for scenario in scenarios}
    frames: dict[Key, list[tuple[int, Floats]]] = {}
    left = None if wanted is None else set(wanted)
    for tick in ticks:
        state = tick.state
        columns = [*(state[name].astype(np.float64) for name in _FIELDS), tick.curvttc, tick.distance]
        values = np.stack(columns, axis=1)
        for rows in episode_rows(state):
            record = state[rows[0]]
            key = int(record["scenario"]), int(record["episode"])
            if left is not None and key not in left:
                continue
            if record["status"] == RUNNING or key in frames:
                frames.setdefault(key, []).append((int(record["frame"]), values[rows]))
            if record["status"] == ENDED and key in frames:
                outcome = OUTCOME_NAMES[int(record["outcome"])]
                yield _episode(key, roads.get(key[0]), outcome, period, frames.pop(key), source)
                if left is not None:
                    left.remove(key)
        if left is not None and not left:
            return


def episode_rows(state: NDArray[np.void]) -> list[NDArray[np.int64]]:
    """Return the row indices of each episode in EPISODE[B], its first pedestrian's first; idle rows are left out."""
    rows = np.flatnonzero(state["status"] != IDLE)
    return np.split(rows, np.flatnonzero(state["pedestrian"][rows] == 0)[1:]) if len(rows) else []


def group_of(number: int, scenario: Scenario | None) -> str:
    """Return the name of a scenario, or a placeholder if it is unknown."""
    return scenario.name if scenario else "odometry" if number == NO_SCENARIO else f"scenario_{number}"


def _episode(
    key: Key, scenario: Scenario | None, outcome: str, period: float, seen: list[tuple[int, Floats]], source: str
) -> Episode:
    """Return an episode of the rows float64[n, 12] of the frames that were seen; NaN in the others."""
    frame = np.array([number for number, _ in seen])
    values = np.full((np.ptp(frame) + 1, *seen[0][1].shape), np.nan)
    values[frame - frame.min()] = [rows for _, rows in seen]
    x, y, heading, speed, curvature, px, py, vx, vy, controlled, curvttc, distance = np.ascontiguousarray(values.T)
    least = float(np.nan_to_num(curvttc, nan=np.inf, posinf=np.inf).min())
    listed = Listed(f"{key[0]}:{key[1]}", group_of(key[0], scenario), *key, outcome, least)
    vehicle = x[0], y[0], np.unwrap(filled(heading[0])), speed[0], curvature[0]
    walk = px, py, vx, vy, curvttc, distance, controlled == 1.0
    return Episode(source, listed, scenario, period, *vehicle, *walk)
