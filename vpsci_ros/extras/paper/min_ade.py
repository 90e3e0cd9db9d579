"""minADE: the expected least error of some of the roll-outs, which is not proper: more spread makes it smaller."""

import numpy as np

from vpsci_ros.evaluation.onsets import Floats
from vpsci_ros.evaluation.roll_out_scores import errors

BEST_OF = 6  # roll-outs


def min_ade(positions: Floats, recorded: Floats, best_of: int = BEST_OF) -> Floats:
    """Return the expected least error of `best_of` randomly chosen roll-outs (if K is less, of all K), float64[n] [m].

    The expectation is over all choices of `best_of` of the K roll-outs, so it does not depend on their order.
    """
    each = np.sort(errors(positions, recorded), axis=1)
    count = each.shape[1]
    if count <= best_of:
        return each[:, 0]
    rank = np.arange(count)
    # the k-th smallest is the least of a choice if all others come from the count - 1 - k larger ones
    weight = np.zeros(count)
    left = 1.0
    for k in rank[: count - best_of + 1]:
        weight[k] = left * best_of / (count - k)
        left -= weight[k]
    result: Floats = each @ weight
    return result
