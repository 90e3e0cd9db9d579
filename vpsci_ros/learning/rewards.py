"""All rewards of the paper: speed (14)-(15), collision (25), goal (26) and their weighting (27)-(28).

Speeds are those of the next step, expressed in the vehicle's heading frame of the step at which the action was taken.
In its own frame the vehicle never moves sideways, so a deviation taken there would be zero and (14) undefined.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.evaluation.scene import advance, observe, time_to_collision
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.replay import Batch, Floats, History, collate
from vpsci_ros.learning.training_config import RewardsConfig, SpeedRewardsConfig
from vpsci_ros.policy.actor import previous
from vpsci_ros.world.observation import AGENTS, STEP
from vpsci_ros.world.transition import TRANSITION

RULES = "release", "pedestrian_gain", "keeps_lane", "limited"  # fields of a transition, of one value an episode
Tensors = dict[str, Tensor]
EXPLORATION = 0.5  # [m/s2] standard deviation of the actions scored in stage 1 around the actor's; ours


def predicted_velocity(velocity: Tensor, action: Tensor) -> Tensor:
    """Return v(t+1) = v(t) + a(t) dt, (8)-(9): velocity [..., 2] m/s, action [..., 2] m/s2, in the frame of step t."""
    return velocity + action * STEP


def speed_reward(predicted: Tensor, observed: Tensor, deviation: Tensor) -> Tensor:
    """Return R_v of (14)-(15), float[...], never positive, before scaling.

    -sum over both components of ((v_predicted - mu) / sigma - (v_observed - mu) / sigma)^2, in which mu cancels.

    :param predicted: v(t+1) by the policy's action, float[..., 2] [m/s].
    :param observed: v(t+1) as recorded, float[..., 2] [m/s].
    :param deviation: sigma of the recorded speeds, float[2] [m/s].
    """
    return -(((predicted - observed) / deviation) ** 2).sum(dim=-1)


class RewardWeights:
    """Each agent's w_1 (collision), w_2 (goal), w_3 (speed) of (27), fixed or adapted by (28) after each episode.

    (28) multiplies each weight by exp(lambda |mean reward|) and normalises, so a component that is larger on average
    takes over in the end, whatever lambda; lambda only sets how many episodes that takes.

    :ivar values: float64[2, 3], of vehicle and pedestrian.
    """

    def __init__(self, config: RewardsConfig) -> None:
        self.adaptive = not config.weights
        self._temperature = config.weight_temperature
        own = np.array(config.weights or [1.0, 1.0, 1.0])
        self.values: NDArray[np.float64] = np.tile(own / own.sum(), (len(AGENTS), 1))

    def episode(self, means: NDArray[np.float64]) -> None:
        """Update the weights by the mean rewards of an episode, float64[2, 3], (collision, goal, speed) by agent."""
        if not self.adaptive:
            return
        exponent = self._temperature * np.abs(means)
        grown = self.values * np.exp(exponent - exponent.max(axis=1, keepdims=True))
        self.values = grown / grown.sum(axis=1, keepdims=True)


class SpeedReward:
    """The speed reward (14)-(15) of actions at the steps of a batch.

    :param networks: whose `speed_deviation` is sigma.
    :param scaling: factor on the reward.
    """

    def __init__(self, networks: Networks, scaling: float) -> None:
        self._deviation, self._scaling = networks.speed_deviation, scaling

    def __call__(self, batch: Batch, action: Tensor, agent: str) -> Tensor:
        """Return the reward, float32[M, T], of actions [M, T, 2] [m/s2], past the end as well."""
        predicted = predicted_velocity(batch.observation[agent][:, :-1, :2], action)
        return speed_reward(predicted, batch.next_velocity[agent], self._deviation[agent]) * self._scaling


@dataclass(frozen=True)
class Scored:
    """Evaluated actions, float32[M, T, 2] [m/s2] by agent, their rewards, float32[M, T], and the next observations.

    :ivar batch: the batch with the observations to which these actions lead.
    """

    action: Tensors
    reward: Tensors
    batch: Batch


class Rewards(Protocol):
    """Interface of the rewards of a stage."""

    speed: SpeedReward

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """Return the evaluated actions and their rewards, given the actors' `actions` [M, T, 2] [m/s2] by agent."""
        ...


