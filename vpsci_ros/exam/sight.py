"""What a driver could see: was the pedestrian hidden as it became critical, and was it published to the ADS."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.gathered import Tick, gathered
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import IDLE, Scenario
from vpsci_ros.world.kinds import KINDS
from vpsci_ros.world.parked import in_sight, parked_from
from vpsci_ros.world.perception import SEEN, PerceptionConfig, PerceptionState, blank, perceive


@dataclass
class Sight:
    """What could be seen in one episode.

    :ivar hidden: parked vehicles hid the pedestrian when CurvTTC first fell below 5 s.
    :ivar critical: ticks with a CurvTTC below 5 s.
    :ivar published: those of them at which the pedestrian was published to the ADS.
    :ivar kind: of the pedestrian that became critical first, one of `KINDS`.
    :ivar pedestrians: how many there were.
    :ivar first_critical, first_published: frames, -1 where there was none; the latter not before the former.
    """

    hidden: bool = False
    kind: str = ""
    pedestrians: int = 0
    critical: int = 0
    published: int = 0
    first_critical: int = -1
    first_published: int = -1

    @property
    def published_share(self) -> float:
        """Share of the critical ticks at which the pedestrian was published to the ADS; NaN where none was critical."""
        return self.published / self.critical if self.critical else math.nan

    def published_after(self, period: float) -> float:
        """Return how long after the first critical tick it was published [s]; NaN where it never was."""
        return (self.first_published - self.first_critical) * period if self.first_published >= 0 else math.nan


class Watcher:
    """Gathers what could be seen, tick by tick; errors of perception are drawn again, to the bit.

    :param perception: of the ADS; None: everybody is published.
    :param period: of a tick [s].
    :param pedestrians: rows of an episode.
    :ivar found: (scenario, episode) -> what could be seen.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        perception: PerceptionConfig | None = None,
        period: float = 0.05,
        pedestrians: int = 1,
    ) -> None:
        self.found: dict[tuple[int, int], Sight] = {}
        self._parked = parked_from(scenarios)
        self._perception, self._period, self._most = perception, period, pedestrians
        self._memory: PerceptionState | None = None

    def add(self, state: NDArray[np.void], curvttc: NDArray[np.float64]) -> None:
        """Take in EPISODE[B] and CurvTTC [s], float64[B], of the next tick."""
        published = self._published(state)
        critical = (state["status"] != IDLE) & (curvttc < CRITICAL_TTC)
        if not critical.any():
            return
        visible = in_sight(state, self._parked)
        for slot in np.flatnonzero(critical):
            record = state[slot]
            sight = self.found.setdefault((int(record["scenario"]), int(record["episode"])), Sight())
            frame = int(record["frame"])
            if sight.first_critical < 0:
                sight.first_critical, sight.hidden = frame, not visible[slot]
                sight.kind, sight.pedestrians = KINDS[record["kind"]], max(1, int(record["pedestrians"]))
            if published[slot] and sight.first_published < 0:
                sight.first_published = frame
            sight.critical += 1
            sight.published += int(published[slot])

    def _published(self, state: NDArray[np.void]) -> NDArray[np.bool_]:
        if self._perception is None:
            return np.ones(len(state), np.bool_)
        self._memory = self._memory or blank(len(state), self._perception, self._period)
        self._memory, objects = perceive(self._memory, state, self._perception, self._period, self._parked, self._most)
        published: NDArray[np.bool_] = objects["status"] == SEEN
        return published


def sight_record(sight: Mapping[Key, Sight]) -> list[dict[str, Any]]:
    """Return what could be seen, as a record has it."""
    return [{"scenario": key[0], "episode": key[1]} | dataclasses.asdict(seen) for key, seen in sight.items()]


def episodes_of(
    ticks: Iterable[Tick], period: float, scenarios: Sequence[Scenario], watcher: Watcher, source: str
) -> tuple[list[Episode], Mapping[Key, Sight]]:
    """Return the episodes of ticks in the order of their keys, and what could be seen of each.

    :param period: of a tick [s].
    """

    def watched() -> Iterator[Tick]:
        for state, curvttc, distance in ticks:
            watcher.add(state, curvttc)
            yield state, curvttc, distance

    found = gathered(watched(), period, scenarios, source=source)
    return sorted(found, key=lambda episode: episode.key), watcher.found
