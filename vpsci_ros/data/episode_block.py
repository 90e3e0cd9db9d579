"""Episodes that run side by side, collected frame by frame, and blocks of those that have ended.

The ticks come from a `World` in this process, from messages of a running graph, or from a bag. The collector's memory
is one buffer for the running episodes and for the ended episodes that were not taken yet.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.compiled import kernel
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
KEPT = 0
REASONS = (
    "kept",
    "not critical",  # (1) CurvTTC never below 5 s
    "velocities missing",  # (2) ten frames in a row or more without them
    "too short",  # (3) fewer than 100 frames
    "vehicle hardly moved",  # (4) 10 m or less from the first to the last frame
    "pedestrian hardly moved",  # (4) 4 m or less
)
JUDGED = np.dtype(
    [
        ("scenario", np.uint8),
        ("count", np.int64),  # number within the scenario
        ("outcome", np.uint8),  # of `vpsci_ros.world.state`
        ("failed", np.bool_, len(REASONS) - 1),  # the conditions `REASONS[1:]`, each on its own
        ("reason", np.uint8),  # index into `REASONS` of the first that fails in the paper's order, `KEPT` for none
        ("frames", np.int64),  # from the spawn to the end, both included
        ("pedestrians", np.int64),
        ("rows", np.int64),  # of the episode that are stored: a row a frame and pedestrian, or none
        ("least_curvttc", np.float32),  # [s] of all pairs
        ("vehicle_path", np.float64),  # [m] length of the trajectory, of the pair that decides
        ("pedestrian_path", np.float64),  # [m]
        ("range", np.uint8),  # index into `RANGES`
    ]
)
"""The record of an ended episode; `apply_filters` sets `failed`, `reason`, `least_curvttc` and both paths."""
RANGES = ("", "within", "beyond")  # "": no recorded people act, or they are not known, or it is never critical

_SLOT = np.dtype([("episode", "i8"), ("place", "i8"), ("scenario", "u1"), ("open", "?")], align=True)
_PLACE = np.dtype(
    [("episode", "i8"), ("frames", "i8"), ("scenario", "u1"), ("outcome", "u1"), ("pedestrian", "u1")], align=True
)


@dataclass(frozen=True)
class EpisodeBlock:
    """A block of n episodes as arrays.

    :ivar records: JUDGED[n].
    :ivar values: float32[rows, 10], `QUANTITIES` in map frame [m, m/s, s] of the episodes that are stored, one after
        the other, and in each one pedestrian after the other; NaN in frames that nobody saw.
    """

    records: NDArray[np.void]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.records)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return np.asarray(self.records["reason"] == KEPT)

    def only(self, chosen: NDArray[np.bool_]) -> "EpisodeBlock":
        """Return the episodes where `chosen`, bool[n], is true."""
        return EpisodeBlock(self.records[chosen], self.values[np.repeat(chosen, self.records["rows"])])

    def first_critical(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first row with CurvTTC < 5 s of each pair that has one: episode and row, int64[m] each."""
        several, critical = self.records["pedestrians"], self.values[:, QUANTITIES.index("CurvTTC")] < CRITICAL_TTC
        ends = np.cumsum(np.repeat(self.records["frames"], several))
        rows = np.append(np.flatnonzero(critical), len(critical))
        first = rows[np.searchsorted(rows, ends - np.repeat(self.records["frames"], several))]
        found = first < ends
        return np.repeat(np.arange(len(self)), several)[found], first[found]

    def stored(self, keep_rejected: bool) -> "EpisodeBlock":
        """Return the episodes; those that are rejected lose their rows, unless `keep_rejected`."""
        stored, records = self.kept | keep_rejected, self.records.copy()
        records["rows"] = np.where(stored, records["rows"], 0)
        return EpisodeBlock(records, self.values[np.repeat(stored, self.records["rows"])])


def concat_blocks(blocks: Sequence[EpisodeBlock]) -> EpisodeBlock:
    """Return the episodes of several blocks as one, in the order of their scenarios and numbers."""
    records = np.concatenate([np.zeros(0, JUDGED), *(block.records for block in blocks)])
    values = np.concatenate([np.zeros((0, len(QUANTITIES)), np.float32), *(block.values for block in blocks)])
    order, ends = np.lexsort((records["count"], records["scenario"])), np.cumsum(records["rows"])
    if (order == np.arange(len(order))).all():
        return EpisodeBlock(records, values)
    rows = np.split(values, ends[:-1])
    return EpisodeBlock(records[order], np.concatenate([rows[i] for i in order]))


