"""Episodes of a bag, each with a text record in the file, so that one episode can be read without the rest.

A record is written when its episode has ended. A bag without records, since another tool recorded or converted it,
gives its episodes from the world's states themselves; that reads all of them.
"""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, BagTick, opened
from vpsci_ros.bags.run_record import scenarios_of
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.documents import given_names, listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import Recorded, Scenario
from vpsci_ros.world.state import FINISHED, OUTCOME_NAMES, STARTED

EPISODE_RECORD = "vpsci_episode"  # name of the records
_USED = ["kind", "slot", "scenario", "episode", "outcome", "least_curvttc"]  # fields of an event
LATE = 1_000_000_000  # [ns] by which other tools log an answer or a state later than the event that goes with it


@dataclass(frozen=True)
class BagEpisode:
    """One episode of a bag: its metadata, and where it lies.

    :ivar listed: without a group where it is made from a record alone.
    :ivar slot: its index in the arrays of the messages, of several pedestrians the first one's.
    :ivar start_tick, end_tick, start_time, end_time: first and last tick, and their times in the bag [ns].
    :ivar first_file, file: where it begins and where it ends; empty where no record says so.
    """

    listed: Listed
    slot: int
    start_tick: int
    end_tick: int
    start_time: int
    end_time: int
    first_file: str = ""
    file: str = ""

    def values(self) -> dict[str, Any]:
        """Return the episode as a flat dictionary, by the names of a text record."""
        places = {field.name: getattr(self, field.name) for field in fields(self)[1:]}
        _, _, scenario, episode, outcome, least = self.listed
        return {"scenario": scenario, "episode": episode, "outcome": outcome, "least_curvttc": least, **places}

    def to_record(self) -> dict[str, str]:
        """Return the episode as the values of a text record."""
        return {name: str(value) for name, value in self.values().items()}

    @classmethod
    def from_record(cls, record: Mapping[str, str], roads: Mapping[int, Scenario]) -> "BagEpisode":
        """Return the episode that a text record describes.

        :param roads: scenarios by number.
        :raises InvalidInput: it is not one.
        """
        try:
            key = int(record["scenario"]), int(record["episode"])
            listed = Listed.simulated(key, roads.get(key[0]), record["outcome"], float(record["least_curvttc"]))
            places = {field.name: field.type(record[field.name]) for field in fields(cls)[1:]}  # type: ignore[operator]
            return cls(listed, **places)
        except (KeyError, ValueError) as error:
            raise InvalidInput(f"the bag's record of an episode is damaged: {error!r}") from None


class EpisodeLog:
    """Builds episodes from event messages, one message at a time."""

    def __init__(self) -> None:
        self._open: dict[int, tuple[tuple[int, int], int, int, str]] = {}  # by the slot of its first pedestrian

    @property
    def unfinished(self) -> int:
        """Number of episodes that have begun and not ended."""
        return len(self._open)

    def add(self, tick: int, time: int, events: NDArray[np.void], file: str = "") -> list[BagEpisode]:
        """Process the events of a message, EVENT[n], at `tick` and `time` [ns]; return the episodes that ended.

        An episode whose beginning was not seen is left out. The pedestrians of an episode begin and end together, one
        after the other in the message.
        """
        ended: list[BagEpisode] = []
        begins = None  # the episode of the latest event of a beginning
        for kind, slot, scenario, episode, outcome, least in events[_USED].tolist():
            key = scenario, episode
            if kind == STARTED and key != begins:
                begins = key
                self._open[slot] = key, tick, time, file
            elif kind == FINISHED and slot in self._open:
                begun, start_tick, start_time, first_file = self._open.pop(slot)
                listed = Listed.simulated(begun, None, OUTCOME_NAMES[outcome], least)
                ended.append(BagEpisode(listed, slot, start_tick, tick, start_time, time, first_file, file))
            elif kind == FINISHED and ended and ended[-1].listed.key == key:
                nearest = min(ended[-1].listed.least_curvttc, least)
                ended[-1] = replace(ended[-1], listed=ended[-1].listed._replace(least_curvttc=nearest))
        return ended


def bag_episodes(bag: Bag) -> list[BagEpisode]:
    """Return the episodes of a bag that ended in it, in the order of their ends.

    :raises InvalidInput: the bag is damaged, or has no states of the world.
    """
    records = [values for name, values in bag.records() if name == EPISODE_RECORD]
    if not records:
        return list(_from_ticks(bag))
    roads = {scenario.number: scenario for scenario in scenarios_of(bag)}
    return [BagEpisode.from_record(values, roads) for values in records]


