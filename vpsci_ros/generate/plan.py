"""The next unit to compute, and whether a scenario is complete.

A scenario's dataset is its episodes in the order of their numbers up to the last wanted kept one, so it does not depend
on the workers. Units of a scenario are handed out in order. Episodes beyond the last wanted one are discarded; the plan
keeps them few by the acceptance so far.
"""

import itertools
from collections.abc import Mapping

from vpsci_ros.errors import VpsciError
from vpsci_ros.generate.job import Unit

GIVE_UP = 100.0  # times the wanted episodes that may be rejected


class ScenarioPlan:
    """One scenario: its units of work, those handed out and those computed.

    :param target: kept episodes wanted.
    :param first: number of the first episode.
    :param size: episodes in a unit.
    """

    def __init__(self, scenario: int, target: int, first: int, size: int) -> None:
        self.scenario, self.target = scenario, target
        self._first, self._size = first, size
        self._kept: dict[int, int] = {}  # by place of the unit
        self._handed_out: set[int] = set()

    @property
    def simulated(self) -> int:
        """Episodes in the units that are computed."""
        return len(self._kept) * self._size

    @property
    def kept(self) -> int:
        """Kept episodes in the units that are computed."""
        return sum(self._kept.values())

    @property
    def acceptance(self) -> float:
        """Share of the simulated episodes that are kept; 1 before the first computed unit."""
        return self.kept / self.simulated if self._kept else 1.0

    @property
    def expected(self) -> float:
        """Kept episodes to expect of all units handed out, computed or not, as a share of the target."""
        running = len(self._handed_out - self._kept.keys()) * self._size
        return (self.kept + running * self.acceptance) / self.target

    @property
    def complete(self) -> bool:
        """Whether the computed units, without a gap from the first one, have enough kept episodes."""
        return self.units_needed() is not None

    def units_needed(self) -> int | None:
        """Return the number of units, from the first one, with enough kept episodes; None if there are too few yet."""
        kept = 0
        for place in range(len(self._kept)):
            if place not in self._kept:
                return None
            kept += self._kept[place]
            if kept >= self.target:
                return place + 1
        return None

    def unit(self, place: int) -> Unit:
        """Return the unit of work with this index, counted from 0."""
        begin = self._first + place * self._size
        return Unit(self.scenario, range(begin, begin + self._size))

    def unit_from(self, number: int) -> Unit | None:
        """Return the unit that begins with this episode; None if none does."""
        place, rest = divmod(number - self._first, self._size)
        return None if rest or place < 0 else self.unit(place)

    def hand_out(self) -> Unit:
        """Return the first unit that was not handed out yet, and count it as handed out."""
        place = next(place for place in itertools.count() if place not in self._handed_out)
        self._handed_out.add(place)
        return self.unit(place)

    def take(self, unit: Unit, kept: int) -> None:
        """Record a computed unit and the number of its kept episodes."""
        place = (unit.numbers[0] - self._first) // self._size
        self._handed_out.add(place)
        self._kept[place] = kept


class DatasetPlan:
    """The plans of all scenarios of a run.

    :param targets: kept episodes wanted by scenario.
    :param give_up: rejected episodes, in multiples of the target, after which a scenario fails.
    """

    def __init__(self, targets: Mapping[int, int], first: int, size: int, give_up: float = GIVE_UP) -> None:
        self.scenarios = {number: ScenarioPlan(number, target, first, size) for number, target in targets.items()}
        self._give_up = give_up

    @property
    def complete(self) -> bool:
        """Whether every scenario is complete."""
        return all(scenario.complete for scenario in self.scenarios.values())

    def next(self) -> Unit | None:
        """Hand out the next unit of the scenario with the least progress; None if the units handed out may suffice.

        :raises VpsciError: a scenario keeps next to nothing.
        """
        behind = [s for s in self.scenarios.values() if s.expected < 1.0 and not s.complete]
        if not behind:
            return None
        scenario = min(behind, key=lambda s: s.expected)
        if scenario.simulated - scenario.kept > self._give_up * scenario.target + 100:
            raise VpsciError(
                f"scenario {scenario.scenario}: {scenario.kept} of {scenario.simulated} episodes passed the filters, "
                f"{scenario.target} are wanted; loosen the filters"
            )
        return scenario.hand_out()
