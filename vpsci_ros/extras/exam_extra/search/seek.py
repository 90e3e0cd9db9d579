"""The search itself: drive, learn how the driving system drives, rehearse, drive where it may fail, and count."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.config import DRIVERS, added_pedestrians
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_process import loop_with
from vpsci_ros.extras.exam_extra.search.imitation import Floats32, Imitation, Recent
from vpsci_ros.extras.exam_extra.search.risk import Count, Floats, LeastMargins, Risk
from vpsci_ros.world.tick import Actions

# ---- Which episodes the driving system drives next: many where a failure is likely, a few at random.


AT_RANDOM = 0.15  # of what is driven after the pilot
PILOT, SHARPEN = 0.25, 0.2  # of the budget: at random, then where the first stand-in comes near
ROUNDS = 3  # of what is left
_LEAST = 8  # episodes of a part


Part = tuple[str, NDArray[np.int64], bool]
"""Episodes to drive now: name, as "2_focus"; places in the pool, int64[k]; whether the stand-in learns from them."""


class Plan:
    """What has been driven of a pool of episodes, and what comes next.

    Call `parts` once; before each next one pass the outcome to `take`, and the result of a rehearsal to `rehearsed`.

    :param pool: how many episodes there are; `budget`: how many may be driven.
    """

    def __init__(self, pool: int, budget: int, seed: int) -> None:
        self.driven = np.zeros(pool, np.bool_)
        self.failed = np.zeros(pool, np.bool_)
        self.margin: Floats = np.full(pool, np.nan)  # of the last rehearsal
        self.margin_before: Floats = np.full(pool, np.nan)  # of the last one before an episode was driven
        self.fresh = np.zeros(pool, np.bool_)  # driven after the last stand-in was learned
        self._seed, self._budget = seed, budget

    def parts(self) -> Iterator[Part]:
        """Yield what to drive, a part after the other."""
        pilot, sharpen = (max(_LEAST, round(share * self._budget)) for share in (PILOT, SHARPEN))
        rest = np.array_split(np.arange(max(self._budget - pilot - sharpen, 0)), ROUNDS)
        yield self._part("0_pilot", pilot, learns=True)
        yield self._part("1_sharpen", sharpen, learns=True)
        for number, part in enumerate(rest, 2):
            if len(part):
                yield self._part(f"{number}_focus", len(part), learns=False)

    def rehearsed(self, margin: Floats) -> None:
        """Take the margins with a new stand-in, float64[pool]; NaN where an episode was not rehearsed."""
        self.margin = margin
        self.fresh[:] = False

    def take(self, chosen: NDArray[np.int64], failed: NDArray[np.bool_]) -> None:
        """Take how episodes ended, bool[k], that the driving system has driven."""
        self.driven[chosen] = self.fresh[chosen] = True
        self.margin_before[chosen] = self.margin[chosen]
        self.failed[chosen] = failed

    def risk(self) -> Risk:
        """Return the chance of a failure by margin, from episodes that the stand-in has not learned from."""
        return Risk(self.margin[self.fresh], self.failed[self.fresh])

    def count(self) -> Count:
        """Return how many failures the pool holds."""
        rest = self.margin[~self.driven]
        return self.risk().count(int(self.failed.sum()), int(self.driven.sum()), rest, self._rng(99))

    def _part(self, name: str, size: int, *, learns: bool) -> Part:
        rng = self._rng(int(name[0]))
        free = np.flatnonzero(~self.driven)
        size = min(size, len(free))
        if np.isnan(self.margin[free]).all():
            return name, np.sort(rng.choice(free, size, replace=False)), learns
        weight = np.sqrt(self.risk().chance(self.margin[free]))  # the allocation of Neyman (1934), for rare failures
        share = (1.0 - AT_RANDOM) * weight / weight.sum() + AT_RANDOM / len(free)
        return name, np.sort(rng.choice(free, size, replace=False, p=share)), learns

    def _rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, 0x5EA2C4, stream])


_BATCH = 1024  # episodes rehearsed side by side
Report = Callable[[str, int, int], None]
"""Called with what is done, how much of it, and how much there is."""


@dataclass(frozen=True)
class SearchConfig:
    """A search: with whom, among how many episodes, of which the system drives so many."""

    pedestrian: str
    pool: int
    budget: int

    def __post_init__(self) -> None:
        known = [name for name in (*DRIVERS, *added_pedestrians()) if name != "recorded"]
        if self.pedestrian not in known:
            raise InvalidInput(f"--pedestrian: unknown {self.pedestrian!r}; expected {', '.join(known)}")
        if self.budget > self.pool:
            raise InvalidInput(f"--budget {self.budget} exceeds --pool {self.pool}; there is nothing to search then")


class Driven(NamedTuple):
    """The result of a part.

    :ivar episodes: that were driven: those requested, or those of the same part before the search was stopped.
    :ivar failed: bool[k].
    :ivar seen, done: what the vehicle saw and did, see `imitation.lessons`.
    """

    episodes: list[Key]
    failed: NDArray[np.bool_]
    seen: Floats32
    done: Floats32


def seek(
    exam: Exam, search: SearchConfig, pool: list[Key], drive: Callable[[str, list[Key]], Driven], report: Report
) -> Plan:
    """Search a pool of episodes, and return what has been driven and what is known of the rest.

    :param drive: has the driving system drive the episodes of a part, by its name.
    """
    place = {key: number for number, key in enumerate(pool)}
    plan = Plan(len(pool), search.budget, exam.run.seed)
    seen, done = [], []
    for name, chosen, learns in plan.parts():
        driven = drive(name, [pool[number] for number in chosen])
        plan.take(np.array([place[key] for key in driven.episodes]), driven.failed)
        if not learns:
            continue
        seen.append(driven.seen)
        done.append(driven.done)
        report("learning how it drives", 0, 1)
        stand_in = Imitation(np.concatenate(seen), np.concatenate(done), exam.run.seed)
        report("learning how it drives", 1, 1)
        rest = np.flatnonzero(~plan.driven)
        margin = np.full(len(pool), np.nan)
        margin[rest] = rehearse(
            exam, search.pedestrian, [pool[number] for number in rest], stand_in, partial(_tell, report, len(rest))
        )
        plan.rehearsed(margin)
    return plan


def _tell(report: Report, total: int, done: int) -> None:
    report("rehearsing", done, total)


def rehearse(
    exam: Exam, pedestrian: str, episodes: list[Key], driver: Imitation, report: Callable[[int], None]
) -> Floats:
    """Return the least margin of each episode with the stand-in at the wheel, float64[n].

    :param report: called now and then with how many episodes have ended.
    """
    loop = loop_with(exam, pedestrian, "external", episodes, _BATCH)
    most = exam.world.pedestrians
    recent, least = Recent(most), LeastMargins(exam.config.failure)
    with driver.at_the_wheel():
        while not loop.world.done:
            features, rows = recent.features(loop.world.now.state, loop.assessment.curvttc)
            answer = np.zeros((len(rows), 2))
            answer[:, 0] = driver.drive(features)
            step = loop.step(Actions(vehicle=np.repeat(answer, most, axis=0)))
            least.add(step.tick.state, step.assessment.curvttc)
            report(len(least.found))
    return np.array([least.found[key] for key in episodes])
