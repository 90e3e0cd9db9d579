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
from scipy.stats import norm

Floats = NDArray[np.float64]


LEVEL = 0.95


class Mean(NamedTuple):
    """A mean with its standard error, degrees of freedom and interval; NaN where nothing can be said."""

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
    """Return the difference of two groups' means with the standard error of (32) and Welch's degrees of freedom.

    It takes all judgements for independent, as the paper does.
    """
    parts = np.array([group.var(ddof=1) / len(group) if len(group) > 1 else math.nan for group in (one, other)])
    difference, total = float(one.mean() - other.mean()), float(parts.sum())
    if not total > 0.0:
        return Mean(difference, math.sqrt(total), math.nan, difference, difference)
    freedom = total**2 / float(sum(part**2 / (len(group) - 1) for part, group in zip(parts, (one, other), strict=True)))
    return _interval(difference, math.sqrt(total), freedom)


def p_value(mean: Mean, against: float = 0.0) -> float:
    """Return the two-sided p-value of a mean against a value; NaN where nothing can be said."""
    if not mean.error > 0.0:
        return math.nan if math.isnan(mean.error) else float(mean.value == against)
    return float(2.0 * stats.t.sf(abs(mean.value - against) / mean.error, mean.freedom))


def tost(mean: Mean, margin: float) -> float:
    """Return the p-value of equivalence within +-margin: the larger of the two one-sided ones (34).

    See Schuirmann, "A comparison of the two one-sided tests procedure and the power approach" (Journal of
    Pharmacokinetics and Biopharmaceutics 15, 1987).
    """
    if not mean.error > 0.0:
        return math.nan if math.isnan(mean.error) else float(abs(mean.value) >= margin)
    above = stats.t.sf((mean.value + margin) / mean.error, mean.freedom)
    below = stats.t.cdf((mean.value - margin) / mean.error, mean.freedom)
    return float(max(above, below))


def share_of(mean: Mean, units: int) -> Mean:
    """Return a mean of values from 0 to 1 with an interval that stays there.

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


# ---- How far raters agree, ICC(2,k), and how well each separates real clips from made ones, d'.
#
# pingouin has ICC(2,k), and needs pandas, seaborn, statsmodels and scikit-learn for it; these few lines are checked
# with the example of the paper that they come from.


def icc_2k(ratings: Floats) -> tuple[float, float, float]:
    """Return ICC(2,k) and its 95% interval: agreement of the mean of k raters, two-way random, absolute.

    See Shrout and Fleiss, "Intraclass correlations: uses in assessing rater reliability" (Psychological Bulletin 86,
    1979); the interval is McGraw and Wong's (Psychological Methods 1, 1996).

    :param ratings: float64[R, n], raters and clips, at least 2 of each.
    :returns: NaN where nobody's judgements differ.
    """
    raters, clips = ratings.shape
    of_raters, of_clips, residual = mean_squares(ratings)
    below = of_clips + (of_raters - residual) / clips
    if not below > 0.0 or of_clips == 0.0:
        return float("nan"), float("nan"), float("nan")
    single = (of_clips - residual) / (of_clips + (raters - 1) * residual + raters * (of_raters - residual) / clips)
    a = raters * single / (clips * (1.0 - single)) if single < 1.0 else np.inf
    b = 1.0 + raters * single * (clips - 1) / (clips * (1.0 - single)) if single < 1.0 else np.inf
    if residual == 0.0 or not np.isfinite(a + b):
        value = (of_clips - residual) / below
        return value, float("nan"), float("nan")
    freedom = (a * of_raters + b * residual) ** 2 / (
        (a * of_raters) ** 2 / (raters - 1) + (b * residual) ** 2 / ((clips - 1) * (raters - 1))
    )
    upper, lower = (stats.f.ppf(0.5 + LEVEL / 2.0, *d) for d in ((clips - 1, freedom), (freedom, clips - 1)))
    noise = raters * of_raters + (raters * clips - raters - clips) * residual
    low = clips * (of_clips - upper * residual) / (upper * noise + clips * of_clips)
    high = clips * (lower * of_clips - residual) / (noise + clips * lower * of_clips)
    low, high = (float(raters * s / (1.0 + (raters - 1) * s)) for s in (low, high))
    return float((of_clips - residual) / below), low, high


def d_prime(hits: NDArray[np.int64], false_alarms: NDArray[np.int64], signals: int, noises: int) -> Floats:
    """Return d' of each rater, float64[R]: z(hit rate) - z(false alarm rate), a half added to each count.

    See Hautus, "Corrections for extreme proportions and their biasing effects on estimated values of d'" (Behavior
    Research Methods, Instruments and Computers 27, 1995).

    :param hits: real clips rated as real, of `signals`; false_alarms: made ones, of `noises`.
    """
    difference: Floats = norm.ppf((hits + 0.5) / (signals + 1.0)) - norm.ppf((false_alarms + 0.5) / (noises + 1.0))
    return difference


def mean_d_prime(real: NDArray[np.bool_], made: NDArray[np.bool_]) -> Mean:
    """Return the raters' mean d' with an interval for other raters; judgements "real", bool[R, K] each."""
    each = d_prime(real.sum(axis=1), made.sum(axis=1), real.shape[1], made.shape[1])
    return over_raters(each[:, None])