class EpisodeFrames:
    """Collects the frames of `batch` parallel episodes, one tick at a time.

    The frames of an episode are written once, to a place of its own, and stay there until they are taken.

    :param frames: room for so many frames an episode at first; it grows by itself.
    :param waiting: room for so many ended episodes that are not taken yet; it grows by itself.
    """

    def __init__(self, batch: int, frames: int = 256, waiting: int = 0) -> None:
        self._batch = batch
        self._values: NDArray[np.float32] = np.full((batch + waiting, frames, len(QUANTITIES)), np.nan, np.float32)
        self._slots, self._places = np.zeros(batch, _SLOT), np.zeros(batch + waiting, _PLACE)
        self._slots["episode"] = -1  # no episode has this number
        self._free, self._ended = np.arange(batch + waiting), np.zeros(batch + waiting, np.int64)
        self._counts = np.array([batch + waiting, 0, 0])  # of `_free`, of `_ended`, of episodes broken off

    @property
    def unfinished(self) -> int:
        """Number of episodes whose end was not seen: still running, or replaced by another episode in their slot."""
        return int(self._slots["open"].sum() + self._counts[2])

    def add(self, state: NDArray[np.void], curvttc: NDArray[np.float64], distance: NDArray[np.float64]) -> EpisodeBlock:
        """Process one tick and return the episodes that end at it (usually none); see `store`."""
        self.store(state, curvttc, distance)
        return self.take()

    def store(self, state: NDArray[np.void], curvttc: NDArray[np.float64], distance: NDArray[np.float64]) -> int:
        """Process one tick and return how many ended episodes `take` would return.

        :param state: EPISODE[batch] records of the tick; an ended one counts once, however often it is shown.
        :param curvttc: float64[batch] [s], `distance`: float64[batch] [m], of the same tick.
        :raises InvalidInput: arrays that are not of the collector's batch.
        """
        if not len(state) == len(curvttc) == len(distance) == self._batch:
            raise InvalidInput(
                f"expected {self._batch} parallel episodes, got {len(state)} states, {len(curvttc)} CurvTTC and "
                f"{len(distance)} distances; one collector serves one batch size"
            )
        self._make_room(int(self._counts[1]) + self._batch, int(state["frame"].max(initial=0)) + 1)
        _store(state, curvttc, distance, self._slots, self._places, self._values, self._free, self._ended, self._counts)
        return int(self._counts[1])

    def take(self) -> EpisodeBlock:
        """Return the ended episodes that were not returned yet, in the order of their ends."""
        free, count, _ = self._counts.tolist()
        places = self._ended[:count]
        of, first = self._places[places], np.flatnonzero(self._places["pedestrian"][places] == 0)
        records = np.zeros(len(first), JUDGED)
        for name, own in (("scenario", "scenario"), ("count", "episode"), ("outcome", "outcome"), ("frames", "frames")):
            records[name] = of[own][first]
        records["pedestrians"] = np.diff(np.append(first, count))
        records["rows"] = records["frames"] * records["pedestrians"]
        there = np.arange(of["frames"].max(initial=0)) < of["frames"][:, None]
        self._free[free : free + count] = places
        self._counts[:2] = free + count, 0
        return EpisodeBlock(records, self._values[places, : there.shape[1]][there])

    def _make_room(self, places: int, frames: int) -> None:
        """Grow the buffer to at least so many places, and so many frames in each place."""
        before, room, width = self._values.shape
        if places <= before and frames <= room:
            return
        shape = max(places, before), room if frames <= room else max(frames, 2 * room)
        values = np.full((*shape, width), np.nan, np.float32)
        values[:before, :room] = self._values
        more = np.arange(before, shape[0])
        self._free = np.concatenate([self._free[: self._counts[0]], more, self._free[self._counts[0] :]])
        self._counts[0] += len(more)
        self._ended = np.concatenate([self._ended, more])
        self._places = np.concatenate([self._places, np.zeros(len(more), _PLACE)])
        self._values = values


@kernel
def _store(state, curvttc, distance, slots, places, values, free, ended, counts):  # type: ignore[no-untyped-def]
    """Copy one tick to the places of its episodes; give a place to each new episode, and list the ended ones."""
    for i in range(state.size):
        record, slot = state[i], slots[i]
        if record.status == IDLE:
            continue
        if record.episode != slot.episode or record.scenario != slot.scenario:
            if slot.open:
                counts[2] += 1
            else:
                counts[0] -= 1
                slot.place = free[counts[0]]
            place = places[slot.place]
            for f in range(place.frames):
                for k in range(values.shape[2]):
                    values[slot.place, f, k] = np.nan
            place.scenario, place.episode, place.pedestrian, place.frames = (
                record.scenario, record.episode, record.pedestrian, 0,
            )  # fmt: skip
            slot.scenario, slot.episode, slot.open = record.scenario, record.episode, True
        elif not slot.open:
            continue
        place, row = places[slot.place], values[slot.place, record.frame]
        # the vehicle moves along its heading, so that is where its velocity points
        row[0], row[1] = record.vehicle_x, record.vehicle_y
        row[2] = record.vehicle_speed * math.cos(record.vehicle_heading)
        row[3] = record.vehicle_speed * math.sin(record.vehicle_heading)
        row[4], row[5] = record.pedestrian_x, record.pedestrian_y
        row[6], row[7] = record.pedestrian_vx, record.pedestrian_vy
        row[8], row[9] = distance[i], curvttc[i]
        place.frames = max(place.frames, record.frame + 1)
        if record.status == ENDED:
            place.outcome, slot.open = record.outcome, False
            ended[counts[1]] = slot.place
            counts[1] += 1
