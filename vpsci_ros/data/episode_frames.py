"""Episodes gathered frame by frame while thousands of them run side by side, and given out whole as they end.

The collector does not care where a tick comes from: a `World` in this process, messages of a running graph, or a bag.
Its memory is one buffer of `batch` episodes, whatever the length of the run.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import ENDED, IDLE

QUANTITIES = (
    "position_x_av",
    "position_y_av",
    "velocity_x_av",
    "velocity_y_av",
    "position_x_ped",
    "position_y_ped",
    "velocity_x_ped",
    "velocity_y_ped",
    "distance",
    "CurvTTC",
)
NOT_OPEN = np.iinfo(np.int64).max
Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class EpisodeBatch:
    """Episodes that ended, whole: an entry each, or of several pedestrians one each, one after the other.

    :ivar scenario: uint8[n], numbers of scenarios.
    :ivar episode: int64[n], number within the scenario.
    :ivar outcome: uint8[n], COLLISION, GOAL or TIMEOUT of `vpsci_ros.world.state`.
    :ivar frames: int64[n], frames from the spawn to the end, both included.
    :ivar values: float32[n, F, 10], `QUANTITIES` in map frame [m, m/s, s]; frames that nobody saw, and those after the
        last one, are NaN.
    :ivar open_from: int64[256], by scenario the lowest number of an episode that still runs, `NOT_OPEN` for none.
        Episodes enter in the order of their numbers, so whatever lies below has ended. Zeros in an empty batch.
    """

    scenario: NDArray[np.uint8]
    episode: NDArray[np.int64]
    outcome: NDArray[np.uint8]
    frames: NDArray[np.int64]
    values: Floats32
    open_from: NDArray[np.int64]
    pedestrian: NDArray[np.uint8] | None = None  # [n], number within the episode; None: there is one in each

    def __len__(self) -> int:
        return len(self.episode)

    @property
    def first(self) -> NDArray[np.int64]:
        """Return the entry of the first pedestrian of each of m episodes, int64[m]."""
        return np.arange(len(self)) if self.pedestrian is None else np.flatnonzero(self.pedestrian == 0)

    @property
    def pedestrians(self) -> NDArray[np.int64]:
        """Return how many pedestrians each of m episodes has, int64[m]."""
        return np.diff(np.append(self.first, len(self)))


class EpisodeFrames:
    """Collector of `batch` parallel episodes.

    :param frames: room for so many frames an episode at first; it grows by itself.
    """

    def __init__(self, batch: int, frames: int = 256) -> None:
        self._values: Floats32 = np.full((batch, frames, len(QUANTITIES)), np.nan, np.float32)
        self._scenario = np.zeros(batch, np.uint8)
        self._episode = np.full(batch, -1, np.int64)  # no episode has this number
        self._open = np.zeros(batch, bool)
        self._used = np.zeros(batch, np.int64)
        self.broken_off = 0

    @property
    def unfinished(self) -> int:
        """Episodes seen so far of which the end is not (yet) seen: still running, or broken off by another one."""
        return int(self._open.sum()) + self.broken_off

    def add(self, state: NDArray[np.void], curvttc: NDArray[np.float64], distance: NDArray[np.float64]) -> EpisodeBatch:
        """Take one tick and return the episodes that end with it (none, usually).

        :param state: EPISODE[batch] records of the tick; an ended one counts once, however often it is shown.
        :param curvttc: float64[batch] [s], `distance`: float64[batch] [m], of the same tick.
        :raises InvalidInput: arrays that are not of the collector's batch.
        """
        if not len(state) == len(curvttc) == len(distance) == len(self._open):
            raise InvalidInput(
                f"expected {len(self._open)} parallel episodes, got {len(state)} states, {len(curvttc)} CurvTTC and "
                f"{len(distance)} distances; one collector serves one batch size"
            )
        self._make_room(int(state["frame"].max(initial=0)) + 1)
        finished, broken_off = _store(
            state, curvttc, distance, self._scenario, self._episode, self._open, self._used, self._values
        )
        self.broken_off += broken_off
        return self._give(np.flatnonzero(finished), state)

    def _make_room(self, frames: int) -> None:
        batch, room, width = self._values.shape
        if frames > room:
            more = np.full((batch, max(frames - room, room), width), np.nan, np.float32)
            self._values = np.concatenate([self._values, more], axis=1)

    def _give(self, slots: NDArray[np.int64], state: NDArray[np.void]) -> EpisodeBatch:
        open_from = np.zeros(256, np.int64)
        if len(slots):
            open_from[:] = NOT_OPEN
            np.minimum.at(open_from, self._scenario[self._open], self._episode[self._open])
        used = self._used[slots]
        return EpisodeBatch(
            self._scenario[slots],
            self._episode[slots],
            state["outcome"][slots],
            used,
            self._values[slots, : used.max(initial=0)],
            open_from,
            state["pedestrian"][slots],
        )


@njit(cache=True)
def _store(state, curvttc, distance, scenario, episode, is_open, used, values):  # type: ignore[no-untyped-def]
    """Put one tick into the buffer; return which slots' episodes end (bool[B]) and how many were broken off."""
    finished = np.zeros(len(state), np.bool_)
    broken_off = 0
    for i in range(len(state)):
        record = state[i]
        if record.status == IDLE:
            continue
        if record.episode != episode[i] or record.scenario != scenario[i]:
            broken_off += is_open[i]
            values[i, : used[i]] = np.nan
            scenario[i], episode[i], is_open[i], used[i] = record.scenario, record.episode, True, 0
        elif not is_open[i]:
            continue
        row = values[i, record.frame]
        # the vehicle moves along its heading, so that is where its velocity points
        row[0], row[1] = record.vehicle_x, record.vehicle_y
        row[2] = record.vehicle_speed * math.cos(record.vehicle_heading)
        row[3] = record.vehicle_speed * math.sin(record.vehicle_heading)
        row[4], row[5] = record.pedestrian_x, record.pedestrian_y
        row[6], row[7] = record.pedestrian_vx, record.pedestrian_vy
        row[8], row[9] = distance[i], curvttc[i]
        used[i] = max(used[i], record.frame + 1)
        if record.status == ENDED:
            finished[i] = True
            is_open[i] = False
    return finished, broken_off
