"""The state-space Transformer of equations (3) and (4): a structured recurrence, and attention over its last states.

One layer, for the width d and the heads of Table 8:

- (3) h_t = A h_{t-1} + B x_t with A = diag(a), 0 < a < 1 learned through a sigmoid, and B dense. B carries the factor
  sqrt(1 - a^2), so that the state's variance does not depend on how slowly it forgets (as in linear recurrent units,
  Orvieto et al. 2023, https://arxiv.org/abs/2303.06349). y_t = C h_t + D x_t, C dense, D diagonal.
- (4) queries W_q h_t, keys W_k h_i over the last `attention_window` states, this one included. A head's values are
  its slice of h_i, and W_o mixes the heads: the paper names no other projection, and B has mixed the state already.
- The gate of (4), "when CurvTTC < 5 s this mechanism prioritizes features contributing to imminent risk": every head
  adds g * clip(1 - CurvTTC_i / 5 s, 0, 1) to the logit of step i, g learned. At or above 5 s the gate is exactly zero.
- The layer returns LayerNorm(x_t + y_t + W_o attention_t).

State and attention's memory run through the whole history: one more step costs O(1) (`vpsci_ros.policy.streaming`).
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, cast

import torch
from torch import Tensor, nn

from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

NORMALISED_LIMIT = 6.0  # normalised observations are clipped to this: simulation leaves the range of the real data


def risk(curvttc: Tensor) -> Tensor:
    """Return clip(1 - CurvTTC / 5 s, 0, 1), float32, of any shape; infinity gives 0."""
    return (1.0 - curvttc.to(torch.float32) / CRITICAL_TTC).clamp(0.0, 1.0)


ABSENT = -1e9  # logit of a step before the history began


class EncoderLayer(nn.Module):
    """Base class of an encoder's layers over whole histories, also for added networks (docs/extending.md)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return float32[B, T, hidden] for inputs float32[B, T, hidden] and risks float32[B, T].

        Entry t knows steps 0 to t only.
        """
        raise NotImplementedError

    def at(self, x: Tensor, risks: Tensor, step: Tensor) -> Tensor:
        """Return entry `step`, int64[B], of what `forward` returns, float32[B, 1, hidden]."""
        return entry(self.forward(x, risks), step)

    def next(self, x: Tensor, risks: Tensor, memory: tuple[Tensor, ...] | None) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Return the output of one more step, float32[B, hidden], and the memory of it and all earlier steps.

        :param x: float32[B, hidden]; risks: float32[B]; memory: of the earlier steps, None: there are none.
        """
        seen = [x[:, None], risks[:, None]]
        if memory is not None:
            seen = [torch.cat([before, now], dim=1) for before, now in zip(memory, seen, strict=True)]
        last = torch.full((len(x),), seen[0].shape[1] - 1)
        return self.at(seen[0], seen[1], last)[:, 0], tuple(seen)


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

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return the layer's output at all steps, see `EncoderLayer.forward`."""
        h = self._states(x)
        return self._output(x, h, h, risks, torch.arange(x.shape[1])[None])

    def at(self, x: Tensor, risks: Tensor, step: Tensor) -> Tensor:
        """Return the layer's output at one step, see `EncoderLayer.at`; earlier steps only give states and keys."""
        h = self._states(x)
        return self._output(entry(x, step), entry(h, step), h, risks, step[:, None])

    def next(self, x: Tensor, risks: Tensor, memory: tuple[Tensor, ...] | None) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Return the layer's output at one more step and its memory, see `EncoderLayer.next`, at a cost of O(1)."""
        a = self.decay()
        h = self.input(x) * torch.sqrt(1.0 - a * a)
        h = h if memory is None else h + a * memory[1][:, -1]
        seen = [self.key(h)[:, None], h[:, None], risks[:, None]]
        if memory is not None:
            seen = [torch.cat([m, now], dim=1)[:, -self.window :] for m, now in zip(memory, seen, strict=True)]
        keys, states, gates = seen
        newest = torch.tensor([[states.shape[1] - 1]])
        context = self._attend(self.query(h)[:, None], keys, states, gates, newest)[:, 0]
        out: Tensor = self.norm(x + self.readout(h) + self.skip * x + self.attended(context))
        return out, (keys, states, gates)

    def _states(self, x: Tensor) -> Tensor:
        """Return h of (3), float32[B, T, hidden]."""
        a = self.decay()
        return recurrence(self.input(x) * torch.sqrt(1.0 - a * a), a)

    def _output(self, x: Tensor, h: Tensor, states: Tensor, risks: Tensor, steps: Tensor) -> Tensor:
        """Return the layer's output at Q steps, float32[B, Q, hidden].

        :param x, h: input and state at these steps, float32[B, Q, hidden].
        :param states, risks: of all steps, float32[B, T, hidden] and float32[B, T].
        :param steps: int64[B or 1, Q].
        """
        context = self._attend(self.query(h), self.key(states), states, risks, steps)
        out: Tensor = self.norm(x + self.readout(h) + self.skip * x + self.attended(context))
        return out

    def _attend(self, queries: Tensor, keys: Tensor, values: Tensor, risks: Tensor, steps: Tensor) -> Tensor:
        """Return each query's mix of the values of the last `window` steps, float32[B, Q, hidden]."""
        q, k, v = (part.unflatten(2, (self.heads, -1)).transpose(1, 2) for part in (queries, keys, values))
        age = steps[:, None, :, None] - torch.arange(keys.shape[1])
        gates = (self.risk_gain[:, None] * risks[:, None])[:, :, None]
        logits = (q / math.sqrt(q.shape[-1])) @ k.transpose(2, 3) + gates
        shares = torch.softmax(logits.masked_fill((age < 0) | (age >= self.window), ABSENT), dim=3)
        return (shares @ v).transpose(1, 2).flatten(2)


