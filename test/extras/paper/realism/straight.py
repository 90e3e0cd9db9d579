"""The plainest simulator: both agents keep the velocity of the onset."""

import numpy as np

from vpsci_ros.evaluation.onsets import STEPS, Onsets
from vpsci_ros.world.observation import STEP


def constant_velocity(onsets: Onsets) -> np.ndarray:
    """Return positions of both agents at the velocity of the onset, float64[n, 1, 2, 30, 2] [m]."""
    start, time = onsets.start, STEP * np.arange(1, STEPS + 1)[None, :, None]
    places = [start[:, None, at : at + 2] + start[:, None, at + by : at + by + 2] * time for at, by in ((0, 3), (5, 2))]
    return np.stack(places, axis=1)[:, None]
