"""What a stochastic policy draws: its latent numbers and the innovations of its noise, pure functions of counters.

The numbers are normal and come from the counter-based generator by (seed, scenario, episode, agent) and, for what
changes from step to step, the episode's frame. So an episode draws the same in any batch, process and order, and the
same latent numbers hold again where control was given back and taken once more.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.world.counter_rng import STREAM_INNOVATION, STREAM_LATENT, normals
from vpsci_ros.world.observation import ACTION_SIZE


def draw_latent(seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, agent: int, size: int) -> NDArray[np.float32]:
    """Return the latent numbers of an episode, what kind of person acts, float32[B, size].

    :param scenario, episode: whole numbers [B].
    :param agent: index in `AGENTS`; the two agents' numbers are independent.
    """
    return normals(seed, scenario, episode, STREAM_LATENT[agent], size).astype(np.float32)


def draw_innovation(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, frame: ArrayLike, agent: int
) -> NDArray[np.float32]:
    """Return the new part of the noise at a frame, float32[B, 2]; `frame` whole numbers [B], others as above."""
    stream = STREAM_INNOVATION[agent] + (np.asarray(frame, np.int64) << 8)
    return normals(seed, scenario, episode, stream, ACTION_SIZE).astype(np.float32)
