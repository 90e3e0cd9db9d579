"""Training objectives of the actors by name, for both stages; critics learn by temporal difference.

`ddpg` is the paper's. Other installed Python packages add theirs (docs/extending.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from torch.optim import Optimizer

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.maddpg import Maddpg, UpdateResult
from vpsci_ros.learning.replay import Batch
from vpsci_ros.learning.rewards import Rewards
from vpsci_ros.runs.plugins import PluginGroup


class Training(NamedTuple):
    """The networks, critics and data of a training, as an objective gets them.

    :ivar maddpg: networks, critics and their optimisers.
    :ivar rewards: the rewards of the stage, which choose and score the actions of a batch.
    :ivar real: the near misses to learn from.
    """

    maddpg: Maddpg
    rewards: Rewards
    real: Interactions

    def update_critics(self, batch: Batch, rng: np.random.Generator) -> UpdateResult:
        """Update critics and targets once with the actors' present actions; the actors do not change."""
        actions = self.maddpg.act(batch, gradient=False)
        scored = self.rewards.score(batch, actions, rng)
        return replace(self.maddpg.update(batch, scored, None, rng), actions=actions)


class StageObjective(Protocol):
    """Interface of an objective in one stage."""

    @property
    def optimisers(self) -> Sequence[Optimizer]:
        """The objective's own optimisers, for checkpoints."""

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once; `iteration` counts from 0."""
        ...


@dataclass(frozen=True)
class Objective:
    """An objective of the actors: its classes for stage 1 and stage 2.

    :ivar pretrain: returns the `StageObjective` that updates the networks in stage 1.
    :ivar refine: returns the `StageObjective` that updates the networks in stage 2.
    """

    pretrain: Callable[[Training, PretrainConfig], StageObjective]
    refine: Callable[[Training, RefineConfig], StageObjective]


class PolicyGradient:
    """The actors follow the critics' policy gradient, as in Algorithm 1; see `StageObjective`."""

    optimisers = ()

    def __init__(self, training: Training) -> None:
        self._training = training

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once, see `StageObjective.update`."""
        actions = self._training.maddpg.act(batch)
        scored = self._training.rewards.score(batch, actions, rng)
        return replace(self._training.maddpg.update(batch, scored, actions, rng), actions=actions)


def _by_critics(training: Training, config: PretrainConfig | RefineConfig) -> PolicyGradient:
    return PolicyGradient(training)


DDPG = Objective(pretrain=_by_critics, refine=_by_critics)

_ALL = PluginGroup("vpsci_ros.objectives", "objective", Objective, {"ddpg": DDPG})


def find_objective(name: str) -> Objective:
    """Return the objective of this name.

    :raises InvalidInput: no objective has this name, or the package that adds it is broken.
    """
    return _ALL.find(name)
