"""Exploration noise (16), a pure function of (seed, scenario, episode, step, agent): repeated runs have equal noise.

The paper gives N(t) = N_0 exp(-beta t) + N_min and no unit, no t and no distribution. Here:

- N is a share of the largest acceleration, 5 m/s2: N_0 = 0.2 (1 m/s2) and N_min = 0.01 (0.05 m/s2).
- t counts training episodes. Eight scenarios run in turn, so it is eight times the number of the episode, and the
  noise has faded after the 3,000 episodes of Table 8. Noise is a function of the episode alone, so it does not know
  how many scenarios a run has: `DECAY` is for eight.
- The noise is normal, and its value is the scaled sum of the last ten steps' independent draws: an agent must lean one
  way for a second to get anywhere, as with the Ornstein-Uhlenbeck noise of the authors' earlier work.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.policy.policy_config import NoiseConfig
from vpsci_ros.world.counter_rng import STREAM_EXPLORATION, normals
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS

MEMORY = 10  # steps whose draws add up
SCENARIOS = 8  # that run in turn
DECAY = 0.001  # beta of (16), per training episode
_DEFAULT = NoiseConfig()


def amplitude(episode: ArrayLike, config: NoiseConfig = _DEFAULT) -> NDArray[np.float64]:
    """Return N(t) of (16), a share of the largest acceleration, for the number of an episode within its scenario."""
    t = SCENARIOS * np.asarray(episode, np.float64)
    share: NDArray[np.float64] = config.start * np.exp(-DECAY * t) + config.floor
    return share


def exploration_noise(
    seed: ArrayLike,
    scenario: ArrayLike,
    episode: ArrayLike,
    step: ArrayLike,
    agent: int,
    config: NoiseConfig = _DEFAULT,
    limit: float = 5.0,
) -> NDArray[np.float32]:
    """Return noise to add to an action, float32[B, 2] [m/s2]: normal, with deviation `limit * amplitude(episode)`.

    :param seed: whole number, one for all or [B].
    :param scenario, episode, step: whole numbers [B]; step counts policy frames since the episode's first hand-over.
    :param agent: index in `vpsci_ros.world.observation.AGENTS`; the two agents' noises are independent.
    :param limit: the largest acceleration, `NetworkConfig.action_limit` [m/s2].
    """
    step = np.asarray(step, np.int64)
    past = step[..., None] - np.arange(MEMORY)
    real = past >= 0
    stream = STREAM_EXPLORATION + (np.maximum(past, 0) << 8)
    keys = (np.asarray(scenario)[..., None], np.asarray(episode)[..., None])
    draws = normals(np.asarray(seed)[..., None], *keys, stream, ACTION_SIZE * len(AGENTS))
    own = draws[..., ACTION_SIZE * agent : ACTION_SIZE * (agent + 1)] * real[..., None]
    unit = own.sum(axis=-2) / np.sqrt(np.maximum(real.sum(axis=-1), 1))[..., None]  # step -1: no history
    return (limit * amplitude(episode, config)[..., None] * unit).astype(np.float32)
