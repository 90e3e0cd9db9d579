"""A Turing test's result as one dictionary: the statistics of section 4.4, with Table 11."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from vpsci_ros.extras.paper.published import TABLE_11
from vpsci_ros.extras.paper.turing.agreement import icc_2k
from vpsci_ros.extras.paper.turing.answers import Answers
from vpsci_ros.extras.paper.turing.clips import SOURCES

Floats = NDArray[np.float64]
MARGIN = 0.5  # on the scale of 5 points, the paper's
ALPHA = 0.05
LEAST_SPREAD = 0.5  # of the scores that a rater gives, below which a rater distinguishes no clips


def score(answers: Answers) -> dict[str, Any]:
    """Return the results of a Turing test as JSON values; None where a number is not defined.

    Keys: raters, scenes, clips; rated_real and realism, source -> mean of all raters; excluded, rater -> reason; and
    of the other raters `kept` (their number), table_11 (a list of rows) and icc_2k (value, low, high).
    """
    raters, scenes, _ = answers.realism.shape
    excluded = excluded_raters(answers)
    kept = answers.realism[[name not in excluded for name in answers.raters]]
    icc = icc_2k(kept.reshape(len(kept), -1)) if len(kept) > 1 else (math.nan,) * 3
    return {
        "raters": raters,
        "scenes": scenes,
        "clips": 3 * scenes,
        "rated_real": {source: float(answers.real[..., i].mean()) for i, source in enumerate(SOURCES)},
        "realism": {source: float(answers.realism[..., i].mean()) for i, source in enumerate(SOURCES)},
        "excluded": excluded,
        "kept": len(kept),
        "table_11": [_pair(kept, first, second) for first, second in TABLE_11] if len(kept) else [],
        "icc_2k": [_number(value) for value in icc],
    }


def _pair(realism: Floats, first: str, second: str) -> dict[str, Any]:
    """Return a row of Table 11: Welch's t (32), d (33) and the TOST (34), all judgements taken as independent.

    For the TOST see Schuirmann, "A comparison of the two one-sided tests procedure and the power approach" (Journal of
    Pharmacokinetics and Biopharmaceutics 15, 1987).
    """
    one, other = (realism[..., SOURCES.index(source)].ravel() for source in (first, second))
    difference = float(one.mean() - other.mean())
    row: dict[str, Any] = {"first": first, "second": second, "difference": difference}
    row |= {"cohens_d": _number(cohens_d(one, other)), "paper": TABLE_11[first, second]._asdict()}
    parts = [float(group.var(ddof=1)) / len(group) for group in (one, other)]
    if not sum(parts) > 0.0:
        return row | dict.fromkeys(("t", "freedom", "p", "low", "high", "tost")) | {"conclusion": "open"}
    error = math.sqrt(sum(parts))
    freedom = sum(parts) ** 2 / sum(part**2 / (len(group) - 1) for part, group in zip(parts, (one, other), strict=True))
    half = float(stats.t.ppf(1.0 - 0.5 * ALPHA, freedom)) * error
    p = float(2.0 * stats.t.sf(abs(difference) / error, freedom))
    tost = float(stats.t.sf((MARGIN - abs(difference)) / error, freedom))  # the larger of the two one-sided p-values
    row |= {"t": difference / error, "freedom": freedom, "p": p, "low": difference - half, "high": difference + half}
    return row | {"tost": tost, "conclusion": conclusion(p, tost)}


def excluded_raters(answers: Answers) -> dict[str, str]:
    """Return the raters to exclude, with reasons: equal or extreme scores; the clips' sources are not used.

    The paper excluded 7 of 51 for scores without variance and for bias, and gives no bounds. Here: a standard deviation
    of the rater's scores below `LEAST_SPREAD`, or a mean beyond Tukey's fences of the raters' means, 1.5 interquartile
    ranges from the quartiles.
    """
    flat = answers.realism.reshape(len(answers.raters), -1)
    means, spreads = flat.mean(axis=1), flat.std(axis=1)
    low, high = np.quantile(means, (0.25, 0.75))
    fence = 1.5 * (high - low)
    reasons = {}
    for name, mean, spread in zip(answers.raters, means.tolist(), spreads.tolist(), strict=True):
        if spread < LEAST_SPREAD:
            reasons[name] = f"scores hardly differ (deviation {spread:.2f})"
        elif not low - fence <= mean <= high + fence:
            reasons[name] = f"a mean of {mean:.2f}, beyond {low - fence:.2f} to {high + fence:.2f}"
    return reasons


def conclusion(p: float, tost: float) -> str:
    """Return what the two tests show: "equivalent", "different", both, or "open"."""
    if tost < ALPHA:
        return "equivalent, and different" if p < ALPHA else "equivalent"
    return "different" if p < ALPHA else "open"


def cohens_d(one: Floats, other: Floats) -> float:
    """Return Cohen's d with the pooled standard deviation, the paper's (33); NaN where nothing varies."""
    n, m = len(one), len(other)
    if n + m <= 2:
        return math.nan
    pooled = ((n - 1) * one.var(ddof=1) + (m - 1) * other.var(ddof=1)) / (n + m - 2)
    return float((one.mean() - other.mean()) / math.sqrt(pooled)) if pooled > 0.0 else math.nan


def _number(value: float) -> float | None:
    return None if not math.isfinite(value) else float(value)
