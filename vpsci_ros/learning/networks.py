"""All networks of MA-SST-DDPG: an actor and a critic for each agent, and a target network of each."""

import copy
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vpsci_ros.policy.actor import Actors
from vpsci_ros.policy.models import MODELS, make_actor
from vpsci_ros.policy.policy_config import CRITIC_ACTION, CRITIC_HIDDEN, CRITIC_STATE, FADING, NetworkConfig
from vpsci_ros.policy.sst import SSTEncoder
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS


class Critic(nn.Module):
    """Q(H(t), A_own(t), A_other(t)) of one agent: history on one branch (an encoder of its own), actions on another.

    :param encoder: of another critic of the agent, which both share; None: one of its own.
    """

    def __init__(self, config: NetworkConfig, encoder: SSTEncoder | None = None) -> None:
        super().__init__()
        self.encoder = SSTEncoder(config, MODELS.find(config.encoder).layer) if encoder is None else encoder
        self.state = nn.Linear(config.hidden, CRITIC_STATE)
        self.action = nn.Linear(2 * ACTION_SIZE, CRITIC_ACTION)
        first, second = CRITIC_HIDDEN
        self.head = nn.Sequential(
            nn.Linear(CRITIC_STATE + CRITIC_ACTION, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, 1),
        )

    @torch.no_grad()
    def scale_values(self, factor: float) -> None:
        """Multiply Q by a factor, for every history and action."""
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        last.weight.mul_(factor)
        last.bias.mul_(factor)

    def branch(self, encoded: Tensor) -> Tensor:
        """Return the state branch, float32[..., 16], of histories as `encoder` returns them, float32[..., hidden]."""
        return torch.relu(self.state(encoded))

    def value(self, state: Tensor, own_action: Tensor, other_action: Tensor) -> Tensor:
        """Return Q, float32[...], of states as `branch` returns them and of both agents' actions [..., 2] [m/s2]."""
        joint = torch.relu(self.action(torch.cat([own_action, other_action], dim=-1)))
        q: Tensor = self.head(torch.cat([state, joint], dim=-1))
        return q.squeeze(-1)


class Critics(nn.ModuleDict):
    """A critic for each agent."""

    def __getitem__(self, key: str) -> Critic:
        """Return the critic of "vehicle" or "pedestrian"."""
        return cast(Critic, super().__getitem__(key))


