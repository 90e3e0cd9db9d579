"""The next episodes of a search: many where a failure is likely, a few at random."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.extras.exam_extra.search.risk import Count, Floats, Risk

AT_RANDOM = 0.15  # of what is driven after the pilot
PILOT, SHARPEN = 0.25, 0.2  # of the budget: at random, then where the first stand-in comes near
ROUNDS = 3  # of what is left
_LEAST = 8  # episodes of a part


Part = tuple[str, NDArray[np.int64], bool]
"""Episodes to drive now: name, as "2_focus"; places in the pool, int64[k]; whether the surrogate is trained on them."""


class Plan:
    """The driven episodes of a pool, and the choice of the next ones.

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
        """Yield the parts of the search: the episodes to drive next."""
        pilot, sharpen = (max(_LEAST, round(share * self._budget)) for share in (PILOT, SHARPEN))
        rest = np.array_split(np.arange(max(self._budget - pilot - sharpen, 0)), ROUNDS)
        yield self._part("0_pilot", pilot, learns=True)
        yield self._part("1_sharpen", sharpen, learns=True)
        for number, part in enumerate(rest, 2):
            if len(part):
                yield self._part(f"{number}_focus", len(part), learns=False)

    def rehearsed(self, margin: Floats) -> None:
        """Store the pool's margins by a new surrogate, float64[pool]; NaN for episodes that it did not drive."""
        self.margin = margin
        self.fresh[:] = False

    def take(self, chosen: NDArray[np.int64], failed: NDArray[np.bool_]) -> None:
        """Store the outcome of driven episodes: places in the pool, int64[k], and whether each failed, bool[k]."""
        self.driven[chosen] = self.fresh[chosen] = True
        self.margin_before[chosen] = self.margin[chosen]
        self.failed[chosen] = failed

    def risk(self) -> Risk:
        """Return the probability of a failure by margin, fitted to episodes that the surrogate was not trained on."""
        return Risk(self.margin[self.fresh], self.failed[self.fresh])

    def count(self) -> Count:
        """Return the estimated number of failures in the pool."""
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
