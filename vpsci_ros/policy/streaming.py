"""An actor at work: one new step for many parallel histories at O(1) cost, with carried state and without torch.

The same function as `vpsci_ros.policy.actor.Actor` over a whole history, to 1e-5. Numba was chosen by measurement
(benchmarks/bench_policy.py): torch has no matrix product whose rows keep their bits when the batch changes, short
of padding every batch to one fixed shape, which costs more at every batch size and imports torch into each node.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.streaming_kernels import step_rows, take_draws
from vpsci_ros.policy.weights import ActorWeights
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

ROWS = 64  # rows worked together, layer by layer, so that a layer's weights are read from memory once for all of them
NORMALISED_LIMIT = 6.0  # as in `vpsci_ros.policy.sst`


class Draws(NamedTuple):
    """What a stochastic actor draws for a step of its B slots; only active rows are read.

    :ivar latent: float32[B, latent], standard normal numbers that stay the same all episode.
    :ivar innovation: float32[B, 2], standard normal numbers that are new at every step.
    :ivar temperature: factor on both; 1: as learned, 0: the deterministic middle.
    """

    latent: NDArray[np.float32]
    innovation: NDArray[np.float32]
    temperature: np.float32


class StreamingActor:
    """The actor of one agent over `capacity` parallel histories (slots).

    A row's result has the same bits whatever the capacity, the other rows, its own place among them, and the number of
    threads. Memory: about 42 kB a slot with the shape of Table 8, taken when a slot is first used.

    :param weights: `Weights.actor("vehicle")` or `Weights.actor("pedestrian")`.
    :param capacity: number of slots, B.
    :param threads: threads that share a step of more than 64 active rows.
    """

    def __init__(self, weights: ActorWeights, capacity: int, threads: int = 1) -> None:
        if capacity < 1:
            raise InvalidInput(f"capacity: expected at least one slot, got {capacity}")
        network = weights.network
        self.capacity = capacity
        self._network = network
        self._window, width = network.attention_window, network.hidden
        shape = (capacity, network.layers, self._window)
        self._states = np.zeros((capacity, network.layers, width), np.float32)
        self._keys = np.zeros((*shape, network.key_dimension, network.heads), np.float32)
        self._values = np.zeros((*shape, width), np.float32)
        self._risks = np.zeros((capacity, self._window), np.float32)
        self._counts = np.zeros(capacity, np.int64)
        self._action = np.zeros((capacity, ACTION_SIZE), np.float32)
        self._latent = np.zeros((capacity, network.latent), np.float32)
        self._noise, self._burst = (np.zeros((capacity, ACTION_SIZE), np.float32) for _ in range(2))
        # The inputs of the last steps, for networks whose state starts again in every window.
        memory = 0 if network.carry_state else self._window
        self._inputs = np.zeros((memory, capacity, OBSERVATION_SIZE + ACTION_SIZE + network.risk_input), np.float32)
        self._past_risks = np.zeros((memory, capacity), np.float32)
        self._taken = np.zeros(capacity, np.int64)
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self._work = [np.empty((6, ROWS, width), np.float32) for _ in range(threads)]
        self.load(weights)

    def load(self, weights: ActorWeights) -> None:
        """Act with other weights of the same shape from the next step on; histories are kept.

        :raises InvalidInput: the networks differ in shape.
        """
        if weights.network != self._network:
            raise InvalidInput(f"weights: expected networks of {self._network}, got {weights.network}")
        self._mean = weights.tensors["encoder.observation_mean"].copy()
        self._scale = weights.tensors["encoder.observation_scale"].copy()
        if self._network.latent:
            kept = 1.0 / (1.0 + np.exp(-weights.tensors["persistence_logit"].astype(np.float64)))
            still = weights.tensors["stillness"]
            self._stillness = np.maximum(still * still, np.float32(1e-12))
            self._persistence, self._renewal = np.float32(kept[0]), np.float32(np.sqrt(1.0 - kept[0] ** 2))
        self._parameters = _kernel_parameters(weights)

    def step(
        self,
        observation: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        reset: NDArray[np.bool_],
        active: NDArray[np.bool_],
        draws: Draws | None = None,
        residual: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """Return the actions [m/s2], float32[B, 2], clipped to the action limit; zero where not active.

        :param observation: float32[B, 6], equation (6) or (7), in the vehicle's heading frame.
        :param curvttc: float64[B] [s]; infinity for none.
        :param reset: bool[B]: the history begins with this step; read where active.
        :param active: bool[B]: rows that take a step; all others keep their history untouched.
        :param draws: of a network with latent numbers; None: the deterministic middle.
        :param residual: float32[B, 2] [m/s2], added to the actions of a network without latent numbers.
        :raises InvalidInput: wrong shapes, or an active observation or CurvTTC that is not a number.
        """
        rows = self._rows(observation, curvttc, reset, active)
        actions = np.zeros((self.capacity, ACTION_SIZE), np.float32)
        if rows.size == 0:
            return actions
        begun = rows[reset[rows]]
        self._begin(begun)
        self._action[begun] = 0.0
        self._taken[begun] = 0
        scaled = (np.asarray(observation, np.float32)[rows] - self._mean) / self._scale
        risks = np.clip(np.float32(1.0) - np.asarray(curvttc, np.float32)[rows] / np.float32(CRITICAL_TTC), 0.0, 1.0)
        parts = [np.clip(scaled, -NORMALISED_LIMIT, NORMALISED_LIMIT), self._action[rows]]
        if self._network.risk_input:
            parts.append(risks[:, None].astype(np.float32))
        inputs = np.concatenate(parts, axis=1)
        if draws is not None and self._network.latent:
            self._take_draws(draws, rows, reset)
        else:
            self._latent[rows] = 0.0
            self._burst[rows] = 0.0 if residual is None else residual[rows]
        if self._network.carry_state:
            actions[rows] = self._advance(rows, inputs, risks.astype(np.float32))
        else:
            actions[rows] = self._windowed(rows, inputs, risks.astype(np.float32))
        self._taken[rows] += 1
        self._action[rows] = actions[rows]
        return actions

    def executed(self, action: NDArray[np.float32], active: NDArray[np.bool_]) -> None:
        """Take the actions [m/s2] that were executed where `active`, float32[B, 2], into the history.

        Without this call the returned actions enter it.
        """
        self._action[active] = np.asarray(action, np.float32)[active]

    def _take_draws(self, draws: Draws, rows: NDArray[np.int64], reset: NDArray[np.bool_]) -> None:
        """Take in the latent numbers of `rows` and carry their noise on."""
        kept = self._persistence, self._renewal, self._stillness
        take_draws(rows, reset, *draws, *kept, self._latent, self._noise, self._burst)

    def _begin(self, slots: NDArray[np.int64]) -> None:
        self._counts[slots] = 0
        self._states[slots] = 0.0

    def _windowed(
        self, rows: NDArray[np.int64], inputs: NDArray[np.float32], risks: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Replay the last inputs of each row into an empty state, rows of equally long windows together."""
        place = self._taken[rows] % self._window
        self._inputs[place, rows], self._past_risks[place, rows] = inputs, risks
        self._begin(rows)
        out = np.zeros((rows.size, ACTION_SIZE), np.float32)
        for age in range(self._window - 1, -1, -1):
            has = np.flatnonzero(self._taken[rows] >= age)
            if has.size:
                slot, at = rows[has], (self._taken[rows[has]] - age) % self._window
                out[has] = self._advance(slot, self._inputs[at, slot], self._past_risks[at, slot])
        return out

    def _advance(
        self, rows: NDArray[np.int64], inputs: NDArray[np.float32], risks: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        out = np.empty((rows.size, ACTION_SIZE), np.float32)
        memory = (self._states, self._keys, self._values, self._risks, self._counts, self._window)
        limit = np.float32(self._network.action_limit)

        def work(thread: int, chunks: range) -> None:
            for start in chunks:
                part = slice(start, start + ROWS)
                step_rows(
                    rows[part],
                    inputs[part],
                    risks[part],
                    (self._latent[rows[part]], self._burst[rows[part]]),
                    *self._parameters,
                    limit,
                    *memory,
                    self._work[thread],
                    out[part],
                )

        starts = range(0, rows.size, ROWS)
        if self._pool is None or len(starts) == 1:
            work(0, starts)
        else:
            share = math.ceil(len(starts) / self._threads)
            parts = [starts[i * share : (i + 1) * share] for i in range(self._threads)]
            list(self._pool.map(work, range(self._threads), parts))
        return out

    def _rows(
        self, observation: NDArray[Any], curvttc: NDArray[Any], reset: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        expected = {"observation": (self.capacity, OBSERVATION_SIZE), "curvttc": (self.capacity,)}
        expected |= {"reset": (self.capacity,), "active": (self.capacity,)}
        given = {"observation": observation, "curvttc": curvttc, "reset": reset, "active": active}
        for name, shape in expected.items():
            if np.shape(given[name]) != shape:
                raise InvalidInput(f"StreamingActor.step: {name}: expected shape {shape}, got {np.shape(given[name])}")
        rows: NDArray[np.int64] = np.flatnonzero(active)
        bad = rows[~np.isfinite(observation[rows]).all(axis=1) | np.isnan(curvttc[rows])]
        if bad.size:
            raise InvalidInput(
                f"StreamingActor.step: row {bad[0]}: expected numbers, got observation {observation[bad[0]]} "
                f"and CurvTTC {curvttc[bad[0]]}"
            )
        return rows


def _kernel_parameters(weights: ActorWeights) -> tuple[Any, ...]:
    """Return the arguments `entry, layers, head` of `step_rows`: transposed, stacked by layer, keys by (key, head)."""
    network, tensors = weights.network, weights.tensors
    inputs = ["observation", "action", *(["risk"] if network.risk_input else [])]

    def dense(name: str) -> NDArray[np.float32]:
        return np.ascontiguousarray(tensors[f"{name}.weight"].T)

    def stacked(name: str) -> NDArray[np.float32]:
        return np.stack([tensors[f"encoder.layers.{i}.{name}"] for i in range(network.layers)])

    def stacked_dense(name: str) -> NDArray[np.float32]:
        return np.stack([dense(f"encoder.layers.{i}.{name}") for i in range(network.layers)])

    decay = (1.0 / (1.0 + np.exp(-stacked("decay_logit").astype(np.float64)))).astype(np.float32)
    drive = np.sqrt(np.float32(1.0) - decay * decay)
    by_key = np.arange(network.hidden).reshape(network.heads, network.key_dimension).T.reshape(-1)
    entry = (
        np.concatenate([dense(f"encoder.{name}") for name in inputs]),
        tensors["encoder.observation.bias"].copy(),
    )
    layers = (
        decay,
        *(stacked(name) for name in ("skip", "risk_gain", "norm.weight", "norm.bias")),
        stacked_dense("input") * drive[:, None, :],
        np.ascontiguousarray(stacked_dense("query")[:, :, by_key]),
        np.ascontiguousarray(stacked_dense("key")[:, :, by_key]),
        stacked_dense("attended"),
        stacked_dense("readout"),
    )
    first = dense("head.0")
    head = [first[: network.hidden].copy(), first[network.hidden :].copy(), tensors["head.0.bias"].copy()]
    for i in (2, 4):
        head += [dense(f"head.{i}"), tensors[f"head.{i}.bias"].copy()]
    return entry, layers, tuple(head)
