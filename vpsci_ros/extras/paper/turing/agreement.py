"""Agreement of raters: ICC(2,k).

pingouin has ICC(2,k), and needs pandas, seaborn, statsmodels and scikit-learn for it; these few lines are checked
with the example of the paper that they come from.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import stats

LEVEL = 0.95


def icc_2k(ratings: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return ICC(2,k) and its 95% interval: agreement of the mean of k raters, two-way random, absolute.

    See Shrout and Fleiss, "Intraclass correlations: uses in assessing rater reliability" (Psychological Bulletin 86,
    1979); the interval is McGraw and Wong's (Psychological Methods 1, 1996).

    :param ratings: float64[R, n], raters and clips, at least 2 of each.
    :returns: NaN where nobody's judgements differ; bounds of NaN where raters differ by constants alone.
    """
    raters, clips = ratings.shape
    of_raters, of_clips, residual = _mean_squares(ratings)
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


def _mean_squares(table: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the mean squares of raters, clips and residual of float64[R, n], R and n at least 2."""
    raters, clips = table.shape
    mean, by_row, by_column = table.mean(), table.mean(axis=1), table.mean(axis=0)
    residual = table - by_row[:, None] - by_column[None, :] + mean
    rows = clips * float(((by_row - mean) ** 2).sum()) / (raters - 1)
    columns = raters * float(((by_column - mean) ** 2).sum()) / (clips - 1)
    return rows, columns, float((residual**2).sum()) / ((raters - 1) * (clips - 1))
