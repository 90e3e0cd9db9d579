"""DDPG by a single agent: each critic sees its own agent's action, and the other agent is part of what happens.

In stage 1 the other is replayed as it was recorded, in stage 2 it acts by a policy that learns for itself ('Continuous
control with deep reinforcement learning', Lillicrap et al. 2016, https://arxiv.org/abs/1509.02971). All else is as
in `ddpg`.
"""

from vpsci_ros.learning import ddpg
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.objectives import Objective, StageObjective, Training


def _pretrain(training: Training, config: PretrainConfig) -> StageObjective:
    training.maddpg.alone = True
    return ddpg.OBJECTIVE.pretrain(training, config)


def _refine(training: Training, config: RefineConfig) -> StageObjective:
    training.maddpg.alone = True
    return ddpg.OBJECTIVE.refine(training, config)


OBJECTIVE = Objective(pretrain=_pretrain, refine=_refine, follows_critics=True)
