"""The state-space Transformer of equations (3) and (4): a structured recurrence, and attention over its last states.

One layer, for the width d and the heads of Table 8:

- (3) h_t = A h_{t-1} + B x_t with A = diag(a), 0 < a < 1 learned through a sigmoid, and B dense. B carries the factor
  sqrt(1 - a^2), so that the state's variance does not depend on how slowly it forgets (as in linear recurrent units,
  Orvieto et al. 2023, https://arxiv.org/abs/2303.06349). y_t = C h_t + D x_t, C dense, D diagonal.
- (4) queries W_q h_t, keys W_k h_i over the last `attention_window` states, this one included. A head's values are
  its slice of h_i, and W_o mixes the heads: the paper names no other projection, and B has mixed the state already.
- The gate of (4), "when CurvTTC < 5 s this mechanism prioritizes features contributing to imminent risk": every head
  adds g * clip(1 - CurvTTC_i / 5 s, 0, 1) to the logit of step i, g learned. At or above 5 s the gate is exactly zero.
- With `risk_input` the same risk enters with the observation, too, through a linear map: attention can only choose what
  to look at, and what to do about a danger depends on how near it is.
- The layer returns LayerNorm(x_t + y_t + W_o attention_t).

With `carry_state` the state and the attention's memory run through the whole history, so one more step costs O(1);
without it every output comes from its own window of `attention_window` inputs and nothing before.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.sst_step import StepWeights, recurrence, sst_step
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

NORMALISED_LIMIT = 6.0  # normalised observations are clipped to this: simulation leaves the range of the real data


def risk(curvttc: Tensor) -> Tensor:
    """Return clip(1 - CurvTTC / 5 s, 0, 1), float32, of any shape; infinity gives 0."""
    return (1.0 - curvttc.to(torch.float32) / CRITICAL_TTC).clamp(0.0, 1.0)


ABSENT = -1e9  # logit of a step before the history began


class Window(NamedTuple):
    """The last inputs of B histories for a network whose state starts again in every window, oldest first."""

    inputs: Tensor  # [B, W, hidden], filled from the front
    risks: Tensor  # [B, W], likewise
    held: Tensor  # int64[B] how many are there

    def appended(self, x: Tensor, risks: Tensor) -> "Window":
        """Return the window one step later; where it is full, the oldest input makes room."""
        size = self.inputs.shape[1]
        full = self.held == size
        inputs = torch.where(full[:, None, None], self.inputs.roll(-1, dims=1), self.inputs)
        past = torch.where(full[:, None], self.risks.roll(-1, dims=1), self.risks)
        here = torch.arange(size) == self.held.clamp(max=size - 1)[:, None]
        inputs = torch.where(here[..., None], x[:, None], inputs)
        return Window(inputs, torch.where(here, risks[:, None], past), (self.held + 1).clamp(max=size))


class StepState:
    """What a layer remembers of its history: h, and keys, values and gates of the last steps (lists, oldest first).

    Without carried state the first layer's holds the encoder's `window` instead.
    """

    def __init__(self) -> None:
        self.window: Window | None = None
        self.weights: StepWeights | None = None  # of the layer as it was at the first step
        self.h: Tensor | None = None
        self.keys: list[Tensor] = []
        self.values: list[Tensor] = []
        self.gates: list[Tensor] = []  # [B, heads], added to the logits

    def keep(self, rows: int) -> None:
        """Forget all but the first `rows` rows."""
        if self.window is not None:
            self.window = Window(*(part[:rows] for part in self.window))
        if self.h is not None and len(self.h) > rows:
            self.h = self.h[:rows]
            self.keys, self.values, self.gates = (
                [x[:rows] for x in part] for part in (self.keys, self.values, self.gates)
            )

    def repeated(self, times: int) -> "StepState":
        """Return the same with each row `times` times."""

        def again(part: Tensor) -> Tensor:
            return part.repeat_interleave(times, dim=0)

        out = StepState()
        out.window = None if self.window is None else Window(*map(again, self.window))
        out.h = None if self.h is None else again(self.h)
        out.keys, out.values, out.gates = (list(map(again, part)) for part in (self.keys, self.values, self.gates))
        return out


class EncoderLayer(nn.Module):
    """A layer of an encoder, over whole histories in training and step by step to the same result."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()

    def forward(self, x: Tensor, risks: Tensor, taken: Tensor | None = None) -> tuple[Tensor, StepState | None]:
        """See `SSTLayer.forward`."""
        raise NotImplementedError

    def step(self, x: Tensor, risks: Tensor, state: StepState) -> Tensor:
        """See `SSTLayer.step`."""
        raise NotImplementedError


