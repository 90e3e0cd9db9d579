"""The onset of an episode: the first step at which CurvTTC is critical."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety.curvttc import CRITICAL_TTC
from vpsci_ros.safety.inputs import FloatLike
from vpsci_ros.safety.series import trajectories


def onset(curvttc: FloatLike, *, critical: float = CRITICAL_TTC) -> NDArray[np.int64]:
    """First step at which CurvTTC is at or below `critical` [s] (section 4.5 of the paper), int64[...]; -1: none.

    :param curvttc: float[..., T] [s], infinity where no contact is predicted.
    :raises InvalidInput: NaN or a negative value, no time axis.
    """
    name = ("curvttc",)
    (rows,), _, shape = trajectories(name, (curvttc,), None, not_negative=name, may_be_infinite=name)
    below = rows <= critical
    return np.where(below.any(axis=-1), below.argmax(axis=-1), -1).reshape(shape)[()]
