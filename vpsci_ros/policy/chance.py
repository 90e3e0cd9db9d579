"""What a stochastic policy draws: who acts in an episode, and what happens to them, a pure function of its counters.

The numbers are normal and come from the counter-based generator by (seed, scenario, episode, agent) and, for what
changes from step to step, the episode's frame. So an episode draws the same in any batch, process and order, and the
same person acts again where control was given back and taken once more.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.world.counter_rng import STREAM_CHANCE, STREAM_PERSON, normals
from vpsci_ros.world.observation import ACTION_SIZE


def person(seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, agent: int, latent: int) -> NDArray[np.float32]:
    """Return what kind of person acts, float32[B, latent].

    :param scenario, episode: whole numbers [B].
    :param agent: index in `AGENTS`; the two agents' numbers are independent.
    """
    return normals(seed, scenario, episode, STREAM_PERSON[agent], latent).astype(np.float32)


def fresh(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, frame: ArrayLike, agent: int
) -> NDArray[np.float32]:
    """Return the new part of the noise at a frame, float32[B, 2]; `frame` whole numbers [B], the others as `person`."""
    stream = STREAM_CHANCE[agent] + (np.asarray(frame, np.int64) << 8)
    return normals(seed, scenario, episode, stream, ACTION_SIZE).astype(np.float32)
