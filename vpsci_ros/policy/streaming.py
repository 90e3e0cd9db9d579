"""Streaming inference: one new step for many parallel histories at O(1) cost, with stored state, without torch.

It gives the actions of `vpsci_ros.policy.actor.Actor` over a whole history, to 1e-5. Numba was chosen by measurement:
torch has no matrix product whose rows keep their bits when the batch changes, short of padding every batch to one fixed
shape, which costs more at every batch size and imports torch into each node.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.streaming_kernels import step_slots, take_in
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

ROWS = 64  # rows worked together, layer by layer, so that a layer's weights are read from memory once for all of them


class StreamingActor:
    """The actor of one agent over `capacity` parallel histories (slots).

    A row's result has the same bits whatever the capacity, the other rows, and its own place among them. Memory:
    about 42 kB a slot with the shape of Table 8, taken when a slot is first used.

    :param weights: `Weights.actor("vehicle")` or `Weights.actor("pedestrian")`.
    :param capacity: number of slots, B.
    :raises InvalidInput: a capacity below 1.
    """

    def __init__(self, weights: Weights, capacity: int) -> None:
        if capacity < 1:
            raise InvalidInput(f"capacity: expected at least one slot, got {capacity}")
        network = weights.network
        self.capacity = capacity
        self._network = network
        self._window, width = network.attention_window, network.hidden
        self._states = np.zeros((capacity, network.layers, width), np.float32)
        self._keys = np.zeros((capacity, network.layers, width, self._window), np.float32)
        self._values = np.zeros((capacity, network.layers, self._window, width), np.float32)
        self._risks = np.zeros((capacity, self._window), np.float32)
        self._counts = np.zeros(capacity, np.int64)
        self._action = np.zeros((capacity, ACTION_SIZE), np.float32)
        self._inputs = OBSERVATION_SIZE + ACTION_SIZE
        self._work = np.empty((6, ROWS, width), np.float32)
        self.load(weights)

    def load(self, weights: Weights) -> None:
        """Use other weights of the same shape from the next step on; histories continue.

        :raises InvalidInput: the networks differ in shape.
        """
        if weights.network != self._network:
            raise InvalidInput(f"weights: expected networks of {self._network}, got {weights.network}")
        names = "encoder.observation_mean", "encoder.observation_scale"
        self._scaling = tuple(weights.tensors[name].copy() for name in names)
        self._parameters = _kernel_parameters(weights)
        self._fading = weights.tensors["fading"][0]

    def step(
        self,
        observation: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        reset: NDArray[np.bool_],
        active: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Return the actions [m/s2], float32[B, 2], clipped to the action limit; zero where not active.

        :param observation: float32[B, 6], equation (6) or (7), in the vehicle's heading frame.
        :param curvttc: float64[B] [s]; infinity for none.
        :param reset: bool[B]: the history begins with this step, after the action that `executed` had last, or none;
            read where active.
        :param active: bool[B]: rows that take a step; all others keep their history untouched.
        :raises InvalidInput: wrong shapes, or an active observation or CurvTTC that is not a number.
        """
        for name, value, *more in (
            ("observation", observation, OBSERVATION_SIZE), ("curvttc", curvttc), ("reset", reset), ("active", active),
        ):  # fmt: skip
            if np.shape(value) != (self.capacity, *more):
                shape = self.capacity, *more
                raise InvalidInput(f"StreamingActor.step: {name}: expected shape {shape}, got {np.shape(value)}")
        actions = np.zeros((self.capacity, ACTION_SIZE), np.float32)
        rows: NDArray[np.int64] = np.flatnonzero(active)
        inputs = np.empty((rows.size, self._inputs), np.float32)
        risks = np.empty(rows.size, np.float32)
        seen, ttc = np.ascontiguousarray(observation, np.float32), np.ascontiguousarray(curvttc, np.float64)
        bad = take_in(rows, seen, ttc, reset, self._scaling, self._action, self._states, self._counts, inputs, risks)
        if bad >= 0:
            raise InvalidInput(
                f"StreamingActor.step: row {bad}: expected numbers, got observation {observation[bad]} "
                f"and CurvTTC {curvttc[bad]}"
            )
        limit = np.float32(self._network.action_limit)
        memory = (self._states, self._keys, self._values, self._risks, self._counts, self._window)
        step_slots(
            rows, inputs, risks, *self._parameters, self._fading, limit, *memory, self._work, self._action, actions
        )
        return actions

    def executed(self, action: NDArray[np.float32], active: NDArray[np.bool_]) -> None:
        """Append the executed actions [m/s2], float32[B, 2], to the histories where `active`.

        Without this call, histories contain the actions that `step` returned. Before a history begins, the acceleration
        with which the agent comes.
        """
        np.copyto(self._action, action, where=active[:, None])


def _kernel_parameters(weights: Weights) -> tuple[Any, ...]:
    """Return `entry, layers, head` of `step_slots`: transposed and stacked."""
    network, tensors = weights.network, weights.tensors
    inputs = ["observation", "action"]

    def dense(name: str) -> NDArray[np.float32]:
        return np.ascontiguousarray(tensors[f"{name}.weight"].T)

    def stacked(name: str) -> NDArray[np.float32]:
        return np.stack([tensors[f"encoder.layers.{i}.{name}"] for i in range(network.layers)])

    def stacked_dense(name: str) -> NDArray[np.float32]:
        return np.stack([dense(f"encoder.layers.{i}.{name}") for i in range(network.layers)])

    decay = (1.0 / (1.0 + np.exp(-stacked("decay_logit").astype(np.float64)))).astype(np.float32)
    drive = np.sqrt(np.float32(1.0) - decay * decay)
    entry = (
        np.concatenate([dense(f"encoder.{name}") for name in inputs]),
        tensors["encoder.observation.bias"].copy(),
    )
    layers = (
        decay,
        *(stacked(name) for name in ("skip", "risk_gain", "norm.weight", "norm.bias")),
        stacked_dense("input") * drive[:, None, :],
        *(stacked_dense(name) for name in ("query", "key", "attended", "readout")),
    )
    head = [dense("head.0"), tensors["head.0.bias"].copy()]
    head += [dense("head.2"), tensors["head.2.bias"].copy()]
    head += [dense("head.4"), tensors["head.4.bias"].copy()]
    return entry, layers, tuple(head)