class RecordedRewards:
    """The rewards of stage 1: the speed reward of noisy actions of the actors, by the recorded next speeds."""

    def __init__(self, config: SpeedRewardsConfig, networks: Networks) -> None:
        self.speed = SpeedReward(networks, config.speed_scaling)

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """Score noisy actions at the recorded steps, with next observations by the kinematics; see `Rewards.score`."""
        scored = {agent: explored(actions[agent], EXPLORATION, rng) for agent in AGENTS}
        rewards = {agent: self.speed(batch, scored[agent], agent) * batch.present for agent in AGENTS}
        return Scored(scored, rewards, _followed(batch, scored))


def _followed(batch: Batch, done: Mapping[str, Tensor]) -> Batch:
    """Return recorded steps, followed by the step to which the actions `done`, [M, T, 2] [m/s2], lead by (8)-(9)."""
    assert batch.scene is not None
    rows, last = torch.arange(len(batch.length)), batch.length - 1
    scene = advance(batch.scene, {agent: done[agent][rows, last].double() for agent in AGENTS})
    curvttc, observation, action = batch.curvttc.clone(), {}, {}
    curvttc[rows, last + 1] = time_to_collision(scene).float() if scene.finite else torch.nan  # the loss says so
    for agent, seen in zip(AGENTS, observe(scene), strict=True):
        observation[agent], action[agent] = batch.observation[agent].clone(), batch.action[agent].clone()
        observation[agent][rows, last + 1] = seen.float()
        action[agent][rows, last] = done[agent][rows, last]
    return replace(batch, observation=observation, curvttc=curvttc, action=action)


