"""Social-LSTM (Alahi et al., CVPR 2016): an LSTM for everybody in the scene, hidden states pooled over a grid.

One agent's actor runs the LSTM with the same weights for both people in the scene, itself and the other, whose motion
it knows from what it observes. At each step a person's LSTM takes in its velocity and the hidden states of those around
it, summed by the cell of a grid in which they are; the scene is whoever the near-miss table has, one vehicle and one
pedestrian, since most recordings that this package reads publish no one else. It gives a bivariate normal distribution
of the next acceleration, from which it can draw.
"""

import torch
from torch import Tensor, nn

from vpsci_ros.policy.actor import OUTPUT_INIT, Actor
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.layers import LayerMemory
from vpsci_ros.policy.sst import NORMALISED_LIMIT, StepState, risk
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

CELLS, CELL = 4, 4.0  # cells of the grid along each axis, and their width [m]
_SIGMA = (-4.0, 1.5)  # least and greatest logarithm of a deviation [m/s2]


def social_pooling(place: Tensor, hidden: Tensor, present: Tensor) -> Tensor:
    """Return hidden states summed by cell, [B, CELLS * CELLS, width]; whoever is beyond the grid does not count.

    :param place: [B, n, 2] [m], where n others are, beside the person whose grid it is.
    :param hidden: [B, n, width]; present: bool[B, n]. The order of the others does not matter.
    """
    cell = torch.floor(place / CELL).long() + CELLS // 2
    inside = present & ((cell >= 0) & (cell < CELLS)).all(dim=2)
    index = (cell[..., 0] * CELLS + cell[..., 1]).clamp(0, CELLS * CELLS - 1)
    out = hidden.new_zeros(len(hidden), CELLS * CELLS, hidden.shape[2])
    return out.scatter_add(1, index[..., None].expand_as(hidden), hidden * inside[..., None])


class SocialEncoder(nn.Module):
    """The LSTM of both people, as one of them observes the scene; its own hidden state is what comes out."""

    observation_mean: Tensor
    observation_scale: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.width = config.hidden
        self.register_buffer("observation_mean", torch.zeros(OBSERVATION_SIZE))
        self.register_buffer("observation_scale", torch.ones(OBSERVATION_SIZE))
        self.place = nn.Linear(2 + ACTION_SIZE + 1, config.hidden)
        self.pooled = nn.Linear(CELLS * CELLS * config.hidden, config.hidden)
        self.cell = nn.LSTMCell(2 * config.hidden, config.hidden)

    def empty(self, rows: int) -> LayerMemory:
        """Return hidden and cell state of both people, of `rows` empty histories."""
        return LayerMemory(*(torch.zeros(rows, 2, self.width) for _ in range(2)))

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """See `SSTEncoder.step`."""
        (memory,) = states
        assert isinstance(memory, LayerMemory)
        hidden, cell = memory.parts
        seen = ((observation - self.observation_mean) / self.observation_scale).clamp(
            -NORMALISED_LIMIT, NORMALISED_LIMIT
        )
        velocities = seen[:, 0:2], seen[:, 0:2] - seen[:, 4:6]  # the other's, in the own units
        before = action_before, torch.zeros_like(action_before)  # nobody observes what the other was about to do
        away, every = -observation[:, 2:4], torch.ones(len(observation), 1, dtype=torch.bool)
        inputs = []
        for person, (velocity, action, place) in enumerate(zip(velocities, before, (away, -away), strict=True)):
            others = hidden[:, 1 - person : 2 - person]
            pooled = self.pooled(social_pooling(place[:, None], others, every).flatten(1))
            own = self.place(torch.cat([velocity, action, risk(curvttc)[:, None]], dim=1))
            inputs.append(torch.relu(torch.cat([own, pooled], dim=1)))
        flat = torch.stack(inputs, dim=1).flatten(0, 1)
        h, c = self.cell(flat, (hidden.flatten(0, 1), cell.flatten(0, 1)))
        memory.parts = h.unflatten(0, (-1, 2)), c.unflatten(0, (-1, 2))
        return memory.parts[0][:, 0]

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """See `SSTEncoder.remember`."""
        memory, out, rows = self.empty(len(observation)), [], torch.arange(len(observation))
        history = [memory.parts]
        for t in range(observation.shape[1]):
            out.append(self.step(observation[:, t], action_before[:, t], curvttc[:, t], [memory]))
            history.append(memory.parts)
        parts = (torch.stack(part, dim=1)[rows, taken] for part in zip(*history, strict=True))
        return torch.stack(out, dim=1), [LayerMemory(*parts)]

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """See `SSTEncoder.forward`."""
        return self.remember(observation, action_before, curvttc, torch.zeros(len(observation), dtype=torch.long))[0]


class SocialLSTM(Actor):
    """An actor whose head gives mean, deviations and correlation of the next acceleration."""

    def __init__(self, config: NetworkConfig) -> None:
        nn.Module.__init__(self)
        self.limit, self.latent, self.dropout = config.action_limit, config.latent, 0.0
        self.encoder = SocialEncoder(config)  # type: ignore[assignment]
        self.head = nn.Sequential(nn.Linear(config.hidden, 2 * ACTION_SIZE + 1))
        nn.init.uniform_(self.head[0].weight, -OUTPUT_INIT, OUTPUT_INIT)  # type: ignore[arg-type]
        nn.init.zeros_(self.head[0].bias)  # type: ignore[arg-type]

    def normal(self, encoded: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return mean and deviations [..., 2] [m/s2] and the correlation [...] by encoded histories [..., hidden]."""
        out = self.head(encoded)
        return out[..., :2], out[..., 2:4].clamp(*_SIGMA).exp(), 0.99 * torch.tanh(out[..., 4])

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """Return float32[B, T, 2], the mean of every step, clipped."""
        mean = self.normal(self.encoder(observation, action_before, curvttc))[0]
        return mean.clamp(-self.limit, self.limit)

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """See `Actor.remember`."""
        encoded, states = self.encoder.remember(observation, action_before, curvttc, taken)
        return self.normal(encoded)[0].clamp(-self.limit, self.limit), states

    def memory(self, rows: int) -> list[LayerMemory]:
        """See `Actor.memory`."""
        return [self.encoder.empty(rows)]  # type: ignore[operator]

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """Return float32[B, 2], the mean, clipped."""
        return self.draw(observation, action_before, curvttc, states, None)

    def draw(
        self,
        observation: Tensor,
        action_before: Tensor,
        curvttc: Tensor,
        states: list[StepState],
        latent: Tensor | None,
        noise: Tensor | None = None,
    ) -> Tensor:
        """See `Actor.draw`: the mean with correlated noise."""
        mean, sigma, rho = self.normal(self.encoder.step(observation, action_before, curvttc, states))
        if noise is not None:
            aside = rho * noise[:, 0] + torch.sqrt(1.0 - rho * rho) * noise[:, 1]
            mean = mean + sigma * torch.stack([noise[:, 0], aside], dim=1)
        return mean.clamp(-self.limit, self.limit)
