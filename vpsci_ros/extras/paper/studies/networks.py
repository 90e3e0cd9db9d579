"""How each network of `vpsci_ros.policy.models` learns for `vpsci study models`.

All learn from the same near misses in the same number of updates. By imitation: agents rolled out together on their own
predictions through the kinematics, or the next velocity alone from recorded histories (the paper's supervised rows). By
reinforcement: the paper's multi-agent and single-agent rows, as `vpsci pretrain` trains them. By prediction: the three
predictors of trajectories, each by its own loss.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
import torch

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.learning.imitation import TrajectoryImitation
from vpsci_ros.learning.maddpg import Maddpg
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Training, find_objective
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.prediction import Prediction
from vpsci_ros.learning.replay import collate, recorded_histories, up_to_capacity
from vpsci_ros.learning.rewards import RecordedRewards
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import MODELS, network_of
from vpsci_ros.policy.weights import Weights

Report = Callable[[dict[str, float]], None]


class _Learning(Protocol):
    def update(self, rng: np.random.Generator, iteration: int) -> dict[str, float]: ...


def by_reinforcement(name: str) -> bool:
    """Return whether the model of this name learns by the policy gradient of critics."""
    return MODELS.find(name).learning.endswith("ddpg")


def acting(name: str) -> str:
    """Return which actors of a trained model act, of `Networks.weights`: targets, or by reinforcement the actors."""
    return "actor" if by_reinforcement(name) else "target_actor"


def whole_tracks(name: str) -> bool:
    """Return whether the model of this name learns from whole joint tracks: predictors need 3 s after a step."""
    return MODELS.find(name).learning == "prediction"


def untrained(name: str, network: NetworkConfig, seed: int) -> Networks:
    """Return the networks of this name; targets start equal to them.

    :raises InvalidInput: see `network_of`.
    """
    torch.manual_seed(seed)
    return Networks(network_of(name, network))


@one_thread()
def train(
    name: str,
    interactions: Interactions,
    config: PretrainConfig,
    network: NetworkConfig,
    seed: int,
    report: Report | None = None,
    start: Weights | None = None,
) -> Networks:
    """Train the model of this name; what predicts is the running average of its actors (targets).

    :param config: by reinforcement its `rewards`, `updates`, `replay` and `ddpg`, else its `imitation`.
    :param report: called after every update with `episode`, `episodes` and the losses by name.
    :param start: what it goes on from, normalisation and statistics included; None: from nothing.
    """
    networks = untrained(name, network, seed) if start is None else Networks.from_weights(start)
    if start is None:
        networks.set_statistics(*interactions.samples(), config.rewards.least_speed_deviation)
    torch.manual_seed(seed)
    model, rng = MODELS.find(name), np.random.default_rng(seed)
    learning: _Learning
    if by_reinforcement(name):
        learning = _Reinforcement(model.learning, networks, interactions, config, rng)
    elif model.learning == "prediction":
        learning = Prediction(networks, interactions, config)
    else:
        steps = config.imitation.rollout_steps if model.together else 0
        config = replace(config, imitation=replace(config.imitation, rollout_steps=steps))
        learning = TrajectoryImitation(networks, interactions, config)
    for episode in range(config.episodes):
        losses = learning.update(rng, episode)
        if not by_reinforcement(name):  # there the targets have followed already
            networks.follow(config.updates.target_update_rate)
        if report is not None:
            report({"episode": episode + 1, "episodes": config.episodes} | losses)
    return networks


class _Reinforcement:
    """Stage 1 by critics: what `learning.pretrain` does in an iteration."""

    def __init__(
        self,
        objective: str,
        networks: Networks,
        interactions: Interactions,
        config: PretrainConfig,
        rng: np.random.Generator,
    ) -> None:
        histories = recorded_histories(interactions)
        self._histories = [histories[i] for i in up_to_capacity(histories, config.replay.capacity, rng)]
        self._steps = config.replay.batch_size
        maddpg = Maddpg(networks, config.updates, config.ddpg.actor_learning_rate)
        training = Training(maddpg, RecordedRewards(config.rewards, networks), interactions, config)
        self._objective = find_objective(objective).pretrain(training, config)

    def update(self, rng: np.random.Generator, iteration: int) -> dict[str, float]:
        """Take one step of critics and actors, and return the losses by name."""
        picked, held = [], 0
        while held < self._steps:
            picked.append(self._histories[int(rng.integers(len(self._histories)))])
            held += len(picked[-1])
        result = self._objective.update(collate(picked), iteration, rng)
        critics = {f"{agent}_critic_loss": loss for agent, loss in result.critic_loss.items()}
        return critics | {f"{agent}_actor_loss": loss for agent, loss in result.actor_loss.items()}
