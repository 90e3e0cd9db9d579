"""The paper's objective: the actors follow the critics' policy gradient (Algorithm 1).

Recorded actions reproduce the recorded speeds, so their reward (14)-(15) is zero everywhere and teaches nothing about
other actions. The practical replay buffer of stage 1 therefore holds the recorded histories, and what is scored against
the observed next speeds at every step is the acting policy's action with exploration around it: the framework that the
paper's authors released does the same, whose policy explores from a recorded state before `reward_cal(next_state,
expert_state)` (https://github.com/Qpu523/MA-SST-DDPG-framework, Core_Code.py).

In stage 2 sampling (17) and the speed reward alone let the actors forget people faster than the critics can teach them,
so every update also rehearses a few real near misses in closed loop, and adds that gradient to the policy's.
"""

from dataclasses import replace

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.imitation import Rehearsal
from vpsci_ros.learning.maddpg import UpdateResult
from vpsci_ros.learning.objectives import Objective, Training
from vpsci_ros.learning.replay import Batch


class PolicyGradient:
    """See `StageObjective`. The actors rest for the first `rest` iterations, while the critics warm up."""

    optimisers = ()

    def __init__(self, training: Training, rest: int, rehearsal: Rehearsal | None = None, weight: float = 0.0) -> None:
        self._training, self._rest, self._rehearsal, self._weight = training, rest, rehearsal, weight

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `StageObjective.update`."""
        if iteration < self._rest:
            return replace(self._training.update_critics(batch, rng), rested=True)
        maddpg = self._training.maddpg
        actions = maddpg.act(batch)
        scored = self._training.rewards.score(batch, actions, rng)
        rehearsed = self._weight * self._rehearsal.loss(rng) if self._rehearsal and self._weight > 0.0 else None
        return replace(maddpg.update(batch, scored, actions, rehearsed), actions=actions)


def _pretrain(training: Training, config: PretrainConfig) -> PolicyGradient:
    _require_deterministic(training)
    return PolicyGradient(training, config.ddpg.critic_head_start)


def _refine(training: Training, config: RefineConfig) -> PolicyGradient:
    _require_deterministic(training)
    rehearsal = Rehearsal(training, config.rehearsal.rollouts)
    return PolicyGradient(training, config.ddpg.critic_warm_up, rehearsal, config.rehearsal.weight)


def _require_deterministic(training: Training) -> None:
    """Refuse actors that draw: the policy gradient of (27) does not reach their scales, nor what they draw."""
    if latent := training.maddpg.networks.config.latent:
        raise InvalidInput(
            f"network.latent = {latent}: the objective ddpg learns deterministic policies; expected weights without "
            "latent numbers, as params/paper_stage1.yaml makes them"
        )


OBJECTIVE = Objective(pretrain=_pretrain, refine=_refine, follows_critics=True)