def _from_ticks(bag: Bag) -> Iterator[BagEpisode]:
    times: dict[int, int] = {}
    last: list[BagTick] = []

    def noted() -> Iterator[BagTick]:
        for tick in read_bag(bag):
            times[tick.number] = tick.time
            last[:] = [tick]
            yield tick

    for episode in _episodes(noted(), scenarios_of(bag)):
        (tick,) = last
        start = tick.number - len(episode) + 1
        own = (tick.state["scenario"] == episode.key[0]) & (tick.state["episode"] == episode.number)
        yield BagEpisode(episode.listed, int(own.argmax()), start, tick.number, times[start], tick.time)


def _episodes(ticks: Iterator[BagTick], scenarios: Sequence[Scenario], **more: Any) -> Iterator[Episode]:
    """Yield the episodes of a bag's ticks, see `ended_episodes`."""
    if (first := next(ticks, None)) is not None:
        yield from ended_episodes(itertools.chain([first], ticks), first.period, scenarios, **more)


def choose(episodes: list[BagEpisode], numbers: str = "", curvttc_below: float | None = None) -> list[BagEpisode]:
    """Return the episodes that meet all given conditions.

    :param numbers: "3,7-9", numbers in every scenario, or "6:12" in one.
    :param curvttc_below: of the least CurvTTC [s].
    :raises InvalidInput: a condition of another form, or that no episode meets; a number that the bag does not have.
    """
    ranges = given_names(numbers, "--episodes")
    chosen = [
        episode
        for episode in episodes
        if (not ranges or any(_matches(episode, text) for text in ranges))
        and (curvttc_below is None or episode.listed.least_curvttc < curvttc_below)
    ]
    if not chosen:
        raise InvalidInput(f"no episode of the bag is as chosen; it has {_some(episodes)}")
    for text in ranges:
        if not any(_matches(episode, text) for episode in episodes):
            raise InvalidInput(f"no episode {text} in the bag; it has {_some(episodes)}")
    return chosen


def _matches(episode: BagEpisode, text: str) -> bool:
    scenario, colon, numbers = text.rpartition(":")
    first, _, last = numbers.partition("-")
    last = last or first
    if not (first.isdigit() and last.isdigit() and (scenario.isdigit() or not colon)):
        raise InvalidInput(f"episode {text!r}: expected a number, a range or SCENARIO:NUMBER, say 12, 7-9 or 6:12")
    _, _, own, number, *_ = episode.listed
    return int(first) <= number <= int(last) and (not colon or int(scenario) == own)


_NONE = "no episode that ended in it"


def _some(episodes: list[BagEpisode]) -> str:
    return listed(f"{one.listed.name} ({one.listed.outcome})" for one in episodes) if episodes else _NONE


def episode_ticks(bag: str | Path | Bag, chosen: Collection[BagEpisode]) -> Iterator[BagTick]:
    """Yield the ticks of a bag from the start of each chosen episode to 1 s after its end, in order.

    Slots with other episodes are idle.

    :raises InvalidInput: see `vpsci_ros.bags.ticks.read_bag`.
    """
    wanted = {episode.listed.key for episode in chosen}
    ranges: list[list[int]] = []
    for episode in sorted(chosen, key=lambda episode: episode.start_time):
        start, stop = episode.start_time, episode.end_time + LATE
        if ranges and start <= ranges[-1][1]:
            ranges[-1][1] = max(stop, ranges[-1][1])
        else:
            ranges.append([start, stop])
    for start, stop in ranges:
        for tick in read_bag(bag, start=start, stop=stop):
            held = zip(tick.state["scenario"].tolist(), tick.state["episode"].tolist(), strict=True)
            tick.state[[key not in wanted for key in held]] = 0
            yield tick


def read_bag_episodes(bag: str | Path | Bag, chosen: Collection[BagEpisode] | None = None) -> Iterator[Episode]:
    """Yield the episodes of a bag as they end.

    :param chosen: only these; None: all.
    :raises InvalidInput: see `vpsci_ros.bags.ticks.read_bag`.
    """
    bag = opened(bag)
    ticks = read_bag(bag) if chosen is None else episode_ticks(bag, chosen)
    yield from _episodes(ticks, scenarios_of(bag), source=str(bag.path))


def recorded_from_bag(bag: str | Path) -> Recorded:
    """Return the motion of both agents in every episode of a bag, for the replay drivers of a `World`.

    Of several pedestrians it is the first one. The bag must have been recorded at the tick of the world that replays
    it. An episode that was cut off at the end of the bag is replayed as far as it goes; beyond its recording an agent
    goes on straight.

    :raises InvalidInput: no bag, a damaged one, or one without an episode.
    """
    motion = {}
    for episode in _episodes(read_bag(bag), (), all_=True):
        seen = episode.filled()
        vehicle = np.stack([seen.x, seen.y, seen.heading, seen.speed, seen.curvature], axis=1)
        motion[episode.key] = vehicle, np.stack([seen.ped_x, seen.ped_y, seen.ped_vx, seen.ped_vy], axis=2)[0]
    return Recorded(motion)
