"""One update of each stage in the order of its events, by the objectives `ddpg` and `closed_loop`.

`PolicyGradient` is Algorithm 1: act, reward, critics, policy gradient, targets. With `closed_loop` the actors follow no
critics, but roll-outs through the known kinematics: in stage 1 to imitate people (`Imitation`), in stage 2 from
simulated hand-overs to avoid contact, with the imitation as a constraint (`Constrained`). `replay` draws the batches.
Other installed Python packages add objectives (docs/extending.md).

`Maddpg` differs from Algorithm 1 in two places:

- stage 2 has two critics an agent, of whose targets the lesser counts, and noise on the target actions, from
  'Addressing function approximation error in actor-critic methods' by Fujimoto et al. 2018 (TD3,
  https://arxiv.org/abs/1802.09477);
- the policy gradient is divided by the mean |Q|, from 'A minimalist approach to offline reinforcement learning' by
  Fujimoto and Gu 2021 (https://arxiv.org/abs/2106.06860).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.evaluation.scene import Scene
from vpsci_ros.learning.adam import Adam
from vpsci_ros.learning.closed_loop import DualWeight, Recorded, Start, penalties, roll_out, simulated_start
from vpsci_ros.learning.networks import Critics, Networks
from vpsci_ros.learning.ragged import by_length
from vpsci_ros.learning.replay import Batch, History, ReplayBuffer
from vpsci_ros.learning.rewards import Rewards, Scored, Tensors
from vpsci_ros.learning.training_config import ClosedLoopConfig, PretrainConfig, RefineConfig, UpdatesConfig
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.world.observation import AGENTS

UNIT = 100.0  # rewards are divided by this before the critics learn them, so that values are of order one; ours
GRADIENT_CLIP, ACTORS_CLIP = 1.0, 20.0  # gradients of critics and actors are scaled down to these norms; ours
LEAST_VALUE = 0.05  # the policy gradient is divided by the mean |Q| of a batch, or by this; in units of `UNIT`


@dataclass
class UpdateResult:
    """The losses and norms of an update.

    :ivar critic_loss: by agent; error: |delta| in units of the reward, mean of both agents, float64[M, T], zero past
        the end; empty and None if no critic learned.
    :ivar actions: of the actors before this update, float32[M, T, 2] [m/s2] by agent.
    :ivar actor_loss: -Q [reward] by agent; gradient_norm: of all that the actors followed; empty and not a number if
        they followed no critic.
    :ivar more: other losses and norms of the objective, by name.
    """

    critic_loss: dict[str, float] = field(default_factory=dict)
    error: NDArray[np.float64] | None = None
    actions: Tensors = field(default_factory=dict)
    actor_loss: dict[str, float] = field(default_factory=dict)
    gradient_norm: float = math.nan
    more: dict[str, float] = field(default_factory=dict)

    def losses(self) -> dict[str, float]:
        """Return losses of critics and actors by name, and the norm of the gradient that the actors followed."""
        losses = {f"{agent}_critic_loss": loss for agent, loss in self.critic_loss.items()}
        if self.actor_loss:
            losses |= {f"{agent}_actor_loss": loss for agent, loss in self.actor_loss.items()}
            losses["gradient_norm"] = self.gradient_norm
        return losses


class Training(NamedTuple):
    """The networks, critics and data of a training, as an objective gets them.

    :ivar maddpg: networks, critics and their optimisers.
    :ivar rewards: the rewards of the stage, which choose and score the actions of a batch.
    :ivar real: the near misses to learn from.
    :ivar buffer: simulated histories; None in stage 1.
    """

    maddpg: "Maddpg"
    rewards: Rewards
    real: Interactions
    buffer: ReplayBuffer | None = None

    def update_critics(self, batch: Batch, rng: np.random.Generator) -> UpdateResult:
        """Update critics and targets once with the actors' present actions; the actors do not change."""
        actions = self.maddpg.act(batch, gradient=False)
        result, _ = self.maddpg.update_critics(batch, self.rewards.score(batch, actions, rng), rng)
        self.maddpg.follow()
        result.actions = actions
        return result