class SSTLayer(EncoderLayer):
    """One state-space Transformer layer; see the module's docstring."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        width = config.hidden
        self.heads, self.window = config.heads, config.attention_window
        # Time constants from one step to fifty, evenly in the logarithm.
        decay = torch.exp(-1.0 / torch.exp(torch.linspace(0.0, math.log(50.0), width)))
        self.decay_logit = nn.Parameter(torch.logit(decay))
        self.input = nn.Linear(width, width, bias=False)
        self.query = nn.Linear(width, width, bias=False)
        self.key = nn.Linear(width, width, bias=False)
        self.attended = nn.Linear(width, width, bias=False)
        self.readout = nn.Linear(width, width, bias=False)
        self.skip = nn.Parameter(torch.zeros(width))
        self.risk_gain = nn.Parameter(torch.full((config.heads,), 0.5))
        self.norm = nn.LayerNorm(width)

    def decay(self) -> Tensor:
        """Return a, the diagonal of A in (3), float32[hidden]."""
        return torch.sigmoid(self.decay_logit)

    def forward(self, x: Tensor, risks: Tensor, taken: Tensor | None = None) -> tuple[Tensor, StepState | None]:
        """Return float32[B, T, hidden] for inputs float32[B, T, hidden] and risks float32[B, T] of whole histories.

        With `taken`, int64[B], also return what the layer remembers after the first `taken` steps of each row.
        """
        a = self.decay()
        h = recurrence(self.input(x) * torch.sqrt(1.0 - a * a), a)
        keys = self.key(h)
        context = self._attend(self.query(h), keys, h, risks)
        state = None if taken is None else self._remembered(h, keys, risks, taken)
        return self._output(x, h, context), state

    def step(self, x: Tensor, risks: Tensor, state: StepState) -> Tensor:
        """Return float32[B, hidden] for one more input float32[B, hidden] and risk float32[B]; `state` moves on."""
        if state.weights is None:
            state.weights = self._step_weights()
        state.gates = [*state.gates, self.risk_gain * risks[:, None]][-self.window :]
        keys, values = ([*part][len(part) + 1 - len(state.gates) :] for part in (state.keys, state.values))
        before = torch.zeros_like(x) if state.h is None else state.h
        out, state.h, key = sst_step(state.weights, x, before, torch.stack(state.gates, dim=1), [*keys, *values])
        state.keys, state.values = [*keys, key], [*values, state.h]
        return out

    def _step_weights(self) -> StepWeights:
        a, key_dimension = self.decay(), self.query.weight.shape[0] // self.heads
        query = self.query.weight / math.sqrt(key_dimension)
        return StepWeights(
            decay=a,
            driving=self.input.weight * torch.sqrt(1.0 - a * a)[:, None],
            spread=torch.cat([query, self.key.weight, self.readout.weight]),
            attended=self.attended.weight,
            passed=1.0 + self.skip,
            gain=self.norm.weight,
            bias=self.norm.bias,
        )

    def _remembered(self, h: Tensor, keys: Tensor, risks: Tensor, taken: Tensor) -> StepState:
        state, rows = StepState(), torch.arange(len(h))
        state.h = h[rows, (taken - 1).clamp(min=0)] * (taken > 0)[:, None]
        for age in range(min(self.window - 1, int(taken.max())), 0, -1):
            at = (taken - age).clamp(min=0)
            gate = self.risk_gain * risks[rows, at][:, None]
            state.keys.append(keys[rows, at])
            state.values.append(h[rows, at])
            state.gates.append(torch.where((taken >= age)[:, None], gate, ABSENT))
        return state

    def _output(self, x: Tensor, h: Tensor, context: Tensor) -> Tensor:
        out: Tensor = self.norm(x + self.readout(h) + self.skip * x + self.attended(context))
        return out

    def _attend(self, queries: Tensor, keys: Tensor, values: Tensor, risks: Tensor) -> Tensor:
        """Return each step's mix of the values of the last `window` steps, float32[B, T, hidden].

        One age after the other: a matrix of all steps by all steps is mostly steps too old to be attended to.
        """
        before, steps = self.window - 1, queries.shape[1]
        keys, values = (
            functional.pad(part, (0, 0, before, 0)).unflatten(2, (self.heads, -1)) for part in (keys, values)
        )
        gates = functional.pad(self.risk_gain * risks[..., None], (0, 0, before, 0), value=ABSENT)
        queries = queries.unflatten(2, (self.heads, -1)) / math.sqrt(keys.shape[-1])
        ages = [slice(first, first + steps) for first in range(self.window)]
        logits = [(queries * keys[:, age]).sum(dim=3) + gates[:, age] for age in ages]
        shares = torch.softmax(torch.stack(logits), dim=0)[..., None]
        return sum((s * values[:, age] for s, age in zip(shares, ages, strict=True)), torch.zeros(())).flatten(2)


class SSTEncoder(nn.Module):
    """Encodes a history H(t) = (O(1), A(1), ..., A(t-1), O(t)) of one agent (Algorithm 1).

    The observation, normalised by fixed statistics, the agent's own action of the step before and, with `risk_input`,
    the risk enter through one linear layer each; their sum is x_t of (3). Before the first step the action is zero.

    :param layer: class of its `config.layers` layers.
    """

    observation_mean: Tensor
    observation_scale: Tensor

    def __init__(self, config: NetworkConfig, layer: type[EncoderLayer] = SSTLayer) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("observation_mean", torch.zeros(OBSERVATION_SIZE))
        self.register_buffer("observation_scale", torch.ones(OBSERVATION_SIZE))
        self.observation = nn.Linear(OBSERVATION_SIZE, config.hidden)
        self.action = nn.Linear(ACTION_SIZE, config.hidden, bias=False)
        self.risk = nn.Linear(1, config.hidden, bias=False) if config.risk_input else None
        self.layers = nn.ModuleList(layer(config) for _ in range(config.layers))

    def embed(self, observation: Tensor, action_before: Tensor, risks: Tensor) -> Tensor:
        """Return x_t, float32[..., hidden].

        :param observation: [..., 6]; action_before: [..., 2] [m/s2]; risks: [...], `risk` of CurvTTC.
        """
        scaled = (observation - self.observation_mean) / self.observation_scale
        x: Tensor = self.observation(scaled.clamp(-NORMALISED_LIMIT, NORMALISED_LIMIT)) + self.action(action_before)
        return x if self.risk is None else x + self.risk(risks[..., None])

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """Encode whole histories.

        :param observation: float32[B, T, 6], equation (6) or (7).
        :param action_before: float32[B, T, 2], the agent's executed action of step t - 1 [m/s2]; zero at t = 0.
        :param curvttc: float32[B, T] [s].
        :returns: float32[B, T, hidden]; entry t knows steps 0 to t only.
        """
        risks = risk(curvttc)
        x = self.embed(observation, action_before, risks)
        if self.config.carry_state:
            return self._through(x, risks)
        window, (batch, steps, width) = self.config.attention_window, x.shape
        if steps <= window:
            return self._through(x, risks)
        head = self._through(x[:, : window - 1], risks[:, : window - 1])
        windows = x.unfold(1, window, 1).transpose(2, 3).reshape(-1, window, width)
        tail = self._through(windows, risks.unfold(1, window, 1).reshape(-1, window))[:, -1]
        return torch.cat([head, tail.view(batch, -1, width)], dim=1)

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """Encode as `forward` does, and return the layers' states after `taken` steps of each row.

        :param taken: int64[B], 0 for an empty history.
        """
        risks, states = risk(curvttc), []
        x = self.embed(observation, action_before, risks)
        if not self.config.carry_state:
            states = [StepState() for _ in self.layers]
            states[0].window = self._last_inputs(x, risks, taken)
            return self.forward(observation, action_before, curvttc), states
        for layer in self.layers:
            x, state = layer(x, risks, taken)
            states.append(state)
        return x, states

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """Encode one more step: observation [B, 6], action_before [B, 2], curvttc [B] -> [B, hidden].

        `states` holds one `StepState` a layer, new ones for an empty history. With `carry_state` a step costs O(1),
        without it as much as the window is long.
        """
        risks = risk(curvttc)
        x = self.embed(observation, action_before, risks)
        if not self.config.carry_state:
            window = states[0].window
            if window is None:
                none = torch.zeros(len(x), dtype=torch.long)
                window = self._last_inputs(x[:, None], risks[:, None], none)
            states[0].window = window = window.appended(x, risks)
            # Filled from the front, and no step sees a later one: what lies behind the newest does not matter.
            return self._through(window.inputs, window.risks)[torch.arange(len(x)), window.held - 1]
        for layer, state in zip(self.layers, states, strict=True):
            assert isinstance(layer, EncoderLayer)
            x = layer.step(x, risks, state)
        return x

    def _last_inputs(self, x: Tensor, risks: Tensor, taken: Tensor) -> Window:
        """Return the inputs that the first `taken` steps of each row leave in the window."""
        size = self.config.attention_window
        count = taken.clamp(max=size)
        at = (taken - count)[:, None] + torch.arange(size)
        filled = torch.arange(size) < count[:, None]
        rows, at = torch.arange(len(x))[:, None], at.clamp(max=x.shape[1] - 1)
        return Window(x[rows, at] * filled[..., None], risks[rows, at] * filled, count)

    def _through(self, x: Tensor, risks: Tensor) -> Tensor:
        for layer in self.layers:
            x, _ = layer(x, risks)
        return x
