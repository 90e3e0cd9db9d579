"""What simulated and real steps earn in stage 2: collision, goal and speed (25)-(27) by the adaptive weights (28).

In simulation nobody observes what a person would have done next, so the speed reward compares with what the *frozen
stage-1 actor* does after the same history: it is zero where the policy still behaves as the real near misses taught it.
Speeds are compared as (8)-(9) give them, so neither the pedestrian's halved accelerations (21)-(24) nor lane keeping
count as a deviation.

Real experience has no observed collision or goal. As in stage 1 it scores the acting policy's action, with exploration
around it, against the recorded next speed, by the speed reward alone.
"""

import copy
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.learning.actor import previous
from vpsci_ros.learning.config import AGENTS, RefineConfig
from vpsci_ros.learning.maddpg import Scored
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.replay import Batch, History, collate
from vpsci_ros.learning.rewards import RewardWeights, predicted_velocity, speed_reward


class SimulatedRewards:
    """The rewards of stage 2, and `weights`, which adapt to them.

    :param networks: as stage 1 left them: their actors, as they are now, are the reference of the speed reward.
    """

    def __init__(self, config: RefineConfig, networks: Networks) -> None:
        self._config, self._deviation = config, networks.speed_deviation
        self._frozen = copy.deepcopy(networks.actor).requires_grad_(False)
        self.weights = RewardWeights(config)

    @torch.no_grad()
    def refer(self, histories: Sequence[History]) -> None:
        """Fill in the next speeds that the frozen stage-1 actor would have chosen after the same histories."""
        batch = collate(histories)
        for agent in AGENTS:
            seen, before = batch.observation[agent][:, :-1], previous(batch.action[agent])
            action = self._frozen[agent](seen, before, batch.curvttc[:, :-1])
            velocity = predicted_velocity(seen[..., :2], action).numpy()
            for history, row in zip(histories, velocity, strict=True):
                history.next_velocity[agent] = row[: len(history)].copy()

    def components(self, history: History) -> dict[str, NDArray[np.float64]]:
        """Return (collision, goal, speed) rewards of every step by agent, float64[T, 3], before their weights."""
        batch, components = collate([history]), {}
        for agent in AGENTS:
            speed = self.speed(batch, batch.action[agent], agent)[0].numpy()
            components[agent] = np.column_stack([history.events[agent], speed]).astype(np.float64)
        return components

    def speed(self, batch: Batch, action: Tensor, agent: str) -> Tensor:
        """Return the speed reward (14)-(15), float32[M, T], of actions [M, T, 2] [m/s2] in the batch's steps."""
        predicted = predicted_velocity(batch.observation[agent][:, :-1, :2], action)
        reward = speed_reward(predicted, batch.next_velocity[agent], self._deviation[agent])
        return reward * self._config.online_reward_scaling

    def score(self, batch: Batch, actions: Mapping[str, Tensor], rng: np.random.Generator) -> Scored:
        """Return the actions that are scored, the executed ones or, in real steps, `actions` explored; and (27)."""
        scored, rewards = {}, {}
        real = batch.real[:, None, None]
        weights = torch.from_numpy(self.weights.values.astype(np.float32))
        for agent in AGENTS:
            mine = actions[agent].detach()
            noise = rng.normal(0.0, self._config.real_exploration, tuple(mine.shape)).astype(np.float32)
            scored[agent] = torch.where(real, mine + torch.from_numpy(noise), batch.action[agent])
            speed = self.speed(batch, scored[agent], agent)
            rewards[agent] = ((batch.events[agent] * weights[:2]).sum(dim=2) + weights[2] * speed) * batch.present
        return Scored(scored, rewards)
