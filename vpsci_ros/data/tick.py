"""One tick of a recorded world."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Tick(NamedTuple):
    """The world at one tick and what the safety monitor said of it.

    state: EPISODE[B], fields that the message does not carry are 0. curvttc float64[B] [s], distance float64[B] [m]:
    NaN where the bag holds no answer to this tick. time: log time in the bag [ns].
    """

    tick: int
    period: float
    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]
    time: int = 0
