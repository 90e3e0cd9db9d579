"""The held-out error: both protocols on near misses of clips that training never sees, for weights and controls."""

import polars as pl

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.evaluation.predictors import PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import Measured, eligible, measure
from vpsci_ros.policy.weights import Weights


class HeldOut:
    """Measures weights on held-out interactions.

    :ivar control: errors of the last velocity repeated.
    :param table: near-miss table of the held-out clips.
    :raises InvalidInput: no interaction has a second from its first critical step to the last.
    """

    def __init__(self, table: pl.DataFrame) -> None:
        self.interactions: Interactions = eligible(from_table(table))
        self.control = by_name(measure(RepeatVelocity(), self.interactions))

    def errors(self, weights: Weights) -> dict[str, float]:
        """Return the errors of weights, see `by_name`."""
        return by_name(measure(PolicyPredictor(weights), self.interactions))


def by_name(measured: Measured) -> dict[str, float]:
    """Return ADE and FDE [m] of both protocols by name (`closed_loop_ade`), means over interactions and agents."""
    return {
        f"{protocol}_{name}": float(getattr(errors, name).mean())
        for protocol, errors in measured.items()
        for name in ("ade", "fde")
    }