class StageObjective(Protocol):
    """Interface of an objective in one stage."""

    @property
    def optimisers(self) -> Sequence[Any]:
        """The objective's own optimisers and other state for checkpoints, each with `state_dict`, `load_state_dict`."""

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once; `iteration` counts from 0."""
        ...


@dataclass(frozen=True)
class Objective:
    """An objective of the actors: functions that return its `StageObjective` for stage 1 and stage 2."""

    pretrain: Callable[[Training, PretrainConfig], StageObjective]
    refine: Callable[[Training, RefineConfig], StageObjective]


class PolicyGradient:
    """Algorithm 1, in both stages: the actors follow the critics' policy gradient; see `StageObjective`."""

    optimisers = ()

    def __init__(self, training: Training) -> None:
        self._training = training

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once, see `StageObjective.update`."""
        maddpg = self._training.maddpg
        actions = maddpg.act(batch)  # mu(H(t))
        scored = self._training.rewards.score(batch, actions, rng)  # R(t), in stage 1 (14)-(15), in stage 2 (27)
        result, states = maddpg.update_critics(batch, scored, rng)  # y(t), (5) and L
        result.actor_loss, loss = maddpg.policy_losses(batch, actions, states)
        result.gradient_norm = maddpg.improve(loss)
        maddpg.follow()
        result.actions = actions
        return result


class Imitation:
    """Stage 1 by `closed_loop`: the actors imitate recorded near misses; see `StageObjective`."""

    optimisers = ()

    def __init__(self, training: Training, config: ClosedLoopConfig) -> None:
        self._training, self._config = training, config
        self._recorded = Recorded(training.real, config)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once, see `StageObjective.update`; nobody follows the critics here.

        They are for a stage 2 by `ddpg`.
        """
        maddpg, result = self._training.maddpg, self._training.update_critics(batch, rng)  # act, reward, critics
        recorded = self._recorded.draw(rng)
        scenes = [scene for scene, _ in roll_out(maddpg.networks.actor, recorded.start, self._config.imitated_steps)]
        error = recorded.error(scenes)
        norm = maddpg.improve(error, slower(iteration))
        result.more = {"closed_loop_error": float(error.detach()), "gradient_norm": norm}
        return result


