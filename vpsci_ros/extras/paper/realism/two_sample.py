"""The two-sample test by a classifier: how gradient boosting separates simulations from unseen recordings.

The area under the curve (AUC) is 0.5 where nothing gives a simulation away, and 1 where everything does. See
'Revisiting classifier two-sample tests' by Lopez-Paz and Oquab, ICLR 2017 (https://arxiv.org/abs/1610.06545).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.statistics import cluster_counts, interval

Floats = NDArray[np.float64]
Labels = tuple[NDArray[np.str_], NDArray[np.str_]]
FOLDS = 5
REPETITIONS = 6  # one alone has a standard deviation of 0.01 to 0.02
FAMILIES = ("all", "vehicle", "pedestrian", "joint")


class TwoSample(NamedTuple):
    """The result of the classifier test: its AUC, and the features that give simulations away."""

    auc: float  # area under the curve, each scored by a fold that has not seen its unit; mean of the repetitions
    auc_interval: tuple[float, float]  # 95%, units resampled
    picked: float  # two-alternative forced choice: how often the recording of a pair gets the higher score
    importance: dict[str, float]  # AUC of single features without a classifier, the five farthest from 0.5


def two_sample(
    recorded: Mapping[str, Floats],
    simulated: Sequence[Mapping[str, Floats]],
    units: Labels,
    seed: int,
    *,
    paired: bool = True,
    repetitions: int = REPETITIONS,
) -> TwoSample:
    """Return how well a classifier separates recordings from simulations of units that it was not trained on.

    :param recorded: feature -> float64[n].
    :param simulated: feature -> float64[m, K], K simulations that share a weight of 1; a mapping for each repetition,
        taken again from the first where there are fewer.
    :param units: what is held out as a whole, of each recording and of each simulation, see `statistics.units_of`.
    :param paired: row i of both begins alike: a pair of the forced choice is such a row. Else all pairs count.
    :raises InvalidInput: fewer than two units.
    """
    names = list(recorded)
    real = np.stack([recorded[name] for name in names], axis=1)
    every = [np.stack([one[name] for name in names], axis=2) for one in simulated]
    made = every[0]
    wins: Floats = np.mean([_once(real, every[k % len(every)], units, seed + k) for k in range(repetitions)], axis=0)
    picked = float(wins[np.arange(len(real)), np.arange(len(real))].mean()) if paired else float(wins.mean())
    single = {name: float(_wins(real[:, i], made[:, :, i]).mean()) for i, name in enumerate(names)}
    farthest = sorted(single, key=lambda name: -abs(single[name] - 0.5))[:5]
    return TwoSample(
        float(wins.mean()),
        _interval(wins, units, seed),
        picked,
        {name: single[name] for name in farthest},
    )


def _once(real: Floats, made: Floats, units: Labels, seed: int) -> Floats:
    """Return how often each recording gets a higher score than each simulation, float64[n, m].

    :param real: float64[n, F] features; made: float64[m, K, F].
    """
    draws = made.shape[1]
    x = np.concatenate([real, made.reshape(-1, made.shape[2])])
    y = np.concatenate([np.ones(len(real)), np.zeros(made.shape[0] * draws)])
    weight = np.where(y == 1.0, 1.0, 1.0 / draws)
    owner = np.concatenate([units[0], np.repeat(units[1], draws)]).astype(str)
    scores = _held_out_scores(x, y, weight, owner, seed)
    return _wins(scores[: len(real)], scores[len(real) :].reshape(-1, draws))


def family(features: Mapping[str, Floats], name: str) -> dict[str, Floats]:
    """Return the features of one of `FAMILIES` and the features of the start."""
    return {key: value for key, value in features.items() if name == "all" or key.startswith((f"{name}_", "start_"))}


def _wins(real: Floats, made: Floats) -> Floats:
    """Return [n, m]: the share of the draws of simulation j that score less than recording i, ties by half."""
    less = made[None] < real[:, None, None]
    equal = made[None] == real[:, None, None]
    result: Floats = (less + 0.5 * equal).mean(axis=2)
    return result


def _held_out_scores(x: Floats, y: Floats, weight: Floats, owner: NDArray[np.str_], seed: int) -> Floats:
    from sklearn import config_context
    from sklearn.ensemble import GradientBoostingClassifier
    from sklearn.model_selection import StratifiedGroupKFold

    count = min(FOLDS, len(np.unique(owner[y == 1.0])))
    if count < 2:
        raise InvalidInput("two-sample test: expected recordings of two clips or vehicles, got one; give more")
    if len(np.unique(owner[y == 0.0])) < 2:
        raise InvalidInput("two-sample test: expected generated episodes of two scenarios, got one; give more")
    scores = np.zeros(len(y))
    folds = StratifiedGroupKFold(count, shuffle=True, random_state=seed)
    for training, held in folds.split(x, y, owner):
        model = GradientBoostingClassifier(
            n_estimators=75, learning_rate=0.2, max_depth=3, subsample=0.7, max_features=8, random_state=seed
        )
        with config_context(skip_parameter_validation=True, assume_finite=True):  # checks of each tree: a fifth
            model.fit(x[training], y[training], sample_weight=weight[training])
        scores[held] = model.decision_function(x[held])
    return scores


def _interval(wins: Floats, units: Labels, seed: int) -> tuple[float, float]:
    """Return the 95% interval of the mean of wins [n, m], units of both sides resampled together."""
    names, owner = np.unique(np.concatenate(units), return_inverse=True)
    sides = [np.eye(len(names))[part] for part in (owner[: len(wins)], owner[len(wins) :])]
    drawn = cluster_counts(np.arange(len(names)), seed)
    sums = ((drawn @ (sides[0].T @ wins @ sides[1])) * drawn).sum(axis=1)
    pairs = (drawn @ sides[0].sum(axis=0)) * (drawn @ sides[1].sum(axis=0))
    return interval(np.divide(sums, pairs, out=np.full(len(sums), np.nan), where=pairs > 0.0))
