"""All rewards of the paper: speed (14)-(15), collision (25), goal (26) and their weighting (27)-(28).

Speeds are those of the next step, expressed in the vehicle's heading frame of the step at which the action was taken.
In its own frame the vehicle never moves sideways, so a deviation taken there would be zero and (14) undefined.
"""

import copy
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.learning.config import RewardsConfig, SpeedRewardsConfig
from vpsci_ros.learning.maddpg import Scored
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.replay import Batch, History, collate
from vpsci_ros.learning.transitions import TRANSITION
from vpsci_ros.policy.actor import previous
from vpsci_ros.world.observation import AGENTS, STEP


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
    """w_1 (collision), w_2 (goal), w_3 (speed) of (27): fixed, or adapted after every episode by (28).

    (28) multiplies each weight by exp(lambda |mean reward|) and normalises, so a component that is larger on average
    takes over in the end, whatever lambda; lambda only sets how many episodes that takes.
    """

    def __init__(self, config: RewardsConfig) -> None:
        self.adaptive = not config.weights
        self._temperature = config.weight_temperature
        self.values: NDArray[np.float64] = np.full(3, 1.0 / 3.0)
        if not self.adaptive:
            self.values = np.array(config.weights) / sum(config.weights)

    def episode(self, components: NDArray[np.float64]) -> None:
        """Take the rewards of one episode, float64[steps, 3] as (collision, goal, speed), into account."""
        if not self.adaptive or len(components) == 0:
            return
        exponent = self._temperature * np.abs(components.mean(axis=0))
        grown = self.values * np.exp(exponent - exponent.max())
        self.values = grown / grown.sum()

    def total(self, components: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return R of (27), float64[...], of components float64[..., 3]."""
        total: NDArray[np.float64] = components @ self.values
        return total


class SpeedReward:
    """(14)-(15) of actions in the steps of a batch.

    :param networks: whose `speed_deviation` is sigma.
    :param scaling: factor on the reward.
    """

    def __init__(self, networks: Networks, scaling: float) -> None:
        self._deviation, self._scaling = networks.speed_deviation, scaling

    def __call__(self, batch: Batch, action: Tensor, agent: str) -> Tensor:
        """Return the reward, float32[M, T], of actions [M, T, 2] [m/s2], past the end as well."""
        predicted = predicted_velocity(batch.observation[agent][:, :-1, :2], action)
        return speed_reward(predicted, batch.next_velocity[agent], self._deviation[agent]) * self._scaling


class Rewards(Protocol):
    """What a stage scores in a batch, and by what."""

    speed: SpeedReward

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """Return actions and their rewards, given what the actors would do, `actions` [M, T, 2] [m/s2] by agent."""
        ...


class RecordedRewards:
    """Stage 1: the speed reward of actions around the actors', by the recorded next speeds."""

    def __init__(self, config: SpeedRewardsConfig, networks: Networks) -> None:
        self._exploration, self.speed = config.exploration, SpeedReward(networks, config.speed_scaling)

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """See `Rewards.score`."""
        scored = {agent: explored(actions[agent], self._exploration, rng) for agent in AGENTS}
        return Scored(scored, {agent: self.speed(batch, scored[agent], agent) * batch.present for agent in AGENTS})


class SimulatedRewards:
    """Stage 2: collision, goal and speed (25)-(27) by `weights`, which adapt (28).

    In simulation nobody observes what a person would have done next, so the speed reward compares with what the
    *frozen stage-1 actor* does after the same history: it is zero where the policy still behaves as the real near
    misses taught it. Speeds are compared as (8)-(9) give them, so neither the pedestrian's halved accelerations
    (21)-(24) nor lane keeping count as a deviation.

    Real experience has no observed collision or goal. As in stage 1 it scores the acting policy's action, with
    exploration around it, against the recorded next speed, by the speed reward alone.

    :param networks: as stage 1 left them: their actors, as they are now, are the reference of the speed reward.
    """

    def __init__(self, config: RewardsConfig, networks: Networks) -> None:
        self._exploration, self.speed = config.exploration, SpeedReward(networks, config.speed_scaling)
        self._frozen = copy.deepcopy(networks.actor).requires_grad_(False)
        self._collision, self._goal = config.collision, config.goal
        self.weights = RewardWeights(config)

    @torch.no_grad()
    def histories(self, finished: Sequence[NDArray[np.void]]) -> list[History]:
        """Return simulated experience, TRANSITION[T] each, as histories.

        Their next speeds are those that the frozen stage-1 actor would have chosen after the same steps.
        """
        if not finished:
            return []
        padded = np.zeros((len(finished), 1 + max(map(len, finished))), TRANSITION)  # with the step after the last one
        padded["curvttc"] = np.inf
        for row, steps in zip(padded, finished, strict=True):
            row[: len(steps)] = steps
        curvttc, chosen = torch.from_numpy(padded["curvttc"].copy())[:, :-1], {}
        for agent in AGENTS:
            known = (torch.from_numpy(padded[f"{agent}_{name}"].copy()) for name in ("observation", "action"))
            seen, done = (part[:, :-1] for part in known)
            chosen[agent] = predicted_velocity(seen[..., :2], self._frozen[agent](seen, previous(done), curvttc))
        return [
            History(
                {a: np.concatenate([rows[f"{a}_observation"], rows[f"next_{a}_observation"][-1:]]) for a in AGENTS},
                np.append(rows["curvttc"], rows["next_curvttc"][-1]),
                {a: rows[f"{a}_action"].copy() for a in AGENTS},  # a view of one record has odd strides
                {a: chosen[a][i, : len(rows)].numpy().copy() for a in AGENTS},
                {a: self._events(rows["collision"], rows[f"{a}_goal"]) for a in AGENTS},
                terminal=bool(rows["terminal"][-1]),
                real=False,
            )
            for i, rows in enumerate(finished)
        ]

    def _events(self, collision: NDArray[np.uint8], goal: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return (25) and (26), float32[T, 2], of steps that end in a collision or reach the agent's own goal, or not.

        :param collision, goal: 0 or 1, [T].
        """
        return np.stack([self._collision * collision, self._goal * goal], axis=1).astype(np.float32)

    def components(self, history: History) -> dict[str, NDArray[np.float64]]:
        """Return (collision, goal, speed) rewards of every step by agent, float64[T, 3], before their weights."""
        batch, components = collate([history]), {}
        for agent in AGENTS:
            speed = self.speed(batch, batch.action[agent], agent)[0].numpy()
            components[agent] = np.column_stack([history.events[agent], speed]).astype(np.float64)
        return components

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """See `Rewards.score`: of simulated steps the executed actions, of real ones `actions` explored; by (27)."""
        scored, rewards = {}, {}
        real = batch.real[:, None, None]
        weights = torch.from_numpy(self.weights.values.astype(np.float32))
        for agent in AGENTS:
            tried = explored(actions[agent], self._exploration, rng)
            scored[agent] = torch.where(real, tried, batch.action[agent])
            speed = self.speed(batch, scored[agent], agent)
            rewards[agent] = ((batch.events[agent] * weights[:2]).sum(dim=2) + weights[2] * speed) * batch.present
        return Scored(scored, rewards)


def explored(actions: Tensor, deviation: float, rng: np.random.Generator) -> Tensor:
    """Return `actions` with normal noise of this deviation [m/s2], without their gradient."""
    noise = rng.normal(0.0, deviation, tuple(actions.shape)).astype(np.float32)
    return actions.detach() + torch.from_numpy(noise)
