"""Scores of roll-outs against recordings: energy score and ADE, each an array over interactions.

The energy score is proper: its expectation is least for the distribution that the recordings come from, and neither for
a mean trajectory nor for additional spread. See 'Strictly proper scoring rules, prediction, and estimation'
by Gneiting and Raftery, JASA 102, 2007. Here the distance of two joint trajectories is the mean over both agents
and all steps of the distance between positions, so that for one roll-out the score is the ADE.
"""

import numpy as np

from vpsci_ros.evaluation.onsets import Floats


def errors(positions: Floats, recorded: Floats) -> Floats:
    """Return each roll-out's mean distance to the recording, float64[n, K] [m] (the ADE of each).

    :param positions: float64[n, K, 2, T, 2] [m]; recorded: float64[n, 2, T, 2] [m].
    """
    apart = positions - recorded[:, None]
    distance: Floats = np.hypot(apart[..., 0], apart[..., 1]).mean(axis=(2, 3))
    return distance


def energy_score(positions: Floats, recorded: Floats) -> Floats:
    """Return the energy score, float64[n] [m]: mean error minus half the mean distance of two different roll-outs.

    Distances of a roll-out to itself do not count, so that the expectation does not depend on K.

    :param positions: float64[n, K, 2, T, 2] [m]; recorded: float64[n, 2, T, 2] [m].
    """
    count = positions.shape[1]
    score: Floats = errors(positions, recorded).mean(axis=1)
    if count == 1:
        return score
    total = np.zeros(len(positions))
    for k in range(count - 1):
        apart = positions[:, k + 1 :] - positions[:, k : k + 1]
        total += np.hypot(apart[..., 0], apart[..., 1]).mean(axis=(2, 3)).sum(axis=1)
    return score - total / (count * (count - 1))
