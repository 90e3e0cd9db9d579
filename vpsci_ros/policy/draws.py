"""Keys of the policies' random numbers: pure functions of seed, scenario, episode, pedestrian and frame.

So an episode draws the same numbers in any batch, process and order.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.world.compiled import kernel

Keys = NDArray[np.uint64]


def keys(
    count: int,
    seed: ArrayLike,
    scenario: ArrayLike,
    episode: ArrayLike,
    pedestrian: ArrayLike = 0,
    frame: ArrayLike = 0,
) -> Keys:
    """Return the random keys of `count` slots at a step, uint64[count, 5]; arguments are scalars or [count]."""
    made = np.empty((count, 5), np.uint64)
    for column, value in enumerate((seed, scenario, episode, pedestrian, frame)):
        made[:, column] = value
    return made


def keys_of(state: NDArray[np.void], seed: ArrayLike) -> Keys:
    """Return the `keys` of EPISODE[B] records, each at its own frame, uint64[B, 5]."""
    made = np.empty((len(state), 5), np.uint64)
    made[:, 0] = seed
    _keys(state, made)
    return made


@kernel
def _keys(state, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot = state[i]
        out[i, 1], out[i, 2], out[i, 3], out[i, 4] = slot.scenario, slot.episode, slot.pedestrian, slot.frame
