"""One update of Algorithm 1: critics by temporal difference, actors by the policy gradient.

Stage 2 adds to it:

- two critics an agent, of whose targets the lesser counts, and noise on the target actions, from 'Addressing function
  approximation error in actor-critic methods' by Fujimoto et al. 2018 (TD3, https://arxiv.org/abs/1802.09477);
- imitation of recorded steps beside a policy gradient that is divided by the mean |Q|, from 'A minimalist approach to
  offline reinforcement learning' by Fujimoto and Gu 2021 (TD3+BC, https://arxiv.org/abs/2106.06860).
"""

from dataclasses import dataclass, field
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vpsci_ros.learning.adam import Adam
from vpsci_ros.learning.config import UpdatesConfig
from vpsci_ros.learning.networks import Critics, Networks
from vpsci_ros.learning.ragged import by_length
from vpsci_ros.learning.replay import Batch
from vpsci_ros.policy.actor import previous
from vpsci_ros.world.observation import AGENTS

UNIT = 100.0  # rewards are divided by this before the critics learn them, so that values are of order one; ours
GRADIENT_CLIP = 1.0  # gradients are scaled down to this norm; ours
LEAST_VALUE = 0.05  # the policy gradient is divided by the mean |Q| of a batch, or by this; in units of `UNIT`
Tensors = dict[str, Tensor]


@dataclass(frozen=True)
class Scored:
    """Evaluated actions, float32[M, T, 2] [m/s2] by agent, their rewards, float32[M, T], and the next observations.

    :ivar batch: the batch with the observations to which these actions lead.
    """

    action: Tensors
    reward: Tensors
    batch: Batch


@dataclass(frozen=True)
class UpdateResult:
    """The losses and norms of an update.

    :ivar critic_loss: by agent.
    :ivar actor_loss, gradient_norm: of the policy gradient, by agent; empty if the actors did not follow it.
    :ivar error: |delta| in units of the reward, mean of both agents, float64[M, T], zero past the end.
    :ivar actions: what the actors would have done before this update, float32[M, T, 2] [m/s2] by agent.
    :ivar more: other losses and norms of the objective, by name.
    """

    critic_loss: dict[str, float]
    actor_loss: dict[str, float]
    gradient_norm: dict[str, float]
    error: NDArray[np.float64]
    actions: Tensors = field(default_factory=dict)
    more: dict[str, float] = field(default_factory=dict)


def importance(error: Tensor, present: Tensor, temperature: float) -> Tensor:
    """Return omega of (5), exp(|delta| / tau), divided by its mean over `present`; zero elsewhere.

    The mean is one factor for the whole loss, to which Adam's steps are indifferent.
    """
    exponent = error.abs() / temperature
    omega = torch.exp(exponent - exponent[present].max()) * present
    return omega / (omega.sum() / present.sum())


def _encoded(network: nn.Module, batch: Batch, more: int, *inputs: Tensor) -> Tensor:
    """Return an actor's or encoder's output at each step of histories, float32[M, T, n]; recorded steps: [M, 1, n].

    :param more: steps after the last action that are included: 1 for target networks, else 0.
    :param inputs: observations, actions before and CurvTTC, as of `SSTEncoder.forward`.
    """
    if batch.step is not None:
        out: Tensor = network(*inputs, batch.step + more)
        return out
    return by_length(network, inputs, batch.length + more)


