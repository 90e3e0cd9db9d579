"""Episodes that run side by side, collected frame by frame, and blocks of those that have ended.

The ticks come from a `World` in this process, from messages of a running graph, or from a bag. The collector's memory
is one buffer for the running episodes and for the ended episodes that were not taken yet.
"""

import itertools
import math
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vpsci_ros.data.episode import QUANTITIES, Episode, Floats, Key, Listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import Scenario
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.crowd import MOST
from vpsci_ros.world.kinds import KINDS
from vpsci_ros.world.parked import in_sight, parked_from
from vpsci_ros.world.state import ENDED, IDLE, NONE, OUTCOME_NAMES

if TYPE_CHECKING:
    import polars as pl

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
        ("vehicle_path", np.float32),  # [m] length of the trajectory, of the pair that decides
        ("pedestrian_path", np.float32),  # [m]
        ("range", np.uint8),  # index into `RANGES`
        ("kinds", np.uint8, MOST),  # of the pedestrians, indices into `KINDS`
    ]
)
"""The record of an ended episode; `apply_filters` sets `failed`, `reason`, `least_curvttc` and both paths."""
RANGES = ("", "within", "beyond")  # "": no recorded people act, or they are not known, or it is never critical

_SLOT = np.dtype([("episode", "i8"), ("place", "i8"), ("scenario", "u1"), ("open", "?")], align=True)
_PLACE = np.dtype(
    [("episode", "i8"), ("frames", "i8"), ("scenario", "u1"), ("outcome", "u1"), ("pedestrian", "u1"), ("kind", "u1")],
    align=True,
)


class SeenTick(Protocol):
    """A tick of the loop or of a bag."""

    @property
    def state(self) -> NDArray[np.void]:
        """EPISODE[B]."""

    @property
    def curvttc(self) -> Floats:
        """float64[B] [s]; NaN where nobody has computed it."""

    @property
    def distance(self) -> Floats:
        """float64[B] [m] between the centres; NaN likewise."""


@dataclass(frozen=True, repr=False)
class EpisodeBlock:
    """A block of n episodes as arrays; `block[i]` is the i-th as an `Episode`, `len(block)` is n.

    :ivar records: JUDGED[n], a record an episode: `scenario` and `count` (its numbers), `outcome` (index into
        `vpsci_ros.world.OUTCOME_NAMES`), `frames`, `pedestrians`, `least_curvttc` [s], and the filters' `reason`.
    :ivar values: float32 or float64[rows, 15], `QUANTITIES` in map frame [m], [m/s], [s], [rad], [1/m] of the episodes
        that are stored, one after the other, and in each one pedestrian after the other; NaN in frames that nobody saw.
    :ivar period: time from one frame to the next [s]; 0: not known here.
    :ivar scenarios: where the episodes take place; empty: not known here.
    """

    records: NDArray[np.void]
    values: NDArray[np.floating[Any]]
    period: float = 0.0
    scenarios: tuple[Scenario, ...] = ()

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        numbers = ", ".join(map(str, np.unique(self.records["scenario"]).tolist()))
        return f"EpisodeBlock({len(self)} episodes of scenarios {numbers or 'none'})"

    def __getitem__(self, i: int) -> Episode:
        """Return the i-th episode, whose frames must be stored, of a block with `period`; a negative i counts back.

        :raises IndexError: no such episode.
        """
        place = range(len(self))[i]
        return next(self.between(place, place + 1).episodes(self.period, self.scenarios))

    def to_polars(self) -> "pl.DataFrame":
        """Return a row a frame and pedestrian of the stored episodes, with a dataset's columns and `outcome`."""
        import polars as pl  # not before: `vpsci_ros.Pedestrian` does without

        from vpsci_ros.data.dataset_tables import arrow_rows
        from vpsci_ros.data.parquet import as_polars

        outcomes = np.repeat(np.array(OUTCOME_NAMES)[self.records["outcome"]], self.records["rows"])
        return as_polars(arrow_rows(self)).with_columns(pl.Series("outcome", outcomes))

    @cached_property
    def _bounds(self) -> NDArray[np.int64]:
        """First row of each episode, and the number of all rows, int64[n + 1]."""
        return np.append(0, np.cumsum(self.records["rows"]))

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return np.asarray(self.records["reason"] == KEPT)

    def between(self, begin: int, end: int) -> "EpisodeBlock":
        """Return the episodes from the `begin`th to before the `end`th, which share this block's memory."""
        rows = slice(self._bounds[begin], self._bounds[end])
        return replace(self, records=self.records[begin:end], values=self.values[rows])

    def only(self, chosen: NDArray[np.bool_]) -> "EpisodeBlock":
        """Return the episodes where `chosen`, bool[n], is true."""
        return replace(self, records=self.records[chosen], values=self.values[np.repeat(chosen, self.records["rows"])])

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
        if stored.all():
            return self
        return replace(self, records=records, values=self.values[np.repeat(stored, self.records["rows"])])

    @property
    def keys(self) -> list[Key]:
        """Number of the scenario and of the episode, of each."""
        found: list[Key] = self.records[["scenario", "count"]].tolist()
        return found

    def motions(self) -> Iterator[tuple[Key, NDArray[np.floating[Any]]]]:
        """Yield key and values[n, T, 15] of each stored episode."""
        several, bounds = self.records["pedestrians"].tolist(), itertools.pairwise(self._bounds.tolist())
        for key, people, (begin, end) in zip(self.keys, several, bounds, strict=True):
            if begin < end:
                yield key, self.values[begin:end].reshape(people, -1, len(QUANTITIES))

    def without(self, keys: Container[Key]) -> "EpisodeBlock":
        """Return the episodes other than those of these keys."""
        return self.only(np.array([key not in keys for key in self.keys], np.bool_))

    def described(self, scenarios: Iterable[Scenario]) -> Iterator[tuple[Listed, tuple[str, ...], NDArray[Any]]]:
        """Yield metadata, kinds of the pedestrians and values[n, T, 15] of each stored episode.

        :param scenarios: those that may occur, found by their numbers.
        """
        roads = {scenario.number: scenario for scenario in scenarios}
        stored = self.records[self.records["rows"] > 0]
        for (key, values), record in zip(self.motions(), stored, strict=True):
            curvttc = values[..., QUANTITIES.index("CurvTTC")]
            least = float(np.fmin.reduce(curvttc, axis=None, initial=np.inf))
            listed = Listed.simulated(key, roads.get(key[0]), OUTCOME_NAMES[record["outcome"]], least)
            yield listed, tuple(KINDS[kind] for kind in record["kinds"][: len(values)]), values

    def episodes(self, period: float, scenarios: Sequence[Scenario], source: str = "") -> Iterator[Episode]:
        """Yield the stored episodes, see `described`.

        :param period: time from one frame to the next [s].
        :param source: what the episodes come from, the opening of an error message.
        """
        roads = {scenario.number: scenario for scenario in scenarios}
        for listed, kinds, values in self.described(scenarios):
            yield Episode.from_values(source, listed, roads.get(listed.scenario), period, values, kinds=kinds)


