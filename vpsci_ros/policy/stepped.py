"""An actor at work, for networks other than the SST: by torch, step by step, for many parallel histories.

What `streaming.StreamingActor` is for the SST. Rows agree with the whole history to 1e-5; unlike there, their last
bits may depend on how many rows are worked together.
"""

from typing import TYPE_CHECKING, Union

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.config import SST
from vpsci_ros.policy.streaming import Draws, StreamingActor
from vpsci_ros.policy.weights import ActorWeights
from vpsci_ros.world.observation import ACTION_SIZE

if TYPE_CHECKING:
    from torch import Tensor


def actor_at_work(weights: ActorWeights, capacity: int) -> Union[StreamingActor, "SteppedActor"]:
    """Return what acts by these weights over `capacity` parallel histories."""
    return (StreamingActor if weights.network.encoder == SST else SteppedActor)(weights, capacity)


class SteppedActor:
    """The actor of one agent; see `StreamingActor`, whose methods these are.

    :param weights: `Weights.actor("vehicle")` or `Weights.actor("pedestrian")`.
    :param capacity: number of slots, B.
    """

    def __init__(self, weights: ActorWeights, capacity: int) -> None:
        from vpsci_ros.policy.models import make_actor

        self.capacity, self._actor = capacity, make_actor(weights.network)
        self._memories = self._actor.memory(capacity)
        self._before = np.zeros((capacity, ACTION_SIZE), np.float32)
        self.load(weights)

    def load(self, weights: ActorWeights) -> None:
        """See `StreamingActor.load`."""
        import torch

        self._actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in weights.tensors.items()})

    def step(
        self,
        observation: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        reset: NDArray[np.bool_],
        active: NDArray[np.bool_],
        draws: Draws | None = None,
        residual: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """See `StreamingActor.step`.

        :raises InvalidInput: residuals are given, which the SST alone takes.
        """
        if residual is not None:
            raise InvalidInput("these weights hold residuals of people, which an SST alone acts with; learn without")
        import torch

        from vpsci_ros.policy.layers import LayerMemory

        actions, rows = np.zeros((self.capacity, ACTION_SIZE), np.float32), np.flatnonzero(active)
        if rows.size == 0:
            return actions
        begun = torch.from_numpy(reset & active)
        for memory in self._memories:
            memory.clear(begun)
        self._before[reset & active] = 0.0
        at = torch.from_numpy(rows)
        own = [LayerMemory(*(part[at] for part in memory.parts)) for memory in self._memories]
        latent, noise = _drawn(draws, rows)
        with torch.no_grad():
            seen, before, risks = (torch.from_numpy(np.asarray(x)[rows]) for x in (observation, self._before, curvttc))
            actions[rows] = self._actor.draw(seen, before, risks, list(own), latent, noise).numpy()
        for memory, now in zip(self._memories, own, strict=True):
            for whole, part in zip(memory.parts, now.parts, strict=True):
                whole[at] = part
        self._before[rows] = actions[rows]
        return actions

    def executed(self, action: NDArray[np.float32], active: NDArray[np.bool_]) -> None:
        """See `StreamingActor.executed`."""
        self._before[active] = np.asarray(action, np.float32)[active]


def _drawn(draws: Draws | None, rows: NDArray[np.int64]) -> tuple["Tensor | None", "Tensor | None"]:
    """Return latent numbers and noise of the rows; nothing at a temperature of 0."""
    import torch

    if draws is None or draws.temperature == 0.0:
        return None, None
    latent, innovation = (torch.from_numpy(part[rows] * draws.temperature) for part in draws[:2])
    return latent, innovation
