"""The vehicle's acceleration of its own: who goes first differs between drivers in the same situation.

A network answers a situation by one action. Of two recorded drivers one yields and the other goes on, and a reaction
between both is neither's. So a vehicle gets an acceleration along its heading at the first hand-over of an episode,
drawn for the episode, to which the network adds its own, and which fades while the network sees what comes of it. Ours,
not in the paper.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.world.counter_rng import STREAM_SPREAD, normals
from vpsci_ros.world.observation import STEP

FADING = 1.5  # [s] in which it falls to 1/e


def own_acceleration(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, step: ArrayLike, spread: float
) -> NDArray[np.float32]:
    """Return a vehicle's acceleration of its own [m/s2], float32[B, 2] as (longitudinal, lateral = 0).

    :param seed: whole number, one for all or [B].
    :param scenario, episode, step: whole numbers [B]; step counts policy frames since the episode's first hand-over.
    :param spread: standard deviation at the hand-over, `NetworkConfig.vehicle_spread` [m/s2].
    """
    unit = normals(seed, scenario, episode, STREAM_SPREAD, 1)[..., 0]
    along = spread * np.exp(-STEP / FADING * np.maximum(step, 0)) * unit
    return np.stack([along, np.zeros_like(along)], axis=-1).astype(np.float32)