def concat_blocks(blocks: Sequence[EpisodeBlock]) -> EpisodeBlock:
    """Return the episodes of several blocks as one, in the order of their scenarios and numbers."""
    records = np.concatenate([np.zeros(0, JUDGED), *(block.records for block in blocks)])
    width = np.zeros((0, len(QUANTITIES)), np.float32)
    values = np.concatenate([width, *(block.values for block in blocks)])
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
    :param floats: type of the values.
    :param scenarios: whose parked vehicles hide pedestrians (`seen`).
    :param broken_off: also return episodes that another one has replaced in their slot, with the outcome "none".
    """

    def __init__(
        self,
        batch: int,
        frames: int = 256,
        waiting: int = 0,
        *,
        floats: DTypeLike = np.float32,
        scenarios: Sequence[Scenario] = (),
        broken_off: bool = False,
    ) -> None:
        self._batch, self._broken_off = batch, broken_off
        self._values = np.empty((batch + waiting, frames, len(QUANTITIES)), floats)
        self._slots, self._places = np.zeros(batch, _SLOT), np.zeros(batch + waiting, _PLACE)
        self._slots["episode"] = -1  # no episode has this number
        self._free, self._ended = np.arange(batch + waiting), np.zeros(batch + waiting, np.int64)
        self._counts = np.array([batch + waiting, 0, 0])  # of `_free`, of `_ended`, of episodes broken off
        self._parked, self._everybody = parked_from(scenarios), np.ones(batch, np.bool_)

    @property
    def unfinished(self) -> int:
        """Number of episodes whose end was not seen: still running, or replaced by another episode in their slot."""
        return int(self._slots["open"].sum() + self._counts[2])

    def add(self, tick: SeenTick) -> EpisodeBlock:
        """Process one tick and return the episodes that end at it (usually none); see `store`."""
        self.store(tick)
        return self.take()

    def store(self, tick: SeenTick) -> int:
        """Process one tick and return how many ended pairs `take` would return.

        An ended episode counts once, however often it is shown; one of which only the end is shown does not count.

        :raises InvalidInput: arrays that are not of the collector's batch.
        """
        state, curvttc, distance = tick.state, tick.curvttc, tick.distance
        if not len(state) == len(curvttc) == len(distance) == self._batch:
            raise InvalidInput(
                f"expected {self._batch} parallel episodes, got {len(state)} states, {len(curvttc)} CurvTTC and "
                f"{len(distance)} distances; one collector serves one batch size"
            )
        room = self._batch * (2 if self._broken_off else 1)
        self._make_room(int(self._counts[1]) + room, int(state["frame"].max(initial=0)) + 1)
        seen = self._everybody if self._parked is None else in_sight(state, self._parked)
        of_tick = state, curvttc, distance, seen
        memory = self._slots, self._places, self._values, self._free, self._ended, self._counts
        _store(*of_tick, *memory, self._broken_off)
        return int(self._counts[1])

    def finish(self) -> None:
        """End the episodes that still run, so that `take` returns them, with the outcome "none"."""
        for slot in self._slots[self._slots["open"]]:
            self._ended[self._counts[1]] = slot["place"]
            self._counts[1] += 1
        self._slots["open"] = False

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
        records["kinds"][np.repeat(np.arange(len(first)), records["pedestrians"]), of["pedestrian"]] = of["kind"]
        parts = [self._values[place, :frames] for place, frames in zip(places, of["frames"], strict=True)]
        values = np.concatenate(parts) if parts else self._values[0, :0]
        self._free[free : free + count] = places
        self._counts[:2] = free + count, 0
        return EpisodeBlock(records, values)

    def _make_room(self, places: int, frames: int) -> None:
        """Grow the buffer to at least so many places, and so many frames in each place."""
        before, room, width = self._values.shape
        if places <= before and frames <= room:
            return
        shape = max(places, before), room if frames <= room else max(frames, 2 * room)
        values = np.empty((*shape, width), self._values.dtype)
        values[:before, :room] = self._values
        more = np.arange(before, shape[0])
        self._free = np.concatenate([self._free[: self._counts[0]], more, self._free[self._counts[0] :]])
        self._counts[0] += len(more)
        self._ended = np.concatenate([self._ended, more])
        self._places = np.concatenate([self._places, np.zeros(len(more), _PLACE)])
        self._values = values


def ended_blocks(
    ticks: Iterable[SeenTick], scenarios: Sequence[Scenario], *, all_: bool = False
) -> Iterator[EpisodeBlock]:
    """Yield the episodes of ticks in float64, those that end at the same tick as one block.

    :param all_: also episodes whose end is not shown.
    """
    frames = None
    for tick in ticks:
        frames = frames or EpisodeFrames(len(tick.state), floats=np.float64, scenarios=scenarios, broken_off=all_)
        if frames.store(tick):
            yield frames.take()
    if frames is not None and all_:
        frames.finish()
        yield frames.take()


def ended_episodes(
    ticks: Iterable[SeenTick], period: float, scenarios: Sequence[Scenario], *, source: str = "", all_: bool = False
) -> Iterator[Episode]:
    """Yield the episodes of ticks in float64, each when it ends; see `ended_blocks` and `EpisodeBlock.episodes`."""
    for block in ended_blocks(ticks, scenarios, all_=all_):
        yield from block.episodes(period, scenarios, source)


@kernel
def _store(state, curvttc, distance, seen, slots, places, values, free, ended, counts, broken_off):  # type: ignore[no-untyped-def] # fmt: skip
    """Copy one tick to the places of its episodes; give a place to each new episode, and list the ended ones."""
    for i in range(state.size):
        record, slot = state[i], slots[i]
        if record.status == IDLE:
            continue
        if record.episode != slot.episode or record.scenario != slot.scenario:
            if slot.open and not broken_off:
                counts[2] += 1
            else:
                if slot.open:
                    ended[counts[1]] = slot.place
                    counts[1] += 1
                counts[0] -= 1
                slot.place = free[counts[0]]
            slot.scenario, slot.episode, slot.open = record.scenario, record.episode, True
            place = places[slot.place]
            place.scenario, place.episode, place.pedestrian, place.kind, place.outcome, place.frames = (
                record.scenario, record.episode, record.pedestrian, record.kind, NONE, 0,
            )  # fmt: skip
            if record.status == ENDED and record.frame > 0:
                free[counts[0]] = slot.place
                counts[0] += 1
                slot.open = False
                continue
        elif not slot.open:
            continue
        place, frames = places[slot.place], values[slot.place]
        for f in range(place.frames, record.frame):  # which nobody saw
            for k in range(values.shape[2]):
                frames[f, k] = np.nan
        row = frames[record.frame]
        # the vehicle moves along its heading, so that is where its velocity points
        row[0], row[1] = record.vehicle_x, record.vehicle_y
        row[2] = record.vehicle_speed * math.cos(record.vehicle_heading)
        row[3] = record.vehicle_speed * math.sin(record.vehicle_heading)
        row[4], row[5] = record.pedestrian_x, record.pedestrian_y
        row[6], row[7] = record.pedestrian_vx, record.pedestrian_vy
        row[8], row[9] = distance[i], curvttc[i]
        row[10], row[11], row[12] = record.vehicle_heading, record.vehicle_speed, record.vehicle_curvature
        row[13], row[14] = record.controlled, seen[i]
        place.frames = max(place.frames, record.frame + 1)
        if record.status == ENDED:
            place.outcome, slot.open = record.outcome, False
            ended[counts[1]] = slot.place
            counts[1] += 1