class SimulatedRewards:
    """The rewards of stage 2: collision, goal and speed (25)-(27) by `weights`, which may adapt by (28).

    In simulation nobody observes what a person would have done next, so the speed reward compares with what the
    *frozen stage-1 actor* does after the same history: it is zero where the policy still behaves as the real near
    misses taught it. Speeds are compared as (8)-(9) give them, so neither the pedestrian's gain in (21)-(24) nor lane
    keeping counts as a deviation.

    Real experience is scored as recorded: its actions have led to the recorded speeds, so that its speed reward is 0.

    :param networks: those of stage 1; a copy of their present actors is the reference of the speed reward.
    """

    def __init__(self, config: RewardsConfig, networks: Networks) -> None:
        self.speed = SpeedReward(networks, config.speed_scaling)
        self._frozen = copy.deepcopy(networks.actor).requires_grad_(False)
        self._collision, self._goal = config.collision, config.goal
        self.weights = RewardWeights(config)

    @torch.no_grad()
    def histories(self, finished: Sequence[NDArray[np.void]], discount: float) -> list[History]:
        """Return simulated episodes, TRANSITION[T] each, as histories: one for each time that the policies had control.

        Their next speeds are those that the frozen stage-1 actor would have chosen after the same steps. Events after
        the last step of a history are added to its own, each discounted by the time until then.
        """
        parts = [(rows, begin, end) for rows in finished for begin, end in controlled(rows)]
        if not parts:
            return []
        padded = np.zeros((len(parts), max(end - begin for _, begin, end in parts)), TRANSITION)
        padded["curvttc"] = np.inf
        for row, (rows, begin, end) in zip(padded, parts, strict=True):
            row[: end - begin] = rows[begin:end]
        curvttc, chosen = torch.from_numpy(padded["curvttc"].copy()), {}
        for agent in AGENTS:
            names = (f"{agent}_{name}" for name in ("observation", "action", "came"))
            seen, done, came = (torch.from_numpy(padded[name].copy()) for name in names)
            before = previous(done, came[:, 0])
            chosen[agent] = predicted_velocity(seen[..., :2], self._frozen[agent](seen, before, curvttc))
        return [
            self._history(rows, begin, end, {a: chosen[a][i, : end - begin].numpy().copy() for a in AGENTS}, discount)
            for i, (rows, begin, end) in enumerate(parts)
        ]

    def _history(
        self, rows: NDArray[np.void], begin: int, end: int, next_velocity: dict[str, Floats], discount: float
    ) -> History:
        """Return the steps `begin` to `end` of an episode, TRANSITION[T], in which the policies acted."""
        own, over = rows[begin:end], end == len(rows)
        after = {a: rows[f"next_{a}_observation"][-1] if over else rows[f"{a}_observation"][end] for a in AGENTS}
        later, events = discount ** np.arange(len(rows) - end + 1), {}
        for agent in AGENTS:
            every = self._events(rows["collision"], rows[f"{agent}_goal"])
            events[agent] = every[begin:end].copy()
            events[agent][-1] = later @ every[end - 1 :]
        return History(
            {a: np.concatenate([own[f"{a}_observation"], after[a][None]]) for a in AGENTS},
            np.append(own["curvttc"], rows["next_curvttc"][-1] if over else rows["curvttc"][end]),
            {a: own[f"{a}_came"].copy() for a in AGENTS},
            {a: own[f"{a}_action"].copy() for a in AGENTS},  # a view of one record has odd strides
            next_velocity,
            events,
            terminal=not over or bool(rows["terminal"][-1]),
            real=False,
            lane=own["lane"].copy(),
            way=own["way"].copy(),
            wanted=own["wanted"][0].copy(),
            rules=np.array([own[name][0] for name in RULES], np.float32),
        )

    def _events(self, collision: NDArray[np.uint8], goal: NDArray[np.uint8]) -> Floats:
        """Return (25) and (26), float32[T, 2], of steps that end in a collision or reach the agent's own goal, or not.

        :param collision, goal: 0 or 1, [T].
        """
        return np.stack([self._collision * collision, self._goal * goal], axis=1).astype(np.float32)

    def events(self, rows: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the sums of (25) and of (26) in an episode, TRANSITION[T], by agent, float64[2, 2]."""
        own = [self._events(rows["collision"], rows[f"{agent}_goal"]) for agent in AGENTS]
        return np.stack(own).sum(axis=1, dtype=np.float64)

    def components(self, history: History) -> NDArray[np.float64]:
        """Return each agent's (collision, goal, speed) rewards of every step, float64[2, T, 3], unweighted."""
        batch, components = collate([history]), []
        for agent in AGENTS:
            speed = (self.speed(batch, batch.action[agent], agent) * batch.present)[0].numpy()
            components.append(np.column_stack([history.events[agent], speed]).astype(np.float64))
        return np.stack(components)

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """Score the executed and the recorded actions by (27); see `Rewards.score`."""
        rewards = {}
        for agent, weights in zip(AGENTS, torch.from_numpy(self.weights.values.astype(np.float32)), strict=True):
            speed = self.speed(batch, batch.action[agent], agent) * batch.present
            rewards[agent] = (batch.events[agent] * weights[:2]).sum(dim=2) + weights[2] * speed
        return Scored(batch.action, rewards, batch)


def controlled(rows: NDArray[np.void]) -> list[tuple[int, int]]:
    """Return the steps of an episode, TRANSITION[T], from each hand-over to its hand-back, as (first, last + 1)."""
    acting = np.concatenate([[0], rows["acting"], [0]]).astype(np.int64)
    return list(zip(np.flatnonzero(np.diff(acting) == 1), np.flatnonzero(np.diff(acting) == -1), strict=True))


def explored(actions: Tensor, deviation: float, rng: np.random.Generator) -> Tensor:
    """Return `actions` plus normal noise of this standard deviation [m/s2], without gradient."""
    noise = rng.normal(0.0, deviation, tuple(actions.shape)).astype(np.float32)
    return actions.detach() + torch.from_numpy(noise)
