"""The actor: an SST encoder and two hidden layers on top, to two accelerations (Table 8).

With `NetworkConfig.latent` it is a distribution: the head also takes latent numbers z ~ N(0, I), drawn once an episode
and agent, and also gives the logarithm of a scale, by which a noise is multiplied and added to each acceleration. The
noise e is autoregressive of first order with deviation one, its persistence from one step of 0.1 s to the next one
learned number an agent. It enters as e^3 / (e^2 + c^2), with a learned c for each acceleration: people do nothing for
most of the time, and then something for a second or so, which Gaussian noise of whatever size does not (measured in
docs/results.md). So z is what kind of person acts, and the noise what this person happens to do; how
much of both shows depends on the situation. With z = 0 and without noise the actor is the deterministic middle.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.policy.config import LOG_SCALE, NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, SSTEncoder, SSTLayer, StepState
from vpsci_ros.world.observation import ACTION_SIZE

if TYPE_CHECKING:
    from vpsci_ros.policy.layers import LayerMemory

OUTPUT_INIT = 3e-3  # bound of the last layer's initial weights, so that an untrained actor keeps its velocity
PERSISTENCE_INIT = 0.9  # of the noise, from step to step
LOG_SCALE_INIT = -1.0  # logarithm of the scale of the noise [m/s2]


class Distribution(NamedTuple):
    """What an actor does next, given its latent numbers.

    :ivar mean: float32[..., 2] [m/s2], not clipped.
    :ivar scale: float32[..., 2] [m/s2], of the noise.
    """

    mean: Tensor
    scale: Tensor


class Actor(nn.Module):
    """mu(H(t)): history of one agent -> (longitudinal, lateral) acceleration [m/s2] in the vehicle's heading frame."""

    def __init__(self, config: NetworkConfig, layer: type[EncoderLayer] = SSTLayer) -> None:
        super().__init__()
        self.limit = config.action_limit
        self.latent = config.latent
        self.dropout = 0.0  # share of the encoded history and of the first hidden layer left out, while imitating
        self.encoder = SSTEncoder(config, layer)
        first, second = config.actor_hidden
        self.head = nn.Sequential(
            nn.Linear(config.hidden + config.latent, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, 2 * ACTION_SIZE if config.latent else ACTION_SIZE),
        )
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        nn.init.uniform_(last.weight, -OUTPUT_INIT, OUTPUT_INIT)
        nn.init.zeros_(last.bias)
        if config.latent:
            with torch.no_grad():
                last.bias[ACTION_SIZE:] = LOG_SCALE_INIT
            self.persistence_logit = nn.Parameter(torch.full((1,), math.log(PERSISTENCE_INIT / (1 - PERSISTENCE_INIT))))
            self.stillness = nn.Parameter(torch.ones(ACTION_SIZE))

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """Return float32[B, T, 2]: the action at every step of histories as in `SSTEncoder.forward`, clipped.

        Of a stochastic actor this, `remember` and `step` return the deterministic middle.
        """
        return self._middle(self.encoder(observation, action_before, curvttc))

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """Return `forward`'s actions, and the states of the histories' first `taken` steps for `step` to go on from."""
        encoded, states = self.encoder.remember(observation, action_before, curvttc, taken)
        return self._middle(encoded), states

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """Return float32[B, 2] for one more step with carried state, as in `SSTEncoder.step`, clipped."""
        return self._middle(self.encoder.step(observation, action_before, curvttc, states))

    def distribution(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState], latent: Tensor
    ) -> Distribution:
        """Return what a stochastic actor does at one more step, as `step`; `latent` numbers are float32[B, latent].

        Without latent numbers it has no noise of its own: the scale is 0.
        """
        return self._distribution(self.encoder.step(observation, action_before, curvttc, states), latent)

    def distributions(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, latent: Tensor
    ) -> Distribution:
        """Return `distribution` at every step of whole histories as in `SSTEncoder.forward`, float32[B, T, 2]."""
        encoded = self.encoder(observation, action_before, curvttc)
        return self._distribution(encoded, latent[:, None].expand(-1, encoded.shape[1], -1))

    def _distribution(self, encoded: Tensor, latent: Tensor) -> Distribution:
        both = self._head(encoded, latent)
        if not self.latent:
            return Distribution(both, torch.zeros_like(both))
        return Distribution(both[..., :ACTION_SIZE], both[..., ACTION_SIZE:].clamp(*LOG_SCALE).exp())

    def next_noise(self, noise: Tensor, innovation: Tensor) -> Tensor:
        """Return the noise of the next step, of deviation 1, from that of the last one and independent normals."""
        persistence = torch.sigmoid(self.persistence_logit)
        return persistence * noise + torch.sqrt(1.0 - persistence * persistence) * innovation

    def burst(self, noise: Tensor) -> Tensor:
        """Return e^3 / (e^2 + c^2) of noise e, what a distribution's scale is multiplied by."""
        square = noise * noise
        return noise * square / (square + self.stillness * self.stillness)

    def _middle(self, encoded: Tensor) -> Tensor:
        latent = encoded.new_zeros(*encoded.shape[:-1], self.latent)
        return self._head(encoded, latent)[..., :ACTION_SIZE].clamp(-self.limit, self.limit)

    def _head(self, encoded: Tensor, latent: Tensor) -> Tensor:
        first, relu, second, _, last = self.head
        known = self._dropped_out(encoded)
        x = relu(first(torch.cat([known, latent], dim=-1) if self.latent else known))
        out: Tensor = last(relu(second(self._dropped_out(x))))
        return out

    def _dropped_out(self, x: Tensor) -> Tensor:
        return functional.dropout(x, self.dropout) if self.dropout > 0.0 else x

    def draw(
        self,
        observation: Tensor,
        action_before: Tensor,
        curvttc: Tensor,
        states: list[StepState],
        latent: Tensor | None,
        noise: Tensor | None = None,
    ) -> Tensor:
        """Return float32[B, 2] as `step`, of a network that draws by standard normal numbers; this one draws nothing.

        :param latent: [B, latent], the same all episode; None: the likeliest.
        :param noise: [B, 2], new at every step; None: none.
        """
        return self.step(observation, action_before, curvttc, states)

    def memory(self, rows: int) -> list["LayerMemory"]:
        """Return the memory of `rows` empty histories, of layers that keep one of fixed shape."""
        return [layer.empty(rows) for layer in self.encoder.layers]  # type: ignore[operator]

    def empty_history(self) -> list[StepState]:
        """Return the state of an empty history."""
        return [StepState() for _ in self.encoder.layers]


class Actors(nn.ModuleDict):
    """An actor for each agent."""

    def __getitem__(self, key: str) -> Actor:
        """Return the actor of "vehicle" or "pedestrian"."""
        return cast(Actor, super().__getitem__(key))

    @contextmanager
    def dropping_out(self, share: float) -> Iterator[None]:
        """Leave out this share of the encoded histories and of the heads' first hidden layers, in here only."""
        for agent in self:
            self[agent].dropout = share
        try:
            yield
        finally:
            for agent in self:
                self[agent].dropout = 0.0


def before_step(actions: Tensor, at: Tensor) -> Tensor:
    """Return the actions float32[B, 2] before steps `at`, int64[B], of executed actions [B, T, 2]; zero at 0."""
    return actions[torch.arange(len(at)), (at - 1).clamp(min=0)] * (at > 0)[:, None]


def previous(actions: Tensor) -> Tensor:
    """Shift executed actions float32[B, T, 2] by one step, so that entry t is the action before step t (zero at 0)."""
    return torch.cat([torch.zeros_like(actions[:, :1]), actions[:, :-1]], dim=1)