class Maddpg:
    """Actors, critics and target networks with their optimisers, and one update of them.

    The critic of an agent sees that agent's history and both actions; targets take both next actions from the target
    actors, as in 'Multi-agent actor-critic for mixed cooperative-competitive environments' by Lowe et al. 2017
    (https://arxiv.org/abs/1706.02275), which Algorithm 1 abbreviates.

    :param imitation: weight of the imitation of recorded steps [(m/s2)^-2], see `_improve_actors`; None: the actors
        follow the policy gradient at recorded steps, as at all others.
    :ivar alone: each critic is a single agent's: it gets zero in place of the other agent's action.
    """

    def __init__(self, networks: Networks, config: UpdatesConfig, imitation: float | None = None) -> None:
        self.networks, self.config, self.imitation = networks, config, imitation
        self.alone = False
        self.critic_optimiser = Adam(networks.critics.parameters(), config.critic_learning_rate)
        self.actor_optimiser = Adam(networks.actor.parameters(), config.actor_learning_rate)

    def act(self, batch: Batch, gradient: bool = True) -> Tensors:
        """Return mu(H(t)), float32[M, T, 2], of both agents; for recorded steps every t has the last step's action."""
        actions = {}
        with torch.set_grad_enabled(gradient):
            for agent in AGENTS:
                seen, before = batch.observation[agent][:, :-1], previous(batch.action[agent])
                action = _encoded(self.networks.actor[agent], batch, 0, seen, before, batch.curvttc[:, :-1])
                actions[agent] = action.expand(-1, batch.present.shape[1], -1)
        return actions

    def update(self, batch: Batch, scored: Scored, actions: Tensors | None, rng: np.random.Generator) -> UpdateResult:
        """Update the critics and, given `actions` of `act`, the actors once; then update the targets.

        Errors and losses are those of the first critics, whose values the actors follow.
        """
        count = batch.present.sum()
        targets = self.targets(scored, rng)
        states, critic_loss, error = {}, {}, torch.zeros_like(scored.reward["vehicle"])
        losses = []
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            before = previous(batch.action[agent])
            encoder = self.networks.critic[agent].encoder
            encoded = _encoded(encoder, batch, 0, batch.observation[agent][:, :-1], before, batch.curvttc[:, :-1])
            for critics in self.networks.critics:
                critic = cast(Critics, critics)[agent]
                state = critic.branch(encoded).expand(-1, batch.present.shape[1], -1)
                value = critic.value(state, scored.action[agent], self._others(scored.action[other]))
                delta = (targets[agent] - value) * batch.present
                omega = importance(delta.detach() * UNIT, batch.present, self.config.importance_temperature)
                losses.append((omega * delta**2).sum() / count)
                if agent not in states:
                    states[agent] = state
                    critic_loss[agent] = float((delta.detach() ** 2).sum() / count) * UNIT**2
                    error += delta.detach().abs() * (UNIT / len(AGENTS))
        self.critic_optimiser.zero_grad()
        torch.stack(losses).sum().backward()
        torch.nn.utils.clip_grad_norm_(self.networks.critics.parameters(), GRADIENT_CLIP)
        self.critic_optimiser.step()
        actor_loss: dict[str, float] = {}
        norm: dict[str, float] = {}
        if actions is not None:
            actor_loss, norm = self._improve_actors(batch, actions, states)
        self.networks.follow(self.config.target_update_rate)
        return UpdateResult(critic_loss, actor_loss, norm, error.double().numpy())

    def _others(self, action: Tensor) -> Tensor:
        """Return what a critic sees of the other agent's action."""
        return torch.zeros_like(action) if self.alone else action

    @torch.no_grad()
    def targets(self, scored: Scored, rng: np.random.Generator) -> Tensors:
        """Return y(t) = R(t) + gamma min Q'(H(t + 1), mu'(H(t + 1)), mu'_other(H(t + 1))), the least of all critics.

        Target actions get normal noise of `target_noise`, cut off at twice that.

        Where the rule-based pair drives at t + 1, the return goes on, reward by reward, to the next step at which the
        policies act, and is discounted by the time until then; without such a step it ends with the episode.
        """
        networks, batch, following = self.networks, scored.batch, {}
        before = {a: torch.cat([torch.zeros_like(x[:, :1]), x], dim=1) for a, x in batch.action.items()}
        for agent in AGENTS:
            actor = networks.target_actor[agent]
            action = _encoded(actor, batch, 1, batch.observation[agent], before[agent], batch.curvttc)
            if deviation := self.config.target_noise:
                noise = rng.normal(0.0, deviation, tuple(action.shape)).clip(-2.0 * deviation, 2.0 * deviation)
                action = (action + torch.from_numpy(noise.astype(np.float32))).clamp(-actor.limit, actor.limit)
            following[agent] = action
        rows, targets = torch.arange(len(batch.length)), {}
        goes_on = ~batch.terminal & batch.present[rows, batch.length - 1]
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            encoder, others = networks.target_critic[agent].encoder, self._others(following[other])
            encoded = _encoded(encoder, batch, 1, batch.observation[agent], before[agent], batch.curvttc)
            critics = [cast(Critics, every)[agent] for every in networks.target_critics]
            values = [critic.value(critic.branch(encoded), following[agent], others) for critic in critics]
            value = torch.stack(values).amin(dim=0).expand(-1, batch.present.shape[1] + 1)
            last, reward = value[rows, batch.length] * goes_on, scored.reward[agent] / UNIT
            found, after = torch.zeros_like(reward), last
            for step in range(reward.shape[1] - 1, -1, -1):
                after = torch.where(batch.length == step + 1, last, after)
                found[:, step] = reward[:, step] + self.config.discount * after
                after = torch.where(batch.present[:, step], value[:, step], found[:, step])
            targets[agent] = found
        return targets

    def _improve_actors(
        self, batch: Batch, actions: Tensors, states: Tensors
    ) -> tuple[dict[str, float], dict[str, float]]:
        """Follow the gradient of Q(H, mu(H), mu_other(H_other)), the critics held fixed, and imitate recorded steps.

        With `imitation` the policy gradient is that of simulated steps alone, divided by the mean |Q|. At recorded
        steps, whose actions are those of people, the loss is `imitation` times the squared error of the action.

        Both agents' actions are what their actors do now, as in the framework that the paper's authors released; Lowe
        et al. take the other's from the buffer, though its actor may have left that long ago.

        `states` are the histories as the first critics had them before their step of this update; to encode them again
        would turn the gradient by less than 4 degrees and cost a quarter of the update.
        """
        self.actor_optimiser.zero_grad()
        loss: dict[str, float] = {}
        norm: dict[str, float] = {}
        count, recorded = batch.present.sum(), batch.present & batch.real[:, None]
        followed = batch.present if self.imitation is None else batch.present & ~recorded
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            others = self._others(actions[other].detach())
            value = self.networks.critic[agent].value(states[agent].detach(), actions[agent], others)
            objective = -(value * followed).sum() / count
            whole = objective
            if self.imitation is not None:
                size = (value.detach().abs() * batch.present).sum() / count
                off = ((actions[agent] - batch.action[agent]) ** 2).sum(dim=-1)
                whole = objective / size.clamp(min=LEAST_VALUE) + self.imitation * (off * recorded).sum() / count
            parameters = list(self.networks.actor[agent].parameters())
            for parameter, gradient in zip(parameters, torch.autograd.grad(whole, parameters), strict=True):
                parameter.grad = gradient
            norm[agent] = float(torch.nn.utils.clip_grad_norm_(parameters, GRADIENT_CLIP)) * UNIT
            loss[agent] = float(objective.detach()) * UNIT
        self.actor_optimiser.step()
        return loss, norm
