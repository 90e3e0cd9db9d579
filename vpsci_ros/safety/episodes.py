"""Properties of an episode: onset, conflict and least value from CurvTTC; collision and least distance from clearance.

An episode is an array over time, float[T], and a batch of them is float[..., T] with `lengths` int[...] where the
rows are padded: steps from a row's length on are ignored.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.safety.curvttc import CONFLICT_TTC, CRITICAL_TTC
from vpsci_ros.safety.inputs import FloatLike, Floats
from vpsci_ros.safety.series import padded


def onset(curvttc: FloatLike, *, lengths: ArrayLike | None = None, critical: float = CRITICAL_TTC) -> NDArray[np.int64]:
    """First step at which CurvTTC is at or below `critical` [s] (section 4.5 of the paper), int64[...]; -1: none.

    :param curvttc: float[..., T] [s], infinity where no contact is predicted.
    :param lengths: int[...], steps of each row that count; None: all T.
    :returns: int64[...], -1 where there is none.
    :raises InvalidInput: NaN or a negative value within a row's length, lengths that do not fit, no time axis.
    """
    values = padded("curvttc", curvttc, lengths)
    below = values <= critical
    return np.where(below.any(axis=-1), below.argmax(axis=-1), -1)[()]


def least_curvttc(curvttc: FloatLike, *, lengths: ArrayLike | None = None) -> Floats:
    """Least CurvTTC of each episode [s], float64[...]; arguments as for `onset`."""
    result: Floats = padded("curvttc", curvttc, lengths).min(axis=-1)
    return result


def is_conflict(
    curvttc: FloatLike, *, lengths: ArrayLike | None = None, below: float = CONFLICT_TTC
) -> NDArray[np.bool_]:
    """Whether CurvTTC falls below `below` [s] at any step (section 4.5), bool[...]; arguments as for `onset`."""
    return (least_curvttc(curvttc, lengths=lengths) < below)[()]


def least_clearance(clearance: FloatLike, *, lengths: ArrayLike | None = None) -> Floats:
    """Least clearance of each episode [m], float64[...]; below 0 where the footprints overlap.

    :param clearance: float[..., T] [m], `vpsci_ros.safety.clearance` at every step.
    :param lengths: int[...], steps of each row that count; None: all T.
    :raises InvalidInput: NaN within a row's length, lengths that do not fit, no time axis.
    """
    result: Floats = padded("clearance", clearance, lengths, signed=True).min(axis=-1)
    return result


def is_collision(clearance: FloatLike, *, lengths: ArrayLike | None = None) -> NDArray[np.bool_]:
    """Whether the footprints touch or overlap at any step, bool[...]; arguments as for `least_clearance`."""
    return (least_clearance(clearance, lengths=lengths) <= 0.0)[()]
