"""Episodes of a bag, each with a text record in the file, so that one episode can be read without the rest.

A record is written when its episode has ended. A bag without records, since another tool recorded or converted it,
gives its episodes from the world's states or odometry themselves; that reads all of them.
"""

import itertools
import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, opened
from vpsci_ros.bags.run_record import scenarios_of
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.gathered import RecordedTick, episode_rows, gathered
from vpsci_ros.documents import given_names, listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import ENDED, FINISHED, OUTCOME_NAMES, STARTED

EPISODE_RECORD = "vpsci_episode"  # name of the records
_USED = ["kind", "slot", "scenario", "episode", "outcome", "least_curvttc"]  # fields of an event
LATE = 1_000_000_000  # [ns] by which other tools log an answer or a state later than the event that goes with it


@dataclass(frozen=True)
class BagEpisode:
    """One episode of a bag: its numbers, first and last tick, outcome and least CurvTTC.

    :ivar scenario, episode: its number, and that within the scenario.
    :ivar slot: its index in the arrays of the messages, of several pedestrians the first one's.
    :ivar start_tick, end_tick, start_time, end_time: first and last tick, and their times in the bag [ns].
    :ivar outcome: of `OUTCOME_NAMES`, such as "collision"; "none" where the bag does not say.
    :ivar least_curvttc: [s], of several pedestrians the least one; infinite if no contact was ever predicted.
    :ivar first_file, file: where it begins and where it ends; empty where no record says so.
    """

    scenario: int
    episode: int
    slot: int
    start_tick: int
    end_tick: int
    start_time: int
    end_time: int
    outcome: str
    least_curvttc: float
    first_file: str = ""
    file: str = ""

    @property
    def key(self) -> tuple[int, int]:
        """Numbers of the scenario and of the episode."""
        return self.scenario, self.episode

    @property
    def name(self) -> str:
        """The episode's name in commands, such as "6:12"."""
        return f"{self.scenario}:{self.episode}"

    def to_record(self) -> dict[str, str]:
        """Return the episode as the values of a text record."""
        return {field.name: str(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_record(cls, record: dict[str, str]) -> "BagEpisode":
        """Return the episode that a text record describes.

        :raises InvalidInput: it is not one.
        """
        try:
            return cls(**{field.name: field.type(record[field.name]) for field in fields(cls)})  # type: ignore[operator]
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
                ends = (start_tick, tick, start_time, time)
                ended.append(BagEpisode(*begun, slot, *ends, OUTCOME_NAMES[outcome], least, first_file, file))
            elif kind == FINISHED and ended and ended[-1].key == key:
                ended[-1] = replace(ended[-1], least_curvttc=min(ended[-1].least_curvttc, least))
        return ended


def bag_episodes(bag: Bag) -> list[BagEpisode]:
    """Return the episodes of a bag that ended in it, in the order of their ends.

    :raises InvalidInput: the bag is damaged, or has no states of a vehicle and a pedestrian.
    """
    found = [BagEpisode.from_record(values) for name, values in bag.records() if name == EPISODE_RECORD]
    return found or list(_from_ticks(bag))


def _from_ticks(bag: Bag) -> Iterator[BagEpisode]:
    begun: dict[int, tuple[tuple[int, int], int, int]] = {}
    least: NDArray[np.float64] = np.zeros(0)
    for tick in read_bag(bag):
        if len(least) == 0:
            least = np.full(len(tick.state), math.inf)
        for rows in episode_rows(tick.state):
            slot = int(rows[0])
            record = tick.state[slot]
            key = int(record["scenario"]), int(record["episode"])
            if slot not in begun or begun[slot][0] != key:
                begun[slot] = key, tick.number, tick.time
                least[slot] = math.inf
            curvttc = np.nan_to_num(tick.curvttc[rows], nan=math.inf, posinf=math.inf)
            least[slot] = min(least[slot], curvttc.min())
            if record["status"] == ENDED:
                _, start_tick, start_time = begun.pop(slot)
                ends = start_tick, tick.number, start_time, tick.time
                yield BagEpisode(*key, slot, *ends, OUTCOME_NAMES[record["outcome"]], float(least[slot]))


def chosen_episode(episodes: list[BagEpisode], text: str) -> BagEpisode:
    """Return the episode with a name such as "12" or "6:12".

    :raises InvalidInput: not of that form, no such episode, or one with that number in several scenarios.
    """
    found = [episode for episode in episodes if _matches(episode, text)]
    if not found:
        raise InvalidInput(f"episode {text}: not in the bag; it has {_some(episodes)}")
    if len({episode.key for episode in found}) > 1:
        raise InvalidInput(f"episode {text}: there is one in several scenarios; name one of {_some(found)}")
    return found[0]


def choose(
    episodes: list[BagEpisode], numbers: str = "", outcome: str = "", curvttc_below: float | None = None
) -> list[BagEpisode]:
    """Return the episodes that meet all given conditions.

    :param numbers: "3,7-9", numbers in every scenario, or "6:12" in one.
    :param outcome: one of `OUTCOME_NAMES`; empty: any.
    :param curvttc_below: of the least CurvTTC [s].
    :raises InvalidInput: a condition of another form, or that no episode meets; a number that the bag does not have.
    """
    if outcome and outcome not in OUTCOME_NAMES:
        raise InvalidInput(f"outcome {outcome!r}: expected one of {', '.join(OUTCOME_NAMES)}")
    ranges = given_names(numbers, "--episodes")
    chosen = [
        episode
        for episode in episodes
        if (not ranges or any(_matches(episode, text) for text in ranges))
        and outcome in ("", episode.outcome)
        and (curvttc_below is None or episode.least_curvttc < curvttc_below)
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
    return int(first) <= episode.episode <= int(last) and (not colon or int(scenario) == episode.scenario)


_NONE = "no episode that ended in it"


def _some(episodes: list[BagEpisode]) -> str:
    return listed(f"{episode.name} ({episode.outcome})" for episode in episodes) if episodes else _NONE


def episode_ticks(bag: str | Path | Bag, chosen: Iterable[BagEpisode]) -> Iterator[RecordedTick]:
    """Yield the ticks of a bag from the start of each chosen episode to 1 s after its end, in order.

    :raises InvalidInput: see `vpsci_ros.bags.ticks.read_bag`.
    """
    ranges: list[list[int]] = []
    for episode in sorted(chosen, key=lambda episode: episode.start_time):
        start, stop = episode.start_time, episode.end_time + LATE
        if ranges and start <= ranges[-1][1]:
            ranges[-1][1] = max(stop, ranges[-1][1])
        else:
            ranges.append([start, stop])
    for start, stop in ranges:
        yield from read_bag(bag, start=start, stop=stop)


def read_bag_episodes(bag: str | Path | Bag, chosen: Collection[BagEpisode] | None = None) -> Iterator[Episode]:
    """Yield the episodes of a bag as they end.

    :param chosen: only these; None: all.
    :raises InvalidInput: see `vpsci_ros.bags.ticks.read_bag`.
    """
    bag = opened(bag)
    scenarios = scenarios_of(bag)
    ticks = read_bag(bag) if chosen is None else episode_ticks(bag, chosen)
    if (first := next(ticks, None)) is not None:
        wanted = None if chosen is None else {episode.key for episode in chosen}
        ticks = itertools.chain([first], ticks)
        yield from gathered(ticks, first.period, scenarios, wanted=wanted, source=str(bag.path))
