"""The margin of an episode: its distance from a failure, negative for a failure, at the resolution of a tick."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.exam import MOVING, SEVERE_TTC
from vpsci_ros.safety import CONFLICT_TTC, HORIZON, clearance
from vpsci_ros.world import COLLISION, OUTCOME_NAMES

STANDING = 1.0  # [m] more clearance while the vehicle stands: who then walks into it is no failure of the vehicle


def margins(failure: str, episode: Episode) -> NDArray[np.float64]:
    """Return the margin of each pedestrian at each frame, float64[n, T].

    The margin of a collision is the clearance between the footprints [m], of one with a moving vehicle a metre more
    while it stands. At the end of an episode with a contact, which may lie between two ticks, it is 0 at most. That of
    a conflict is CurvTTC less the threshold [s].

    :param failure: the column of the exam's table that holds it.
    """
    if failure.endswith("conflict"):
        return np.fmin(episode.curvttc, HORIZON) - (CONFLICT_TTC if failure == "conflict" else SEVERE_TTC)
    vehicle, walks = (episode.x, episode.y, episode.heading), zip(episode.ped_x, episode.ped_y, strict=True)
    found = np.stack([clearance(*vehicle, *walk) for walk in walks])
    if episode.outcome == OUTCOME_NAMES[COLLISION]:
        found[:, -1] = np.minimum(found[:, -1], 0.0)
    if failure == "moving_collision":
        found = np.where(episode.speed > MOVING, found, found + STANDING)
    return found


def least_margin(failure: str, episode: Episode) -> float:
    """Return the least margin of an episode over its frames and pedestrians, see `margins`."""
    return float(np.fmin.reduce(margins(failure, episode), axis=None, initial=np.inf))
