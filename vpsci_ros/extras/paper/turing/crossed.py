"""Means of tables in which every rater has rated every scene, with intervals for other raters, scenes, or both.

Judgements of one rater are alike, and so are those of one scene; a test that takes all of them for independent, as the
paper's (32) does, finds differences that are only those of a few scenes. Here raters and scenes are both random: the
variance of the mean is (MS_raters + MS_scenes - MS_residual) / (R K), with Satterthwaite's degrees of freedom. See
Clark, "The language-as-fixed-effect fallacy" (Journal of Verbal Learning and Verbal Behavior 12, 1973) and
Satterthwaite, "An approximate distribution of estimates of variance components" (Biometrics Bulletin 2, 1946).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]
LEVEL = 0.95


class Mean(NamedTuple):
    """A mean with its standard error, degrees of freedom and interval; NaN where they are undefined."""

    value: float
    error: float
    freedom: float
    low: float
    high: float


def over_raters(table: Floats) -> Mean:
    """Return the mean of float64[R, K] with an interval for other raters of these scenes (t of the raters' means)."""
    return _of_units(table.mean(axis=1))


def over_scenes(table: Floats) -> Mean:
    """Return the mean of float64[R, K] with an interval for other scenes rated by these raters."""
    return _of_units(table.mean(axis=0))


def over_both(table: Floats) -> Mean:
    """Return the mean of float64[R, K] with an interval for other raters and other scenes."""
    raters, scenes = table.shape
    if raters < 2 or scenes < 2:
        return Mean(float(table.mean()), math.nan, math.nan, math.nan, math.nan)
    rows, columns, residual = mean_squares(table)
    total = rows + columns - residual
    floor = max(rows, columns)
    if total > floor:
        parts = rows**2 / (raters - 1) + columns**2 / (scenes - 1) + residual**2 / ((raters - 1) * (scenes - 1))
        freedom = total**2 / parts
    else:  # the smaller of the two is nothing but residual
        total, freedom = floor, float((raters if rows >= columns else scenes) - 1)
    return _interval(float(table.mean()), math.sqrt(total / (raters * scenes)), freedom)


def mean_squares(table: Floats) -> tuple[float, float, float]:
    """Return the mean squares of rows, columns and residual of float64[R, K], R and K at least 2."""
    raters, scenes = table.shape
    mean, by_row, by_column = table.mean(), table.mean(axis=1), table.mean(axis=0)
    residual = table - by_row[:, None] - by_column[None, :] + mean
    rows = scenes * float(((by_row - mean) ** 2).sum()) / (raters - 1)
    columns = raters * float(((by_column - mean) ** 2).sum()) / (scenes - 1)
    return rows, columns, float((residual**2).sum()) / ((raters - 1) * (scenes - 1))


def welch(one: Floats, other: Floats) -> Mean:
    """Return the difference of two groups' means with the paper's standard error (32), Welch's degrees of freedom.

    It takes all judgements for independent, as the paper does.
    """
    parts = np.array([group.var(ddof=1) / len(group) if len(group) > 1 else math.nan for group in (one, other)])
    difference, total = float(one.mean() - other.mean()), float(parts.sum())
    if not total > 0.0:
        return Mean(difference, math.sqrt(total), math.nan, difference, difference)
    freedom = total**2 / float(sum(part**2 / (len(group) - 1) for part, group in zip(parts, (one, other), strict=True)))
    return _interval(difference, math.sqrt(total), freedom)


def p_value(mean: Mean, against: float = 0.0) -> float:
    """Return the two-sided p-value of a mean against a value; NaN where it is undefined."""
    if not mean.error > 0.0:
        return math.nan if math.isnan(mean.error) else float(mean.value == against)
    return float(2.0 * stats.t.sf(abs(mean.value - against) / mean.error, mean.freedom))


def tost(mean: Mean, margin: float) -> float:
    """Return the p-value of equivalence within +-margin: the larger of the two one-sided p-values, the paper's (34).

    See Schuirmann, "A comparison of the two one-sided tests procedure and the power approach" (Journal of
    Pharmacokinetics and Biopharmaceutics 15, 1987).
    """
    if not mean.error > 0.0:
        return math.nan if math.isnan(mean.error) else float(abs(mean.value) >= margin)
    above = stats.t.sf((mean.value + margin) / mean.error, mean.freedom)
    below = stats.t.cdf((mean.value - margin) / mean.error, mean.freedom)
    return float(max(above, below))


def share_of(mean: Mean, units: int) -> Mean:
    """Return a mean of values from 0 to 1, with an interval within 0 to 1.

    Wilson's, for as many independent judgements as have this standard error, and t instead of the normal quantile:
    with p the mean, n = p (1 - p) / error^2. See Korn and Graubard, "Confidence intervals for proportions with small
    expected number of positive counts estimated from survey data" (Survey Methodology 24, 1998).

    :param units: raters or scenes: so many judgements count where all agree on 0 or 1, and there is no error.
    """
    if not math.isfinite(mean.error):
        return mean
    variance = mean.value * (1.0 - mean.value)
    if mean.error == 0.0 and variance > 0.0:
        return mean
    squared = float(stats.t.ppf(0.5 + LEVEL / 2.0, mean.freedom)) ** 2
    squared *= mean.error**2 / variance if variance > 0.0 else 1.0 / units  # z^2 / n
    centre = (mean.value + squared / 2.0) / (1.0 + squared)
    half = math.sqrt(squared * variance + squared**2 / 4.0) / (1.0 + squared)
    return mean._replace(low=max(0.0, centre - half), high=min(1.0, centre + half))


def _of_units(values: Floats) -> Mean:
    if len(values) < 2:
        return Mean(float(values.mean()), math.nan, math.nan, math.nan, math.nan)
    return _interval(float(values.mean()), float(stats.sem(values)), len(values) - 1.0)


def _interval(value: float, error: float, freedom: float) -> Mean:
    half = float(stats.t.ppf(0.5 + LEVEL / 2.0, freedom)) * error
    return Mean(value, error, freedom, value - half, value + half)