class SSTEncoder(nn.Module):
    """Encodes a history H(t) = (O(1), A(1), ..., A(t-1), O(t)) of one agent (Algorithm 1).

    The observation, normalised by fixed statistics, and the agent's own action of the step before enter through one
    linear layer each; their sum is x_t of (3).

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
        self.layers = nn.ModuleList(layer(config) for _ in range(config.layers))

    def embed(self, observation: Tensor, action_before: Tensor) -> Tensor:
        """Return the embedded inputs x_t, float32[..., hidden].

        :param observation: [..., 6]; action_before: [..., 2] [m/s2].
        """
        scaled = (observation - self.observation_mean) / self.observation_scale
        x: Tensor = self.observation(scaled.clamp(-NORMALISED_LIMIT, NORMALISED_LIMIT)) + self.action(action_before)
        return x

    def forward(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, step: Tensor | None = None
    ) -> Tensor:
        """Return the encoding of whole histories, at every step or at `step`.

        :param observation: float32[B, T, 6], equation (6) or (7).
        :param action_before: float32[B, T, 2], the agent's executed action of step t - 1 [m/s2]; at t = 0 the
            acceleration with which it came.
        :param curvttc: float32[B, T] [s].
        :param step: int64[B], the one entry wanted of each history; None: all.
        :returns: float32[B, T, hidden], with `step` float32[B, 1, hidden]; entry t knows steps 0 to t only.
        """
        risks = risk(curvttc)
        x = self.embed(observation, action_before)
        *before, last = cast(list[EncoderLayer], list(self.layers))
        for layer in before:
            x = layer(x, risks)
        return last(x, risks) if step is None else last.at(x, risks, step)

    def next(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, memory: "Memory") -> Tensor:
        """Return the encoding of one more step of B histories, float32[B, hidden], and take it into their memory.

        :param observation, action_before, curvttc: [B, 6], [B, 2] and [B], as for `forward`.
        :param memory: of all earlier steps; for the first step a new one.
        """
        risks, x = risk(curvttc), self.embed(observation, action_before)
        memory.begin(len(self.layers))
        for i, layer in enumerate(cast(list[EncoderLayer], list(self.layers))):
            x, memory.layers[i] = layer.next(x, risks, memory.layers[i])
        return x


@dataclass
class Memory:
    """What an encoder remembers of B histories: for each layer, what its `next` returned at the step before."""

    layers: list[tuple[Tensor, ...] | None] = field(default_factory=list)

    def begin(self, layers: int) -> None:
        """Make room for so many layers, at the first step."""
        self.layers = self.layers or [None] * layers


def entry(values: Tensor, step: Tensor) -> Tensor:
    """Return the entry at `step`, int64[B], of each row of values [B, T, n], as [B, 1, n]."""
    return values[torch.arange(len(values)), step][:, None]


def recurrence(driven: Tensor, decay: Tensor) -> Tensor:
    """Return h_t = a h_{t-1} + driven_t of (3) with h_{-1} = 0, for float32[B, T, d] and a, float32[d]."""
    h: Tensor = _Recurrence.apply(driven, decay)  # type: ignore[no-untyped-call]
    return h


class _Recurrence(torch.autograd.Function):
    """`recurrence`, step by step and in place, which for whole histories is faster than any tree of sums."""

    @staticmethod
    def forward(ctx: Any, driven: Tensor, decay: Tensor) -> Tensor:
        h = driven.clone()
        steps = h.unbind(dim=1)
        for before, now in pairwise(steps):
            now.addcmul_(before, decay)
        ctx.save_for_backward(h, decay)
        return h

    @staticmethod
    def backward(ctx: Any, d_h: Tensor) -> tuple[Tensor, Tensor]:
        h, decay = ctx.saved_tensors
        d_driven = d_h.clone()
        steps = d_driven.unbind(dim=1)
        for after, now in pairwise(steps[::-1]):
            now.addcmul_(after, decay)
        return d_driven, (d_driven[:, 1:] * h[:, :-1]).sum(dim=(0, 1))
