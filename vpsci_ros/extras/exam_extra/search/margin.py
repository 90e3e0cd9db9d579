"""The margin of an episode: its distance from a failure, negative for a failure, at the resolution of a tick."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.exam.config import MOVING, SEVERE_TTC
from vpsci_ros.safety import CONFLICT_TTC, HORIZON, clearance
from vpsci_ros.world import ENDED, IDLE

Floats = NDArray[np.float64]
STANDING = 1.0  # [m] more clearance while the vehicle stands: who then walks into it is no failure of the vehicle


def margin(failure: str, state: NDArray[np.void], curvttc: Floats) -> Floats:
    """Return the margin of each record of EPISODE[B] at this tick, float64[B]; infinity in idle slots.

    The margin of a collision is the clearance between the footprints [m], of one with a moving vehicle a metre more
    while it stands; it is 0 at most after a contact since the tick before. That of a conflict is CurvTTC less the
    threshold [s].

    :param failure: the column of the exam's table that holds it.
    :param curvttc: float64[B] [s].
    """
    if failure.endswith("conflict"):
        found = np.fmin(curvttc, HORIZON) - (CONFLICT_TTC if failure == "conflict" else SEVERE_TTC)
    else:
        place = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")
        found = clearance(*(state[name] for name in place))
        found = np.where(state["struck"] != 0, np.minimum(found, 0.0), found)
        if failure == "moving_collision":
            found = np.where(state["vehicle_speed"] > MOVING, found, found + STANDING)
    return np.where(state["status"] == IDLE, np.inf, found)


class LeastMargins:
    """The least margin of each episode, gathered tick by tick.

    :param failure: see `margin`.
    :ivar found: (scenario, episode) -> the least over all its pedestrians, of the episodes that have ended.
    """

    def __init__(self, failure: str) -> None:
        self.found: dict[Key, float] = {}
        self._failure = failure
        self._least: Floats = np.zeros(0)

    def add(self, state: NDArray[np.void], curvttc: Floats) -> None:
        """Process EPISODE[B] and CurvTTC [s], float64[B], of the next tick."""
        if not len(self._least):
            self._least = np.full(len(state), np.inf)
        self._least[state["frame"] == 0] = np.inf
        np.fmin(self._least, margin(self._failure, state, curvttc), out=self._least)
        for slot in np.flatnonzero(state["status"] == ENDED):
            key = int(state["scenario"][slot]), int(state["episode"][slot])
            self.found[key] = min(self.found.get(key, np.inf), float(self._least[slot]))
