"""The objective of deterministic actors: they follow gradients through the known, differentiable kinematics.

Stage 1 takes them to the recorded trajectories (`imitation`), stage 2 to what both agents lose in the next simulated
seconds (`foresight`) and, beside that, to a few recorded trajectories, so that people are not forgotten. The critics
learn by the same temporal difference as elsewhere on the way, and what acts and is kept is the actors' running average:
it predicts unseen clips better than their last state.
"""

from dataclasses import replace

import numpy as np
import torch

from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.foresight import draw_moments, draw_scripted, foresee, moments_at, step_along
from vpsci_ros.learning.imitation import Rehearsal, TrajectoryImitation
from vpsci_ros.learning.maddpg import Tensors, UpdateResult
from vpsci_ros.learning.objectives import Objective, Training
from vpsci_ros.learning.replay import Batch
from vpsci_ros.world.observation import AGENTS, STEP

GAIN = 0.5  # `pedestrian_gain` of the world that is foreseen, (21)-(24)


class Imitating:
    """See `StageObjective`: the actors learn from recorded trajectories."""

    def __init__(self, training: Training, config: PretrainConfig) -> None:
        self._training = training
        self._imitation = TrajectoryImitation(training.maddpg.networks, training.real, config)
        self.optimisers = (self._imitation.optimiser,)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `StageObjective.update`."""
        losses = self._imitation.update(rng, iteration)
        return replace(self._training.update_critics(batch, rng), more=losses)


class Foreseeing:
    """See `StageObjective`: the actors learn from what they lose in the next simulated seconds."""

    optimisers = ()

    def __init__(self, training: Training, config: RefineConfig) -> None:
        self._training, self._config = training, config
        self._rehearsal = Rehearsal(training, config.rehearsal.rollouts)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `StageObjective.update`."""
        actions = self._training.maddpg.act(batch)
        result = self._training.maddpg.update(batch, self._training.rewards.score(batch, actions, rng), None)
        return replace(result, actions=actions, more=self._look_ahead(batch, actions, rng))

    def _look_ahead(self, batch: Batch, actions: Tensors, rng: np.random.Generator) -> dict[str, float]:
        """Improve the actors by what they lose, and return it by name."""
        config, maddpg, simulated = self._config.foresight, self._training.maddpg, self._training.simulated()
        if not simulated:
            return {}
        histories, at = draw_moments(simulated, config.rollouts, config.hand_over_share, rng)
        collision, goal = foresee(
            maddpg.networks.actor,
            moments_at(histories, at),
            steps=config.steps,
            anticipation=config.clearance_ahead,
            gain=GAIN,
            scripted=draw_scripted(len(histories), config.steps, config.braking_share, config.insisting_shares, rng),
        )
        rewards = [self._training.rewards.speed(batch, actions[agent], agent) for agent in AGENTS]
        speed_loss = -(torch.stack(rewards) * batch.present).sum() / (len(AGENTS) * batch.present.sum())
        losses = {"collision": collision, "goal": goal, "speed": speed_loss}
        weights = self._training.weights() * config.scale
        total = sum((float(w) * part for w, part in zip(weights, losses.values(), strict=True)), torch.zeros(()))
        optimiser, actors = maddpg.actor_optimiser, maddpg.networks.actor
        weight, clip = self._config.rehearsal.weight, self._config.updates.gradient_clip
        norm, _ = step_along(optimiser, actors, total, lambda: self._rehearsal.loss(rng), weight, clip)
        return {f"lost_{name}": float(part.detach()) for name, part in losses.items()} | {"gradient_norm": norm}


OBJECTIVE = Objective(
    pretrain=Imitating,
    refine=Foreseeing,
    acting="target_actor",
    known_world={"pedestrian_gain": GAIN, "lane_following": True, "policy_period": STEP},
)
