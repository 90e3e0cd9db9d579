"""One tick of a recorded world."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class RecordedTick(NamedTuple):
    """The world at one tick and what the safety monitor said of it; NaN where the bag holds no answer to the tick."""

    number: int
    period: float  # [s] from one tick to the next
    state: NDArray[np.void]  # EPISODE[B]; fields that the message does not carry are 0
    curvttc: NDArray[np.float64]  # [B] [s]
    distance: NDArray[np.float64]  # [B] [m]
    time: int = 0  # [ns] log time in the bag