class Networks(nn.Module):
    """Actors mu, critics Q and their targets mu', Q' for both agents (Figure 3 of the paper).

    `actor` and `target_actor` map "vehicle" and "pedestrian" to networks, and so does each of `critics` and
    `target_critics`. A weights file holds the first critics. `speed_mean` and `speed_deviation` [m/s], float32[2] per
    agent, are the fixed statistics of rewards (14)-(15).

    :param critics: how many critics an agent has; they share its encoder, which is most of their cost.
    """

    def __init__(self, config: NetworkConfig, critics: int = 1) -> None:
        super().__init__()
        self.config = config
        self.actor = Actors({agent: make_actor(config, FADING[agent]) for agent in AGENTS})
        first = Critics({agent: Critic(config) for agent in AGENTS})
        further = [Critics({a: Critic(config, first[a].encoder) for a in AGENTS}) for _ in range(critics - 1)]
        self.critics, self.target_actor = nn.ModuleList([first, *further]), copy.deepcopy(self.actor)
        self.target_critics = copy.deepcopy(self.critics)
        for parameter in [*self.target_actor.parameters(), *self.target_critics.parameters()]:
            parameter.requires_grad_(False)
        self.speed_mean = {agent: torch.zeros(2) for agent in AGENTS}
        self.speed_deviation = {agent: torch.ones(2) for agent in AGENTS}

    @property
    def critic(self) -> Critics:
        """The first critic of each agent."""
        return cast(Critics, self.critics[0])

    @property
    def target_critic(self) -> Critics:
        """The target of the first critic of each agent."""
        return cast(Critics, self.target_critics[0])

    def every_critic(self) -> list[Critics]:
        """Return all critics, then all of their targets."""
        return [cast(Critics, critics) for critics in (*self.critics, *self.target_critics)]

    def set_statistics(
        self,
        observations: dict[str, NDArray[np.float32]],
        speeds: dict[str, NDArray[np.float32]],
        least_speed_deviation: float,
    ) -> None:
        """Fix normalisation and reward statistics from training data: observations [n, 6], next speeds [n, 2] [m/s].

        Lateral components get the mean zero, so that mirroring a near miss mirrors what the networks see.
        """
        for agent in AGENTS:
            mean, deviation = _moments(observations[agent])
            actors = [actors[agent].encoder for actors in (self.actor, self.target_actor)]
            for encoder in [*actors, *(critics[agent].encoder for critics in self.every_critic())]:
                encoder.observation_mean.copy_(mean)
                encoder.observation_scale.copy_(deviation)
            self.speed_mean[agent], deviation = _moments(speeds[agent])
            self.speed_deviation[agent] = deviation.clamp(min=least_speed_deviation)

    def scale_values(self, factor: float) -> None:
        """Multiply the values of all critics, including the targets, by a factor."""
        for critics in self.every_critic():
            for agent in AGENTS:
                critics[agent].scale_values(factor)

    @torch.no_grad()
    def follow(self, rate: float) -> None:
        """Move the targets by `rate` towards the networks: theta' <- rate theta + (1 - rate) theta' (Algorithm 1)."""
        for target, network in ((self.target_actor, self.actor), (self.target_critics, self.critics)):
            for slow, fast in zip(target.parameters(), network.parameters(), strict=True):
                slow.lerp_(fast, rate)

    def weights(self, configuration: dict[str, Any], facts: dict[str, Any]) -> Weights:
        """Return actors, first critics and reward statistics as `Weights` with this configuration and these facts."""
        tensors: dict[str, Tensor] = {}
        for agent in AGENTS:
            for kind, networks in (("actor", self.actor), ("critic", self.critic)):
                tensors |= {f"{agent}_{kind}.{k}": v for k, v in networks[agent].state_dict().items()}
            tensors[f"{agent}_speed.mean"] = self.speed_mean[agent]
            tensors[f"{agent}_speed.deviation"] = self.speed_deviation[agent]
        arrays = {name: tensor.detach().numpy().copy() for name, tensor in tensors.items()}
        return Weights(self.config, arrays, configuration, facts)

    @classmethod
    def from_weights(cls, weights: Weights, critics: int = 1, seed: int = 0) -> "Networks":
        """Build the networks that `weights` holds; each target network starts equal to its network.

        :param critics: how many critics an agent gets; those beyond the first begin untrained, drawn by `seed`.
        """
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            networks = cls(weights.network, critics)
        for agent in AGENTS:
            for kind, targets in (("actor", networks.target_actor), ("critic", networks.target_critic)):
                state = {k: torch.from_numpy(v.copy()) for k, v in weights.part(f"{agent}_{kind}").items()}
                getattr(networks, kind)[agent].load_state_dict(state)
                targets[agent].load_state_dict(state)
            speed = weights.part(f"{agent}_speed")
            networks.speed_mean[agent] = torch.from_numpy(speed["mean"].copy())
            networks.speed_deviation[agent] = torch.from_numpy(speed["deviation"].copy())
        return networks


def _moments(values: NDArray[np.float32]) -> tuple[Tensor, Tensor]:
    """Return mean and deviation of columns that alternate longitudinal, lateral; a constant column gets deviation 1."""
    values = np.asarray(values, np.float64)
    mean = values.mean(axis=0)
    mean[1::2] = 0.0
    deviation = np.sqrt(((values - mean) ** 2).mean(axis=0))
    deviation[deviation < 1e-3] = 1.0
    return torch.tensor(mean, dtype=torch.float32), torch.tensor(deviation, dtype=torch.float32)
