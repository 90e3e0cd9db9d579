"""Confidence intervals and paired comparisons for the whole package.

Shares get Wilson's interval, which is valid near 0 and 1, where a good driving system should be. Differences of shares
of the same units get Agresti and Min's interval, and McNemar's exact test. Everything else is bootstrapped, by single
units, or by whole clusters where units of one cluster are alike. scipy's bootstrap refuses data of one unit and has no
clusters.
"""

import math
from collections.abc import Callable, Iterator
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95
POWER = 0.8  # probability with which a change that is as large as stated shows
_Z, _Z_POWER = NormalDist().inv_cdf(0.5 * (1.0 + LEVEL)), NormalDist().inv_cdf(POWER)
RESAMPLES = 2000
LEAST_CLIPS = 4  # of three, a resample is one clip alone in 1 of 27 draws, which is an end of a 95% interval
Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]


class Estimate(NamedTuple):
    """A value with the bounds of its interval and the number of units it was computed from.

    NaN where there is nothing to estimate from.
    """

    value: float
    low: float
    high: float
    n: int


NOTHING = Estimate(math.nan, math.nan, math.nan, 0)


class Units(NamedTuple):
    """The clips, or the groups, of recorded near misses that a bootstrap draws with replacement.

    :ivar labels: str[n], the unit of each near miss.
    :ivar name: "clips" or "groups".
    """

    labels: NDArray[np.str_]
    name: str

    @property
    def text(self) -> str:
        """The number and the kind of the units, as in "118 clips"."""
        count = len(np.unique(self.labels))
        return f"{count} {self.name if count != 1 else self.name[:-1]}"


def units_of(clips: NDArray[Any], groups: NDArray[np.int64]) -> Units:
    """Return the units of n near misses: clips, or groups where there are fewer than `LEAST_CLIPS` clips.

    Near misses of one clip share place and traffic, so that clips are the units where there are several. Of one long
    recording all resamples would be equal and the interval empty; there the near misses of one vehicle at one time,
    a group, are the unit, and the interval covers the traffic of that recording.

    :param clips: [n], the clip of each; groups: int64[n], the column `group` of a near-miss table.
    """
    labels = np.asarray(clips).astype(str)
    if len(np.unique(labels)) >= LEAST_CLIPS:
        return Units(labels, "clips")
    return Units(np.char.add(np.char.add(labels, " "), np.asarray(groups).astype(str)), "groups")


def share(hits: int, n: int) -> Estimate:
    """Return hits / n with its `wilson_interval`; NaN where n is 0."""
    return Estimate(hits / n, *wilson_interval(hits, n), n) if n else NOTHING


def wilson_interval(hits: int, n: int) -> tuple[float, float]:
    """Return the score interval of a rate of `hits` in `n` trials; (0, 1) where n is 0.

    See Wilson, "Probable inference, the law of succession, and statistical inference" (JASA 22, 1927).
    """
    if n == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest  # takes seconds to import, and the nodes do without

    bounds = binomtest(hits, n).proportion_ci(LEVEL, method="wilson")
    return float(bounds.low), float(bounds.high)


