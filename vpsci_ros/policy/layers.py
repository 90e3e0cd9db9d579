"""Layers in place of the SST's: a Transformer's, a long short-term memory's and a feed-forward one's.

Each is a residual layer that ends in a layer normalisation, like `SSTLayer`, so that a network differs from the SST in
how it takes up the history and in nothing else. None has the gate of (4); the risk reaches all of them as an input.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.sst import ABSENT, EncoderLayer, StepState


class LayerMemory(StepState):
    """What a layer remembers of B histories: tensors [B, ...] that are zero for an empty history."""

    def __init__(self, *parts: Tensor) -> None:
        super().__init__()
        self.parts = parts

    def keep(self, rows: int) -> None:
        """Forget all but the first `rows` rows."""
        self.parts = tuple(part[:rows] for part in self.parts)

    def clear(self, rows: Tensor) -> None:
        """Empty the histories of `rows`, bool[B]."""
        self.parts = tuple(part.masked_fill(rows.view(-1, *[1] * (part.ndim - 1)), 0.0) for part in self.parts)


class BaselineLayer(EncoderLayer):
    """A layer whose memory of a history has a fixed shape: what a network of one's own derives its layer from."""

    def empty(self, rows: int) -> LayerMemory:
        """Return the memory of `rows` empty histories."""
        raise NotImplementedError


class FeedForwardLayer(BaselineLayer):
    """LayerNorm(x + W_2 relu(W_1 x)): knows this step and nothing before, but for the action that led to it."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        width = config.hidden
        self.bend = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), nn.Linear(2 * width, width))
        self.norm = nn.LayerNorm(width)

    def forward(self, x: Tensor, risks: Tensor, taken: Tensor | None = None) -> tuple[Tensor, StepState | None]:
        """See `SSTLayer.forward`."""
        out: Tensor = self.norm(x + self.bend(x))
        return out, None if taken is None else LayerMemory()

    def step(self, x: Tensor, risks: Tensor, state: StepState) -> Tensor:
        """See `SSTLayer.step`."""
        return self.forward(x, risks)[0]

    def empty(self, rows: int) -> LayerMemory:
        """See `BaselineLayer.empty`."""
        return LayerMemory()


class LSTMLayer(BaselineLayer):
    """LayerNorm(x + h_t) of a long short-term memory (Hochreiter and Schmidhuber 1997)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.width = config.hidden
        self.cell = nn.LSTMCell(self.width, self.width)
        self.norm = nn.LayerNorm(self.width)

    def forward(self, x: Tensor, risks: Tensor, taken: Tensor | None = None) -> tuple[Tensor, StepState | None]:
        """See `SSTLayer.forward`."""
        h, c = self.empty(len(x)).parts
        hs, cs = [h], [c]
        for step in range(x.shape[1]):
            h, c = self.cell(x[:, step], (h, c))
            hs.append(h)
            cs.append(c)
        out: Tensor = self.norm(x + torch.stack(hs[1:], dim=1))
        if taken is None:
            return out, None
        rows = torch.arange(len(x))
        return out, LayerMemory(*(torch.stack(part, dim=1)[rows, taken] for part in (hs, cs)))

    def step(self, x: Tensor, risks: Tensor, state: StepState) -> Tensor:
        """See `SSTLayer.step`."""
        assert isinstance(state, LayerMemory)
        h, c = self.cell(x, state.parts)
        state.parts = (h, c)
        out: Tensor = self.norm(x + h)
        return out

    def empty(self, rows: int) -> LayerMemory:
        """See `BaselineLayer.empty`."""
        return LayerMemory(torch.zeros(rows, self.width), torch.zeros(rows, self.width))


class TransformerLayer(BaselineLayer):
    """Causal attention over the last `attention_window` inputs, then a feed-forward part (Vaswani et al. 2017).

    A learned bias for each head and age says to attention how long ago a step was.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.width, self.heads, self.window = config.hidden, config.heads, config.attention_window
        self.query, self.key, self.value, self.attended = (
            nn.Linear(self.width, self.width, bias=False) for _ in range(4)
        )
        self.age_bias = nn.Parameter(torch.zeros(self.heads, self.window))
        self.bend = nn.Sequential(nn.Linear(self.width, self.width), nn.ReLU(), nn.Linear(self.width, self.width))
        self.norm, self.norm_bent = nn.LayerNorm(self.width), nn.LayerNorm(self.width)

    def forward(self, x: Tensor, risks: Tensor, taken: Tensor | None = None) -> tuple[Tensor, StepState | None]:
        """See `SSTLayer.forward`."""
        position = torch.arange(x.shape[1])
        age = position[:, None] - position[None, :]
        bias = self.age_bias[:, age.clamp(0, self.window - 1)]
        bias = bias.masked_fill((age < 0) | (age >= self.window), -torch.inf)
        keys, values = self.key(x), self.value(x)
        query, key, value = (
            part.unflatten(2, (self.heads, -1)).transpose(1, 2) for part in (self.query(x), keys, values)
        )
        context = functional.scaled_dot_product_attention(query, key, value, attn_mask=bias)
        state = None if taken is None else self._remembered(keys, values, taken)
        return self._output(x, context.transpose(1, 2).flatten(2)), state

    def step(self, x: Tensor, risks: Tensor, state: StepState) -> Tensor:
        """See `SSTLayer.step`."""
        assert isinstance(state, LayerMemory)
        newest = self.key(x), self.value(x), torch.ones(len(x))
        keys, values, known = (torch.cat([n[:, None], p], dim=1) for n, p in zip(newest, state.parts, strict=True))
        state.parts = keys[:, :-1], values[:, :-1], known[:, :-1]
        query = self.query(x).unflatten(1, (self.heads, -1))[:, None] / math.sqrt(self.width // self.heads)
        logits = (query * keys.unflatten(2, (self.heads, -1))).sum(dim=3) + self.age_bias.T
        share = torch.softmax(logits + (1.0 - known)[..., None] * ABSENT, dim=1)
        return self._output(x, (share[..., None] * values.unflatten(2, (self.heads, -1))).sum(dim=1).flatten(1))

    def empty(self, rows: int) -> LayerMemory:
        """Return keys and values, [rows, window - 1, hidden], newest first, and which of them there are."""
        past = self.window - 1
        return LayerMemory(*(torch.zeros(rows, past, *shape) for shape in ((self.width,), (self.width,), ())))

    def _remembered(self, keys: Tensor, values: Tensor, taken: Tensor) -> LayerMemory:
        at = taken[:, None] - 1 - torch.arange(self.window - 1)
        known, rows = (at >= 0).to(torch.float32), torch.arange(len(keys))[:, None]
        at = at.clamp(0, keys.shape[1] - 1)
        return LayerMemory(keys[rows, at] * known[..., None], values[rows, at] * known[..., None], known)

    def _output(self, x: Tensor, context: Tensor) -> Tensor:
        x = self.norm(x + self.attended(context))
        out: Tensor = self.norm_bent(x + self.bend(x))
        return out
