"""One update of Algorithm 1: critics by temporal difference, actors by the policy gradient.

Stage 2 adds to it:

- two critics an agent, of whose targets the lesser counts, and noise on the target actions, from 'Addressing function
  approximation error in actor-critic methods' by Fujimoto et al. 2018 (TD3, https://arxiv.org/abs/1802.09477);
- a policy gradient that is divided by the mean |Q|, from 'A minimalist approach to offline reinforcement learning' by
  Fujimoto and Gu 2021 (https://arxiv.org/abs/2106.06860);
- other losses of the actors beside it, see `objectives`.
"""

import math
from dataclasses import dataclass, field
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vpsci_ros.learning.adam import Adam
from vpsci_ros.learning.networks import Critics, Networks
from vpsci_ros.learning.ragged import by_length
from vpsci_ros.learning.replay import Batch
from vpsci_ros.learning.training_config import UpdatesConfig
from vpsci_ros.policy.actor import previous
from vpsci_ros.world.observation import AGENTS

UNIT = 100.0  # rewards are divided by this before the critics learn them, so that values are of order one; ours
GRADIENT_CLIP, ACTORS_CLIP = 1.0, 20.0  # gradients of critics and actors are scaled down to these norms; ours
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
    :ivar actor_loss: -Q [reward] by agent; gradient_norm: of all that the actors followed; empty and not a number if
        they followed nothing here.
    :ivar error: |delta| in units of the reward, mean of both agents, float64[M, T], zero past the end.
    :ivar actions: what the actors would have done before this update, float32[M, T, 2] [m/s2] by agent.
    :ivar more: other losses and norms of the objective, by name.
    """

    critic_loss: dict[str, float]
    actor_loss: dict[str, float]
    gradient_norm: float
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

    :ivar alone: each critic is a single agent's: it gets zero in place of the other agent's action.
    """

    def __init__(self, networks: Networks, config: UpdatesConfig) -> None:
        self.networks, self.config = networks, config
        self.alone = False
        self.critic_optimiser = Adam(networks.critics.parameters(), config.critic_learning_rate)
        self.actor_optimiser = Adam(networks.actor.parameters(), config.actor_learning_rate)

    def act(self, batch: Batch, gradient: bool = True) -> Tensors:
        """Return mu(H(t)), float32[M, T, 2], of both agents; for recorded steps every t has the last step's action."""
        actions = {}
        with torch.set_grad_enabled(gradient):
            for agent in AGENTS:
                seen, before = batch.observation[agent][:, :-1], previous(batch.action[agent], batch.came[agent])
                action = _encoded(self.networks.actor[agent], batch, 0, seen, before, batch.curvttc[:, :-1])
                actions[agent] = action.expand(-1, batch.present.shape[1], -1)
        return actions

    def update(
        self,
        batch: Batch,
        scored: Scored,
        actions: Tensors | None,
        rng: np.random.Generator,
        besides: Tensor | None = None,
        weight: float = 1.0,
        rate: float = 1.0,
    ) -> UpdateResult:
        """Update the critics and, given `actions` of `act`, the actors once; then update the targets.

        Errors and losses are those of the first critics, whose values the actors follow.

        :param besides: a loss of the actors besides the policy gradient; weight: of the policy gradient; rate: of
            `improve`.
        """
        count = batch.present.sum()
        targets = self.targets(scored, rng)
        states, critic_loss, error = {}, {}, torch.zeros_like(scored.reward["vehicle"])
        losses = []
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            before = previous(batch.action[agent], batch.came[agent])
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
        norm = math.nan
        if actions is not None:
            objective, whole = self._policy_objective(batch, actions, states)
            actor_loss = {agent: float(own.detach()) * UNIT for agent, own in objective.items()}
            besides = torch.zeros(()) if besides is None else besides
            norm = self.improve(besides + weight * whole if weight else besides, rate)
        self.networks.follow(self.config.target_update_rate)
        return UpdateResult(critic_loss, actor_loss, norm, error.double().numpy())

    def _others(self, action: Tensor) -> Tensor:
        """Return what a critic sees of the other agent's action."""
        return torch.zeros_like(action) if self.alone else action

    @torch.no_grad()
    def targets(self, scored: Scored, rng: np.random.Generator) -> Tensors:
        """Return y(t) = R(t) + gamma min Q'(H(t + 1), mu'(H(t + 1)), mu'_other(H(t + 1))), the least of all critics.

        Target actions get normal noise of `target_noise`, cut off at twice that.
        """
        networks, batch, following = self.networks, scored.batch, {}
        before = {a: torch.cat([batch.came[a][:, None], x], dim=1) for a, x in batch.action.items()}
        for agent in AGENTS:
            actor = networks.target_actor[agent]
            action = _encoded(actor, batch, 1, batch.observation[agent], before[agent], batch.curvttc)
            if deviation := self.config.target_noise:
                noise = rng.normal(0.0, deviation, tuple(action.shape)).clip(-2.0 * deviation, 2.0 * deviation)
                action = (action + torch.from_numpy(noise.astype(np.float32))).clamp(-actor.limit, actor.limit)
            following[agent] = action
        rows, targets = torch.arange(len(batch.length)), {}
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            encoder, others = networks.target_critic[agent].encoder, self._others(following[other])
            encoded = _encoded(encoder, batch, 1, batch.observation[agent], before[agent], batch.curvttc)
            critics = [cast(Critics, every)[agent] for every in networks.target_critics]
            values = [critic.value(critic.branch(encoded), following[agent], others) for critic in critics]
            value = torch.stack(values).amin(dim=0).expand(-1, batch.present.shape[1] + 1)
            after = value[:, 1:].clone()
            after[rows, batch.length - 1] = value[rows, batch.length] * ~batch.terminal
            targets[agent] = scored.reward[agent] / UNIT + self.config.discount * after
        return targets

    def improve(self, loss: Tensor, rate: float = 1.0) -> float:
        """Follow the gradient of a loss of both actors; return its norm before it is clipped.

        :param rate: share of the configured step size.
        """
        for group in self.actor_optimiser.param_groups:
            group["lr"] = rate * self.config.actor_learning_rate
        parameters = list(self.networks.actor.parameters())
        for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
            parameter.grad = gradient
        norm = float(torch.nn.utils.clip_grad_norm_(parameters, ACTORS_CLIP))
        self.actor_optimiser.step()
        return norm

    def _policy_objective(self, batch: Batch, actions: Tensors, states: Tensors) -> tuple[Tensors, Tensor]:
        """Return -Q(H, mu(H), mu_other(H_other)) by agent, the critics held fixed, and the sum of both over mean |Q|.

        Both agents' actions are what their actors do now, as in the framework that the paper's authors released; Lowe
        et al. take the other's from the buffer, though its actor may have left that long ago.

        `states` are the histories as the first critics had them before their step of this update; to encode them again
        would turn the gradient by less than 4 degrees and cost a quarter of the update.
        """
        count, objective, whole = batch.present.sum(), {}, torch.zeros(())
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            others = self._others(actions[other].detach())
            value = self.networks.critic[agent].value(states[agent].detach(), actions[agent], others)
            objective[agent] = -(value * batch.present).sum() / count
            size = (value.detach().abs() * batch.present).sum() / count
            whole = whole + objective[agent] / size.clamp(min=LEAST_VALUE)
        return objective, whole