def share_difference(only_first: int, only_second: int, n: int) -> Estimate:
    """Return the difference of two shares of the same n units, (only_first - only_second) / n, with its interval.

    Wald's interval for matched pairs after adding 0.5 to each of the four cells; see Agresti and Min, "Simple improved
    confidence intervals for comparing matched proportions" (Statistics in Medicine 24, 2005).

    :param only_first, only_second: numbers of units with the first event only, and with the second event only.
    """
    if n == 0:
        return NOTHING
    b, c, m = only_first + 0.5, only_second + 0.5, n + 2.0
    centre, half = (b - c) / m, _Z * math.sqrt(b + c - (b - c) ** 2 / m) / m
    return Estimate((only_first - only_second) / n, max(-1.0, centre - half), min(1.0, centre + half), n)


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p-value of McNemar's test that two events are equally frequent in the same units.

    Arguments are those of `share_difference`; 1 where both are 0.

    See McNemar, "Note on the sampling error of the difference between correlated proportions" (Psychometrika 12, 1947).
    """
    from scipy.stats import binomtest

    n = only_first + only_second
    return float(binomtest(only_first, n).pvalue) if n else 1.0


def units_for_difference(difference: float, discordant: float) -> int:
    """Return the number of units for which a difference of two shares of them shows with this power.

    With the discordant share psi of the n units, McNemar's statistic (b - c) / n has the variance psi / n without a
    difference and (psi - d^2) / n with a difference d. It exceeds its limit with the wanted power from
    n d^2 = (z_level sqrt(psi) + z_power sqrt(psi - d^2))^2 on. See Connor, "Sample size for testing differences in
    proportions for the paired-sample design" (Biometrics 43, 1987).

    :param difference: d, above 0, at most 1.
    :param discordant: psi, the share of units with one of the two events only; at least d, which it is raised to.
    """
    discordant = max(discordant, difference)
    root = _Z * math.sqrt(discordant) + _Z_POWER * math.sqrt(discordant - difference**2)
    return math.ceil((root / difference) ** 2)


def detectable_difference(n: int, discordant: float) -> float:
    """Return the least difference of two shares of n units that shows with this power; NaN where none does.

    The inverse of `units_for_difference`, whose parameters it has.
    """
    if n <= _Z**2:
        return math.nan
    # all discordant units in one direction, psi = d: n d^2 = d (z + z_power sqrt(1 - d))^2, quadratic in sqrt(1 - d)
    same = (math.sqrt((_Z * _Z_POWER) ** 2 + (n + _Z_POWER**2) * (n - _Z**2)) - _Z * _Z_POWER) / (n + _Z_POWER**2)
    least = 1.0 - same**2
    if least >= discordant:
        return least
    wide = _Z * math.sqrt(n) + _Z_POWER * math.sqrt(n + _Z_POWER**2 - _Z**2)  # the larger root of the same equation
    return math.sqrt(discordant) * wide / (n + _Z_POWER**2)


def detectable_by_interval(found: Estimate) -> float:
    """Return the least difference that shows with this power, for an estimate whose interval is about normal."""
    return 0.5 * (found.high - found.low) * (_Z + _Z_POWER) / _Z


def resampled(values: Floats, statistic: Statistic, seed: int = 0) -> Estimate:
    """Return a statistic of float64[n] with its percentile bootstrap interval.

    :param statistic: of float64[..., n] over the last axis.
    """
    if len(values) == 0:
        return NOTHING
    draws = statistic(values[np.stack(list(resamples(len(values), seed)))])
    return Estimate(float(statistic(values)), *interval(draws), len(values))


def resampled_difference(first: Floats, second: Floats, statistic: Statistic, seed: int = 0) -> Estimate:
    """Return statistic(first) - statistic(second) with its interval; both are float64[n], resampled as pairs.

    NaN for a single pair: all its resamples are equal, so that any difference would seem certain.
    """
    if len(first) < 2:
        return NOTHING._replace(n=len(first))
    rows = np.stack(list(resamples(len(first), seed)))
    value = float(statistic(first) - statistic(second))
    return Estimate(value, *interval(statistic(first[rows]) - statistic(second[rows])), len(first))


def mean(values: Floats) -> Floats:
    """Return the mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def quantile(q: float) -> Statistic:
    """Return a function that computes the `q` quantile over the last axis."""
    return lambda values: np.asarray(np.quantile(values, q, axis=-1))


def resamples(n: int, seed: int, count: int = RESAMPLES) -> Iterator[NDArray[np.int64]]:
    """Yield `count` bootstrap resamples of n units: the indices of the drawn units, int64[n] each."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.integers(n, size=n)


def cluster_counts(clusters: NDArray[Any], seed: int, count: int = RESAMPLES) -> Floats:
    """Return how often each unit occurs in bootstrap resamples of whole clusters, float64[count, n].

    :param clusters: of each unit [n], by any labels that can be sorted.
    """
    names, owner = np.unique(clusters, return_inverse=True)
    drawn = np.random.default_rng(seed).multinomial(len(names), np.full(len(names), 1.0 / len(names)), count)
    return drawn[:, owner].astype(np.float64)


def interval(draws: ArrayLike) -> tuple[float, float]:
    """Return the percentile interval of a statistic's values in resamples; NaN if none is finite.

    :param draws: float64[count]; resamples in which the statistic is not finite do not count.
    """
    values = np.asarray(draws, np.float64)
    if not (finite := values[np.isfinite(values)]).size:
        return math.nan, math.nan
    low, high = np.quantile(finite, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    return float(low), float(high)
