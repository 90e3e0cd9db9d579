"""A Turing test's result as one dictionary: recognition rates, Table 11, and what cannot be concluded."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from vpsci_ros.evaluation.statistics import share
from vpsci_ros.extras.paper.published import TABLE_11
from vpsci_ros.extras.paper.turing.agreement import icc_2k, mean_d_prime
from vpsci_ros.extras.paper.turing.answers import Answers
from vpsci_ros.extras.paper.turing.clips import CONTROL, GENERATED, SOURCES
from vpsci_ros.extras.paper.turing.crossed import (
    Mean,
    over_both,
    over_raters,
    over_scenes,
    p_value,
    share_of,
    tost,
    welch,
)

MARGIN = 0.5  # on the scale of 5 points, the paper's
ALPHA = 0.05
LEAST_SPREAD = 0.5  # of the scores that a rater gives, below which a rater distinguishes no clips
PAIRS = tuple(TABLE_11)


def score(answers: Answers) -> dict[str, Any]:
    """Return the results of a Turing test as JSON values: recognition rates, Table 11, agreement, open questions."""
    raters, scenes, _ = answers.realism.shape
    flat = answers.realism.reshape(raters, -1)
    return {
        "raters": raters,
        "scenes": scenes,
        "clips": 3 * scenes,
        "recognised": {source: _recognised(answers, source) for source in (GENERATED, CONTROL)},
        "rated_real": {source: _shares(answers.real[..., i].astype(float)) for i, source in enumerate(SOURCES)},
        "realism": {source: _means(answers.realism[..., i]) for i, source in enumerate(SOURCES)},
        "table_11": [_pair(answers, first, second) for first, second in PAIRS],
        "icc_2k": _icc(flat) if raters > 1 else [None, None, None],
        "knowing_raters": knowing_raters(answers),
        "as_the_paper": as_the_paper(answers),
        "seconds": {source: _number(np.median(answers.seconds[..., i])) for i, source in enumerate(SOURCES)},
        "clip_means": {
            str(answers.clips[k, i]): {"scene": k, "source": source, "realism": float(answers.realism[:, k, i].mean()),
                                       "rated_real": float(answers.real[:, k, i].mean())}
            for i, source in enumerate(SOURCES) for k in range(scenes)
        },
        "not_concluded": not_concluded(answers),
    }  # fmt: skip


def correct(answers: Answers, source: str) -> NDArray[np.float64]:
    """Return each rater's share of right judgements of a scene's clips, recorded and `source`, float64[R, K]."""
    return 0.5 * (answers.real[..., 0].astype(float) + ~answers.real[..., SOURCES.index(source)])


def _recognised(answers: Answers, source: str) -> dict[str, Any]:
    right = correct(answers, source)
    return {
        "accuracy": _shares(right),
        "p": _number(p_value(over_both(right), 0.5)),
        "d_prime": _as_dict(mean_d_prime(answers.real[..., 0], answers.real[..., SOURCES.index(source)])),
    }


def _pair(answers: Answers, first: str, second: str) -> dict[str, Any]:
    one, other = (answers.realism[..., SOURCES.index(source)] for source in (first, second))
    difference = one - other
    by_rater, both = over_raters(difference), over_both(difference)
    return {
        "first": first,
        "second": second,
        "t": _t(by_rater),
        "p": _number(p_value(by_rater)),
        "cohens_d": _number(cohens_d(one.ravel(), other.ravel())),
        "difference": _means(difference),
        "p_both": _number(p_value(both)),
        "tost": _number(tost(by_rater, MARGIN)),
        "tost_both": _number(tost(both, MARGIN)),
        "conclusion": conclusion(both),
        "paper": TABLE_11[first, second]._asdict(),
    }


def as_the_paper(answers: Answers) -> dict[str, Any]:
    """Return the paper's analysis (section 4.4): some raters excluded, all judgements taken as independent.

    t is (32), d (33), TOST (34) with the standard error of (32).
    """
    excluded = excluded_raters(answers)
    kept = answers.realism[[name not in excluded for name in answers.raters]]
    rows = []
    for first, second in PAIRS if len(kept) else ():
        one, other = (kept[..., SOURCES.index(source)].ravel() for source in (first, second))
        mean = welch(one, other)
        rows.append(
            {"first": first, "second": second, "t": _t(mean), "freedom": _number(mean.freedom),
             "p": _number(p_value(mean)), "cohens_d": _number(cohens_d(one, other)),
             "difference": _as_dict(mean), "tost": _number(tost(mean, MARGIN)), "conclusion": conclusion(mean),
             "paper": TABLE_11[first, second]._asdict()}
        )  # fmt: skip
    icc = _icc(kept.reshape(len(kept), -1)) if len(kept) > 1 else [None, None, None]
    return {"raters": len(kept), "excluded": excluded, "table_11": rows, "icc_2k": icc}


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


def conclusion(difference: Mean) -> str:
    """Return what a difference shows for other raters and scenes: "equivalent", "different", both, or "open"."""
    if math.isnan(difference.error):
        return "open"
    equivalent, different = tost(difference, MARGIN) < ALPHA, p_value(difference) < ALPHA
    if equivalent:
        return "equivalent, and different" if different else "equivalent"
    return "different" if different else "open"


def cohens_d(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return Cohen's d with the pooled standard deviation, the paper's (33); NaN where nothing varies."""
    n, m = len(one), len(other)
    if n + m <= 2:
        return math.nan
    pooled = ((n - 1) * one.var(ddof=1) + (m - 1) * other.var(ddof=1)) / (n + m - 2)
    return float((one.mean() - other.mean()) / math.sqrt(pooled)) if pooled > 0.0 else math.nan


