"""Intervals and paired comparisons for an exam, whose unit of sampling is the episode.

Shares get Wilson's interval, which holds near 0 and 1, where a good driving system should be. Differences of shares on
the same episodes get Agresti and Min's, tested by McNemar's exact test. Everything else is resampled by episode.
"""

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95
RESAMPLES = 2000
Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]


class Estimate(NamedTuple):
    """A value with the bounds of its interval and the number of episodes that it rests on.

    NaN where there is nothing to estimate from.
    """

    value: float
    low: float
    high: float
    n: int


NOTHING = Estimate(math.nan, math.nan, math.nan, 0)


def share(hits: int, n: int, level: float = LEVEL) -> Estimate:
    """Return hits / n with the score interval.

    See Wilson, "Probable inference, the law of succession, and statistical inference" (JASA 22, 1927).
    """
    if n == 0:
        return NOTHING
    z = _z(level)
    centre = (hits + 0.5 * z * z) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(hits * (n - hits) / n + 0.25 * z * z)
    return Estimate(hits / n, max(0.0, centre - half), min(1.0, centre + half), n)


def share_difference(only_first: int, only_second: int, n: int, level: float = LEVEL) -> Estimate:
    """Return the difference of two shares on the same n episodes, (only_first - only_second) / n.

    Wald's interval for matched pairs after adding 0.5 to each of the four cells; see Agresti and Min, "Simple improved
    confidence intervals for comparing matched proportions" (Statistics in Medicine 24, 2005).

    :param only_first, only_second: episodes in which only the first, only the second of the two has happened.
    """
    if n == 0:
        return NOTHING
    b, c, m = only_first + 0.5, only_second + 0.5, n + 2.0
    centre, half = (b - c) / m, _z(level) * math.sqrt(b + c - (b - c) ** 2 / m) / m
    return Estimate((only_first - only_second) / n, max(-1.0, centre - half), min(1.0, centre + half), n)


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p-value that both happen equally often on the same episodes.

    See McNemar, "Note on the sampling error of the difference between correlated proportions" (Psychometrika 12, 1947).
    """
    n, less = only_first + only_second, min(only_first, only_second)
    tail = sum(math.comb(n, k) for k in range(less + 1))
    return min(1.0, 2.0 * tail / 2**n)


def resampled(values: Floats, statistic: Statistic, seed: int = 0, level: float = LEVEL) -> Estimate:
    """Return a statistic of float64[n] with its percentile bootstrap interval.

    :param statistic: of float64[..., n] over the last axis.
    """
    if len(values) == 0:
        return NOTHING
    draws = statistic(values[_draws(len(values), seed)])
    return Estimate(float(statistic(values)), *_bounds(draws, level), len(values))


def resampled_difference(
    first: Floats, second: Floats, statistic: Statistic, seed: int = 0, level: float = LEVEL
) -> Estimate:
    """Return statistic(first) - statistic(second), float64[n] of the same episodes, which are resampled as pairs."""
    if len(first) == 0:
        return NOTHING
    rows = _draws(len(first), seed)
    value = float(statistic(first) - statistic(second))
    return Estimate(value, *_bounds(statistic(first[rows]) - statistic(second[rows]), level), len(first))


def mean(values: Floats) -> Floats:
    """Return the mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def quantile(q: float) -> Statistic:
    """Return the statistic that is the `q` quantile over the last axis."""
    return lambda values: np.asarray(np.quantile(values, q, axis=-1))


def _draws(n: int, seed: int) -> NDArray[np.int64]:
    return np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))


def _bounds(draws: Floats, level: float) -> tuple[float, float]:
    low, high = np.quantile(draws, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return float(low), float(high)


def _z(level: float) -> float:
    return NormalDist().inv_cdf(0.5 * (1.0 + level))
