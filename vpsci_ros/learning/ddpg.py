"""The paper's objective: the actors follow the critics' policy gradient (Algorithm 1).

Recorded actions reproduce the recorded speeds, so their reward (14)-(15) is zero everywhere and teaches nothing about
other actions. The practical replay buffer of stage 1 therefore holds the recorded histories, and what is scored against
the observed next speeds at every step is the acting policy's action with exploration around it.

In stage 2 sampling (17) and the speed reward alone let the actors forget people faster than the critics can tell them,
so every update also rehearses a few real near misses in closed loop, and adds that gradient to the policy's.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import torch

from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.imitation import Rehearsal
from vpsci_ros.learning.maddpg import UpdateResult
from vpsci_ros.learning.objectives import Learner
from vpsci_ros.learning.replay import Batch


class PolicyGradient:
    """See `Stage`. The actors rest for the first `rest` iterations, while the critics warm up."""

    optimisers = ()

    def __init__(self, learner: Learner, rest: int, rehearsal: Rehearsal | None = None, weight: float = 0.0) -> None:
        self._learner, self._rest, self._rehearsal, self._weight = learner, rest, rehearsal, weight

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `Stage.update`."""
        maddpg, rests = self._learner.maddpg, iteration < self._rest
        with torch.set_grad_enabled(not rests):
            actions = maddpg.act(batch)
        scored = self._learner.rewards.score(batch, actions, rng)
        if rests:
            return replace(maddpg.update(batch, scored, None), actions=actions, rested=True)
        rehearsed = self._weight * self._rehearsal.loss(rng) if self._rehearsal and self._weight > 0.0 else None
        return replace(maddpg.update(batch, scored, actions, rehearsed), actions=actions)


class Ddpg:
    """See `Objective`."""

    acting = "actor"
    whole_tracks = False
    known_world: ClassVar[Mapping[str, float | bool]] = {}

    def pretrain(self, learner: Learner, config: PretrainConfig) -> PolicyGradient:
        """See `Objective.pretrain`."""
        return PolicyGradient(learner, config.ddpg.critic_head_start)

    def refine(self, learner: Learner, config: RefineConfig) -> PolicyGradient:
        """See `Objective.refine`."""
        rehearsal = Rehearsal(learner, config.rehearsal.rollouts)
        return PolicyGradient(learner, config.ddpg.critic_warm_up, rehearsal, config.rehearsal.weight)


OBJECTIVE = Ddpg()
