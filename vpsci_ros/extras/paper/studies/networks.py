"""The training of each network of `vpsci_ros.policy.models` for `vpsci study models`.

All learn from the same near misses in the same number of updates: by supervision the next velocity of recorded steps
(the paper's supervised rows), or by reinforcement, multi-agent and single-agent, as `vpsci pretrain` trains.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Maddpg, Training, find_objective
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.replay import Batch, draw_recorded
from vpsci_ros.learning.rewards import RecordedRewards
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.models import MODELS
from vpsci_ros.policy.policy_config import SST, NetworkConfig
from vpsci_ros.policy.sst import SSTLayer
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import AGENTS, STEP

Report = Callable[[dict[str, float]], None]
Update = Callable[[Batch, int, np.random.Generator], dict[str, float]]
"""Takes one step of the training and returns the losses by name."""


def by_reinforcement(name: str) -> bool:
    """Return whether the model of this name is trained by the policy gradient of critics."""
    return MODELS.find(name).learning.endswith("ddpg")


def network_of(name: str, network: NetworkConfig) -> NetworkConfig:
    """Return `network` with the encoder of this name.

    :raises InvalidInput: no network has this name.
    """
    return replace(network, encoder=SST if MODELS.find(name).layer is SSTLayer else name)


def untrained(name: str, network: NetworkConfig, seed: int) -> Networks:
    """Return untrained networks of this name, and target networks equal to them.

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
    report: Report = lambda _: None,
    start: Weights | None = None,
) -> Networks:
    """Train the model of this name, and return its networks.

    :param report: called after every update with `episode`, `episodes` and the losses by name.
    :param start: what it goes on from, normalisation and statistics included; None: from nothing.
    """
    networks = untrained(name, network, seed) if start is None else Networks.from_weights(start)
    if start is None:
        networks.set_statistics(*interactions.samples(), config.rewards.least_speed_deviation)
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    if by_reinforcement(name):
        update = _reinforcement(MODELS.find(name).learning, networks, interactions, config)
    else:
        update = _supervision(networks, config)
    for episode in range(config.episodes):
        losses = update(draw_recorded(interactions, config.replay.batch_size, rng), episode, rng)
        report({"episode": episode + 1, "episodes": config.episodes} | losses)
    return networks


def _supervision(networks: Networks, config: PretrainConfig) -> Update:
    """Return the update towards the next velocity of recorded steps: mean absolute error of each component [m/s]."""
    maddpg = Maddpg(networks, config.updates)

    def update(batch: Batch, iteration: int, rng: np.random.Generator) -> dict[str, float]:
        said, count = maddpg.act(batch), 2.0 * len(AGENTS) * batch.present.sum()
        errors = [((said[a] - batch.action[a]).abs().sum(dim=2) * batch.present).sum() for a in AGENTS]
        loss = STEP * torch.stack(errors).sum() / count
        maddpg.actor_optimiser.zero_grad()
        loss.backward()
        maddpg.actor_optimiser.step()
        return {"velocity_error": float(loss.detach())}

    return update


def _reinforcement(name: str, networks: Networks, interactions: Interactions, config: PretrainConfig) -> Update:
    """Return the update of stage 1 by critics: what `learning.pretrain` does in an iteration."""
    training = Training(Maddpg(networks, config.updates), RecordedRewards(config.rewards, networks), interactions)
    objective = find_objective(name).pretrain(training, config)

    def update(batch: Batch, iteration: int, rng: np.random.Generator) -> dict[str, float]:
        return objective.update(batch, iteration, rng).losses()

    return update
