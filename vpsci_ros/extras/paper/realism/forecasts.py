"""Forecasts of who goes first without a simulation: controls of the Brier score, probabilities float64[n]."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets, borrowable
from vpsci_ros.evaluation.simulators import donors, features_at

FOLDS = 5  # of a regression where the library has clips of the scored onsets

Floats = NDArray[np.float64]


def forecasts(onsets: Onsets, library: Onsets, seed: int) -> dict[str, Floats]:
    """Return name -> probability that the pedestrian goes first, float64[n] each, from other clips of the library.

    `base_rate`: the share of the library's onsets. `donors`: the share of the sampler's donors, an open one counts
    half. `logistic`: a logistic regression on the bank's eight features, left out where the library has one outcome.
    """
    first = library.pedestrian_first
    known, went = ~np.isnan(first), np.nan_to_num(first, nan=0.5)
    allowed = borrowable(onsets, library) & known
    base = np.divide(allowed @ went, allowed.sum(axis=1), out=np.full(len(onsets), 0.5), where=allowed.any(axis=1))
    out = {"base_rate": base, "donors": went[donors(onsets, library)].mean(axis=1)}
    fitted = _logistic(onsets, library, known, seed)
    return out if fitted is None else out | {"logistic": fitted}


def _logistic(onsets: Onsets, library: Onsets, known: NDArray[np.bool_], seed: int) -> Floats | None:
    from sklearn.linear_model import LogisticRegression

    here, there = features_at(onsets)[0], features_at(library)[0]
    middle, spread = there.mean(axis=0), there.std(axis=0) + 1e-9
    clips = np.unique(onsets.clip)
    shared = bool(np.isin(clips, library.clip).any())
    fold = np.random.default_rng(seed).permutation(len(clips)) % FOLDS if shared else np.zeros(len(clips), np.int64)
    out = np.empty(len(onsets))
    for number in np.unique(fold):
        scored = np.isin(onsets.clip, clips[fold == number])
        rows = known & ~np.isin(library.clip, clips[fold == number])
        if len(np.unique(library.pedestrian_first[rows])) < 2:
            return None
        model = LogisticRegression().fit((there[rows] - middle) / spread, library.pedestrian_first[rows])
        out[scored] = model.predict_proba((here[scored] - middle) / spread)[:, 1]
    return out
