"""The models of the paper's Table 9, found by entry points, and their layers in place of the SST's.

Each is a residual layer that ends in a layer normalisation, like `SSTLayer`, so that a network differs from the SST in
how it takes up the history and in nothing else. None has the gate of (4).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.learning.objectives import Objective, PolicyGradient, Training
from vpsci_ros.policy.models import Model
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, SSTLayer


class FeedForwardLayer(EncoderLayer):
    """LayerNorm(x + W_2 relu(W_1 x)): uses this step and the action before it, no other history."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        width = config.hidden
        self.bend = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), nn.Linear(2 * width, width))
        self.norm = nn.LayerNorm(width)

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return the layer's output, see `EncoderLayer.forward`."""
        out: Tensor = self.norm(x + self.bend(x))
        return out


class LSTMLayer(EncoderLayer):
    """LayerNorm(x + h_t) of a long short-term memory (Hochreiter and Schmidhuber 1997)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.width = config.hidden
        self.cell = nn.LSTMCell(self.width, self.width)
        self.norm = nn.LayerNorm(self.width)

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return the layer's output, see `EncoderLayer.forward`."""
        h = c = x.new_zeros(len(x), self.width)
        states = []
        for step in range(x.shape[1]):
            h, c = self.cell(x[:, step], (h, c))
            states.append(h)
        out: Tensor = self.norm(x + torch.stack(states, dim=1))
        return out


class TransformerLayer(EncoderLayer):
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

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return the layer's output, see `EncoderLayer.forward`."""
        position = torch.arange(x.shape[1])
        age = position[:, None] - position[None, :]
        bias = self.age_bias[:, age.clamp(0, self.window - 1)]
        bias = bias.masked_fill((age < 0) | (age >= self.window), -torch.inf)
        query, key, value = (
            part(x).unflatten(2, (self.heads, -1)).transpose(1, 2) for part in (self.query, self.key, self.value)
        )
        context = functional.scaled_dot_product_attention(query, key, value, attn_mask=bias)
        x = self.norm(x + self.attended(context.transpose(1, 2).flatten(2)))
        out: Tensor = self.norm_bent(x + self.bend(x))
        return out


def _alone(training: Training, config: object) -> PolicyGradient:
    training.maddpg.alone = True
    return PolicyGradient(training)


SINGLE_AGENT_DDPG = Objective(pretrain=_alone, refine=_alone)
"""Each critic sees its own agent's action alone (Lillicrap et al. 2016, https://arxiv.org/abs/1509.02971)."""

MA_SST_DDPG = Model(SSTLayer, "ddpg")
MA_TRANSFORMER_DDPG, MA_DDPG = Model(TransformerLayer, "ddpg"), Model(FeedForwardLayer, "ddpg")
TRANSFORMER_DDPG, DDPG = Model(TransformerLayer, "single_agent_ddpg"), Model(FeedForwardLayer, "single_agent_ddpg")
TRANSFORMER, LSTM, FEEDFORWARD = Model(TransformerLayer), Model(LSTMLayer), Model(FeedForwardLayer)

ROWS = (
    *("ma_sst_ddpg", "ma_transformer_ddpg", "ma_ddpg", "transformer_ddpg", "ddpg"),
    *("sst", "transformer", "lstm", "feedforward"),
)
"""The models of the study, in the order of its table; `sst` is the package's own."""