class Constrained:
    """Stage 2 by `closed_loop`: the actors avoid what is wrong with simulated roll-outs; see `StageObjective`.

    Starts are steps of the buffer's simulated histories, half of them hand-overs, more often those that last ended
    near a contact; and recorded steps, whose error is limited by a `DualWeight`.
    """

    HAND_OVERS, RARELY = 0.5, 0.1

    def __init__(self, training: Training, config: ClosedLoopConfig) -> None:
        self._training, self._config = training, config
        self._recorded, self._weight = Recorded(training.real, config), DualWeight(config)
        self.optimisers = (self._weight,)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update the actors once, see `StageObjective.update`; the batch is for objectives with critics."""
        config, maddpg = self._config, self._training.maddpg
        # roll-outs
        histories, start, recorded = *self._draw(rng), self._recorded.draw(rng)
        both = start.and_then(recorded.start)
        scenes, done = zip(*roll_out(maddpg.networks.actor, both, config.steps, config.beyond), strict=True)
        count = len(histories)
        error = recorded.error([_rows(scene, count, None) for scene in scenes[: config.imitated_steps]])
        own = [{agent: values[:count] for agent, values in one.items()} for one in done]
        bad = penalties(start, [_rows(scene, 0, count) for scene in scenes], own, config)
        for history, near in zip(histories, bad.near.tolist(), strict=True):
            history.near = 0.5 * (history.near + near)
        # constraint and prices
        loss = self._weight.value * error
        for price, part in zip((config.contact, config.lane, config.late, config.effort), bad, strict=True):
            loss = loss + price * part.mean()
        # step
        norm = maddpg.improve(loss, slower(iteration))
        self._weight.note(float(error.detach()))
        means = {f"closed_loop_{name}": float(part.detach().mean()) for name, part in bad._asdict().items()}
        means |= {"closed_loop_weight": self._weight.value, "closed_loop_error": self._weight.mean}
        return UpdateResult(more=means | {"gradient_norm": norm})

    def _draw(self, rng: np.random.Generator) -> tuple[list[History], Start]:
        """Return simulated histories, equally many of each kind of scenes, and a step of each as a start."""
        assert self._training.buffer is not None
        kinds: dict[bytes, list[History]] = {}
        for history in self._training.buffer.simulated:
            kinds.setdefault(history.rules.tobytes(), []).append(history)
        histories, steps = [], []
        for _, known in sorted(kinds.items()):
            chance = np.array([history.near + self.RARELY for history in known])
            for i in rng.choice(len(known), size=self._config.simulated // len(kinds), p=chance / chance.sum()):
                first = rng.random() < self.HAND_OVERS
                histories.append(known[i])
                steps.append(0 if first else int(rng.integers(len(known[i]))))
        return histories, simulated_start(histories, steps)


def _rows(scene: Scene, begin: int, end: int | None) -> Scene:
    """Return some of the scenes."""
    return Scene(*(part[begin:end] for part in scene))


def slower(iteration: int) -> float:
    """Return the share of its step size that an update by `closed_loop` has."""
    return 1.0 / (1.0 + iteration / 500.0)


class Maddpg:
    """Actors, critics and target networks with their optimisers, and the parts of an update of them.

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
                action = _encoded(self.networks.actor[agent], batch, agent)
                actions[agent] = action.expand(-1, batch.present.shape[1], -1)
        return actions

    def update_critics(self, batch: Batch, scored: Scored, rng: np.random.Generator) -> tuple[UpdateResult, Tensors]:
        """Update the critics once by the loss with the weights (5); return losses, and states for `policy_losses`.

        Loss, error and states are those of the first critics. States are their branches before the step, by agent
        float32[M, T, 16]: to encode again would turn the policy gradient by less than 4 degrees, for a quarter of the
        update's cost.
        """
        targets = self.targets(scored, rng)
        count, states, loss, losses = batch.present.sum(), {}, {}, []
        error = torch.zeros_like(scored.reward["vehicle"])
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            encoded = _encoded(self.networks.critic[agent].encoder, batch, agent)
            for critics in self.networks.critics:
                critic = cast(Critics, critics)[agent]
                state = critic.branch(encoded).expand(-1, batch.present.shape[1], -1)
                value = critic.value(state, scored.action[agent], self._others(scored.action[other]))
                delta = (targets[agent] - value) * batch.present
                omega = importance(delta.detach() * UNIT, batch.present, self.config.importance_temperature)
                losses.append((omega * delta**2).sum() / count)
                if agent not in states:
                    states[agent] = state.detach()
                    loss[agent] = float((delta.detach() ** 2).sum() / count) * UNIT**2
                    error += delta.detach().abs() * (UNIT / len(AGENTS))
        self.critic_optimiser.zero_grad()
        torch.stack(losses).sum().backward()
        torch.nn.utils.clip_grad_norm_(self.networks.critics.parameters(), GRADIENT_CLIP)
        self.critic_optimiser.step()
        return UpdateResult(loss, error.double().numpy()), states

    @torch.no_grad()
    def targets(self, scored: Scored, rng: np.random.Generator) -> Tensors:
        """Return y(t) = R(t) + gamma min Q'(H(t + 1), mu'(H(t + 1)), mu'_other(H(t + 1))), the least of all critics.

        Target actions get normal noise of `target_noise`, cut off at twice that.
        """
        networks, batch, following = self.networks, scored.batch, {}
        for agent in AGENTS:
            action = _encoded(actor := networks.target_actor[agent], batch, agent, 1)
            if deviation := self.config.target_noise:
                noise = rng.normal(0.0, deviation, tuple(action.shape)).clip(-2.0 * deviation, 2.0 * deviation)
                action = (action + torch.from_numpy(noise.astype(np.float32))).clamp(-actor.limit, actor.limit)
            following[agent] = action
        rows, targets = torch.arange(len(batch.length)), {}
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            encoded = _encoded(networks.target_critic[agent].encoder, batch, agent, 1)
            others = self._others(following[other])
            critics = [cast(Critics, every)[agent] for every in networks.target_critics]
            values = [critic.value(critic.branch(encoded), following[agent], others) for critic in critics]
            value = torch.stack(values).amin(dim=0).expand(-1, batch.present.shape[1] + 1)
            after = value[:, 1:].clone()
            after[rows, batch.length - 1] = value[rows, batch.length] * ~batch.terminal
            targets[agent] = scored.reward[agent] / UNIT + self.config.discount * after
        return targets

    def policy_losses(self, batch: Batch, actions: Tensors, states: Tensors) -> tuple[dict[str, float], Tensor]:
        """Return -Q(H, mu(H), mu_other(H_other)) [reward] by agent, and the sum of both over mean |Q|, critics fixed.

        Both agents' actions are what their actors do now, as in the framework that the paper's authors released; Lowe
        et al. take the other's from the buffer, though its actor may have left that long ago.
        """
        count, losses, whole = batch.present.sum(), {}, torch.zeros(())
        for agent, other in zip(AGENTS, AGENTS[::-1], strict=True):
            others = self._others(actions[other].detach())
            value = self.networks.critic[agent].value(states[agent], actions[agent], others)
            loss = -(value * batch.present).sum() / count
            size = (value.detach().abs() * batch.present).sum() / count
            losses[agent] = float(loss.detach()) * UNIT
            whole = whole + loss / size.clamp(min=LEAST_VALUE)
        return losses, whole

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

    def follow(self) -> None:
        """Move the target networks towards the networks, by the soft update rate."""
        self.networks.follow(self.config.target_update_rate)

    def _others(self, action: Tensor) -> Tensor:
        """Return what a critic sees of the other agent's action."""
        return torch.zeros_like(action) if self.alone else action


