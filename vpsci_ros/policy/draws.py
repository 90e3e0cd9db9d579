"""What a stochastic policy draws: its latent numbers and the innovations of its noise, pure functions of counters.

The numbers are normal and come from the counter-based generator by (seed, scenario, episode, agent, pedestrian) and,
for what changes from step to step, the episode's frame. So an episode draws the same in any batch, process and order,
and the same latent numbers hold again where control was given back and taken once more.
"""

import numpy as np
from numba import uint64
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_INNOVATION, STREAM_LATENT, normal_pair, normals, philox, unit
from vpsci_ros.world.observation import ACTION_SIZE

Keys = NDArray[np.uint64]


def keys(
    count: int,
    seed: ArrayLike,
    scenario: ArrayLike,
    episode: ArrayLike,
    pedestrian: ArrayLike = 0,
    frame: ArrayLike = 0,
) -> Keys:
    """Return by what `count` slots draw at a step, uint64[count, 5]: these five, each a whole number or one a slot."""
    made = np.empty((count, 5), np.uint64)
    for column, value in enumerate((seed, scenario, episode, pedestrian, frame)):
        made[:, column] = value
    return made


def keys_of(state: NDArray[np.void], seed: ArrayLike) -> Keys:
    """Return the `keys` of EPISODE[B] records, each at its own frame."""
    made = np.empty((len(state), 5), np.uint64)
    made[:, 0] = seed
    _keys(state, made)
    return made


@kernel
def _keys(state, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot = state[i]
        out[i, 1], out[i, 2], out[i, 3], out[i, 4] = slot.scenario, slot.episode, slot.pedestrian, slot.frame


def draw_latent(
    seed: ArrayLike, scenario: ArrayLike, episode: ArrayLike, agent: int, size: int, pedestrian: ArrayLike = 0
) -> NDArray[np.float32]:
    """Return the latent numbers of an episode, what kind of person acts, float32[B, size].

    :param scenario, episode: whole numbers [B].
    :param agent: index in `AGENTS`; the two agents' numbers are independent.
    :param pedestrian: number within the episode, whole numbers [B]; 0 for the driver.
    """
    return normals(seed, scenario, episode, STREAM_LATENT[agent], size, pedestrian).astype(np.float32)


def draw_innovation(key: Keys, agent: int, active: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the new part of the noise at a frame, float32[B, 2]; 0 where not active.

    The numbers of `normals` with a stream for each agent and frame, without its checks: a policy draws at every step,
    and they would cost more than a step of a small network.

    :param key: see `keys`; pedestrian 0 for the driver.
    :param active: bool[B].
    """
    out = np.zeros((len(active), ACTION_SIZE), np.float32)
    _fill(key, active, STREAM_INNOVATION[agent], out)
    return out


@kernel
def _fill(key, active, stream, out):  # type: ignore[no-untyped-def]
    for i in range(out.shape[0]):
        if active[i]:
            k = key[i]
            bits = philox(k[0], k[1], uint64(0), uint64(stream) + (k[4] << uint64(8)), k[2], k[3])
            out[i, 0], out[i, 1] = normal_pair(unit(bits[0]), unit(bits[1]))
