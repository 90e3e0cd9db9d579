"""Inference of networks other than the SST: torch computes the whole history at each step.

`SteppedActor` has the methods of `streaming.StreamingActor`, which is for the SST. Rows agree with the whole history to
1e-5. Unlike there, the last bits of a row may depend on the number of rows, and the cost of a step grows with the
history.
"""

from typing import Union

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_config import SST
from vpsci_ros.policy.streaming import StreamingActor
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

STEPS = 128  # of a history, before its memory doubles


def actor_at_work(weights: Weights, capacity: int) -> Union[StreamingActor, "SteppedActor"]:
    """Return the actor of these weights for `capacity` parallel histories."""
    return (StreamingActor if weights.network.encoder == SST else SteppedActor)(weights, capacity)


class SteppedActor:
    """The actor of one agent, with the methods of `StreamingActor`.

    :param weights: `Weights.actor("vehicle")` or `Weights.actor("pedestrian")`.
    :param capacity: number of slots, B.
    """

    def __init__(self, weights: Weights, capacity: int) -> None:
        from vpsci_ros.policy.models import make_actor

        self.capacity, self._network, self._actor = capacity, weights.network, make_actor(weights.network)
        self._seen = np.zeros((capacity, STEPS, OBSERVATION_SIZE + ACTION_SIZE + 1), np.float32)  # CurvTTC at the end
        self._taken = np.zeros(capacity, np.int64)  # steps of each history
        self._before = np.zeros((capacity, ACTION_SIZE), np.float32)
        self.load(weights)

    def load(self, weights: Weights) -> None:
        """Use other weights of the same shape from the next step on; histories continue.

        :raises InvalidInput: the networks differ in shape.
        """
        import torch

        if weights.network != self._network:
            raise InvalidInput(f"weights: expected networks of {self._network}, got {weights.network}")
        self._actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in weights.tensors.items()})

    def step(
        self,
        observation: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        reset: NDArray[np.bool_],
        active: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Return the actions of a step, see `StreamingActor.step`."""
        import torch

        actions, rows = np.zeros((self.capacity, ACTION_SIZE), np.float32), np.flatnonzero(active)
        if rows.size == 0:
            return actions
        self._taken[reset & active] = 0
        if self._taken[rows].max() == self._seen.shape[1]:
            self._seen = np.concatenate([self._seen, np.zeros_like(self._seen)], axis=1)
        new = observation[rows], self._before[rows], np.asarray(curvttc, np.float32)[rows, None]
        self._seen[rows, self._taken[rows]] = np.concatenate(new, axis=1)
        self._taken[rows] += 1
        last = self._taken[rows] - 1
        past = torch.from_numpy(self._seen[rows, : last.max() + 1])
        with torch.no_grad():
            said = self._actor(past[..., :OBSERVATION_SIZE], past[..., OBSERVATION_SIZE:-1], past[..., -1])
        actions[rows] = self._before[rows] = said.numpy()[np.arange(rows.size), last]
        return actions

    def executed(self, action: NDArray[np.float32], active: NDArray[np.bool_]) -> None:
        """Append the executed actions, see `StreamingActor.executed`."""
        self._before[active] = np.asarray(action, np.float32)[active]