def importance(error: Tensor, present: Tensor, temperature: float) -> Tensor:
    """Return omega of (5), exp(|delta| / tau), divided by its mean over `present`; zero elsewhere.

    The mean is one factor for the whole loss, to which Adam's steps are indifferent.
    """
    exponent = error.abs() / temperature
    omega = torch.exp(exponent - exponent[present].max()) * present
    return omega / (omega.sum() / present.sum())


def _encoded(network: nn.Module, batch: Batch, agent: str, more: int = 0) -> Tensor:
    """Return an actor's or encoder's output at each step of histories, float32[M, T, n]; recorded steps: [M, 1, n].

    :param more: steps after the last action that are included: 1 for target networks, else 0.
    """
    before = torch.cat([batch.came[agent][:, None], batch.action[agent]], dim=1)
    steps = batch.present.shape[1] + more
    inputs = [values[:, :steps] for values in (batch.observation[agent], before, batch.curvttc)]
    if batch.step is not None:
        out: Tensor = network(*inputs, batch.step + more)
        return out
    return by_length(network, inputs, batch.length + more)


def _by_critics(training: Training, config: PretrainConfig | RefineConfig) -> PolicyGradient:
    return PolicyGradient(training)


DDPG = Objective(pretrain=_by_critics, refine=_by_critics)
CLOSED_LOOP = Objective(
    pretrain=lambda training, config: Imitation(training, config.closed_loop),
    refine=lambda training, config: Constrained(training, config.closed_loop),
)

_ALL = PluginGroup("vpsci_ros.objectives", "objective", Objective, {"ddpg": DDPG, "closed_loop": CLOSED_LOOP})


def find_objective(name: str) -> Objective:
    """Return the objective of this name.

    :raises InvalidInput: no objective has this name, or the package that adds it is broken.
    """
    return _ALL.find(name)
