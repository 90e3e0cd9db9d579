"""Exploration noise (16), a pure function of (seed, scenario, episode, step, agent): a run explores the same again."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.learning.config import ACTION_SIZE, AGENTS, RefineConfig
from vpsci_ros.world.counter_rng import STREAM_EXPLORATION, normals

_DEFAULT = RefineConfig()


def amplitude(episode: ArrayLike, config: RefineConfig = _DEFAULT) -> NDArray[np.float64]:
    """Return N(t) = N_0 exp(-beta t) + N_min of (16) [m/s2]; t is the number of the episode within its scenario.

    The paper leaves t open. Episodes rather than steps: with beta = 0.001 the noise fades over the 3,000 episodes of
    Table 8, and every step of an episode explores alike.
    """
    t = np.asarray(episode, np.float64)
    decayed: NDArray[np.float64] = config.noise_start * np.exp(-config.noise_decay * t) + config.noise_floor
    return decayed


def exploration_noise(
    seed: int, scenario: ArrayLike, episode: ArrayLike, step: ArrayLike, agent: int, config: RefineConfig = _DEFAULT
) -> NDArray[np.float32]:
    """Return noise to add to an action, float32[B, 2] [m/s2]: normal, with deviation `amplitude(episode)`.

    :param scenario, episode, step: whole numbers [B]; step counts policy steps since the hand-over.
    :param agent: index in `vpsci_ros.learning.config.AGENTS`; the two agents' noises are independent.
    """
    stream = STREAM_EXPLORATION + (np.asarray(step, np.int64) << 8)
    draws = normals(seed, scenario, episode, stream, ACTION_SIZE * len(AGENTS))
    own = draws[..., ACTION_SIZE * agent : ACTION_SIZE * (agent + 1)]
    return (amplitude(episode, config)[..., None] * own).astype(np.float32)