def knowing_raters(answers: Answers) -> list[dict[str, Any]]:
    """Return each rater's share of right judgements of recorded and generated clips, and whether it is above chance.

    `p` is the exact binomial one, one-sided, after Holm's correction for the number of raters.
    """
    scenes = answers.real.shape[1]
    hits = (2.0 * correct(answers, GENERATED).sum(axis=1)).astype(int)
    each = np.array([stats.binomtest(int(hit), 2 * scenes, 0.5, alternative="greater").pvalue for hit in hits])
    order = np.argsort(each)
    corrected = np.empty(len(each))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(each[order] * (len(each) - np.arange(len(each)))))
    return [
        {"rater": name, "accuracy": share(int(hit), 2 * scenes)._asdict(), "p": float(p), "knows": bool(p < ALPHA)}
        for name, hit, p in zip(answers.raters, hits, corrected, strict=True)
    ]


def not_concluded(answers: Answers) -> list[str]:
    """Return sentences about the questions that these answers leave open, and the data needed for them."""
    raters, scenes, _ = answers.realism.shape
    out = []
    if raters < 2:
        out.append("One rater only: nothing can be said of other raters, and no agreement can be measured.")
    for first, second in PAIRS if raters > 1 else ():
        difference = answers.realism[..., SOURCES.index(first)] - answers.realism[..., SOURCES.index(second)]
        both = over_both(difference)
        if conclusion(both) == "open":
            width = both.high - both.value
            by_scene = over_scenes(difference)
            text = (f"Whether {_words(first)} and {_words(second)} look equally real: they differ by {both.value:+.2f} "
                    f"+- {width:.2f} on 5 points, and equivalence was to be within {MARGIN:g}.")  # fmt: skip
            if by_scene.high - by_scene.value > MARGIN:
                text += (
                    f" More raters alone would not do: these {scenes} scenes differ too much. More scenes are needed."
                )
            else:
                text += f" About {math.ceil(raters * (width / MARGIN) ** 2)} raters or more would be needed."
            out.append(text)
    accuracy = share_of(over_both(correct(answers, GENERATED)), min(raters, scenes))
    if raters > 1 and accuracy.low <= 0.5 <= accuracy.high:
        out.append(f"Whether raters distinguish generated from recorded clips: their accuracy of {accuracy.value:.2f} "
                   f"[{accuracy.low:.2f}, {accuracy.high:.2f}] includes chance, and does not prove it.")  # fmt: skip
    return out


def _words(source: str) -> str:
    return source.replace("_", " ") + " clips"


def _icc(ratings: NDArray[np.float64]) -> list[float | None]:
    return [_number(value) for value in icc_2k(ratings)]


def _means(table: NDArray[np.float64]) -> dict[str, Any]:
    """Return a mean with its intervals for other raters, other scenes, and both."""
    both = over_both(table)
    return _as_dict(both) | {"by_rater": _as_dict(over_raters(table)), "by_scene": _as_dict(over_scenes(table))}


def _shares(table: NDArray[np.float64]) -> dict[str, Any]:
    """Return a mean of shares, from 0 to 1, with its intervals for other raters, other scenes, and both."""
    raters, scenes = table.shape
    by_rater, by_scene = share_of(over_raters(table), raters), share_of(over_scenes(table), scenes)
    both = share_of(over_both(table), min(raters, scenes))
    return _as_dict(both) | {"by_rater": _as_dict(by_rater), "by_scene": _as_dict(by_scene)}


def _t(mean: Mean) -> float | None:
    """Return Student's t of a mean against 0; None if the mean has no standard error above 0."""
    return _number(mean.value / mean.error) if mean.error > 0.0 else None


def _as_dict(mean: Mean) -> dict[str, Any]:
    return {"value": _number(mean.value), "low": _number(mean.low), "high": _number(mean.high)}


def _number(value: float) -> float | None:
    return None if not math.isfinite(value) else float(value)
