"""What the actors follow while the critics learn by temporal difference: one object a name, for both stages.

Each is a module of this room of the same name, which holds it as `OBJECTIVE`; other distributions add theirs
(docs/extending.md). Configurations check their choice here, so nothing here imports them but for their types;
nor torch, which reading a configuration does not need.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from vpsci_ros.runs.plugins import PluginGroup

if TYPE_CHECKING:
    import torch

    from vpsci_ros.data.interactions import Interactions
    from vpsci_ros.learning.config import PretrainConfig, RefineConfig
    from vpsci_ros.learning.maddpg import Maddpg, UpdateResult
    from vpsci_ros.learning.replay import Batch, History
    from vpsci_ros.learning.rewards import Rewards

OBJECTIVES = {
    "closed_loop": "through the known kinematics, in stage 1 to the recorded trajectories and in stage 2 by rewards "
    "(25)-(27) made smooth, critics by TD",
    "energy_score": "in stage 1 to the distribution of recorded trajectories, by a proper score of roll-outs of "
    "stochastic actors",
    "ddpg": "the critics' policy gradient, as Algorithm 1 of the paper",
    "single_agent_ddpg": "the same, of critics that do not see the other agent's action",
}
DESCRIPTION = (
    "what the actors follow: "
    + "; ".join(f"{name}: {what}" for name, what in OBJECTIVES.items())
    + ("; or one that another distribution adds (docs/extending.md)")
)


class Training(NamedTuple):
    """What an objective learns with.

    :ivar maddpg: networks, critics and their optimisers. In stage 2 the actors take their steps by its
        `actor_optimiser`, whose step size decays and whose memory a rollback clears.
    :ivar rewards: which actions of a batch are scored, and by what.
    :ivar real: the near misses to learn from.
    :ivar stage_1: how stage 1 learns from them, or did.
    :ivar weights: those of collision, goal and speed as they are now (27); empty in stage 1.
    :ivar simulated: the simulated histories at hand as they are now; none in stage 1.
    """

    maddpg: "Maddpg"
    rewards: "Rewards"
    real: "Interactions"
    stage_1: "PretrainConfig"
    weights: Callable[[], np.ndarray] = lambda: np.zeros(0)
    simulated: Callable[[], list["History"]] = list

    def update_critics(self, batch: "Batch", rng: np.random.Generator) -> "UpdateResult":
        """Update critics and targets once, by what the actors would do now; the actors are left as they are."""
        actions = self.maddpg.act(batch, gradient=False)
        scored = self.rewards.score(batch, actions, rng)
        return replace(self.maddpg.update(batch, scored, None), actions=actions)


class StageObjective(Protocol):
    """An objective at work in one stage."""

    @property
    def optimisers(self) -> Sequence["torch.optim.Optimizer"]:
        """Those beside the ones of `Training.maddpg`, for checkpoints."""

    def update(self, batch: "Batch", iteration: int, rng: np.random.Generator) -> "UpdateResult":
        """Update critics, actors and targets once; `iteration` counts from 0."""
        ...


@dataclass(frozen=True)
class Objective:
    """What the actors follow, in stage 1 and in stage 2.

    :ivar pretrain: makes what updates the networks in stage 1.
    :ivar refine: makes what updates the networks in stage 2.
    :ivar acting: the networks that act, are measured and are kept: "actor", or "target_actor" for the actors' running
        average.
    :ivar whole_tracks: learns from whole joint tracks instead of the rows around the critical ones.
    :ivar follows_critics: the actors follow the critics, so stage 2 converts the values that stage 1 has learned;
        elsewhere critics only say which experience is drawn (17), and go on as they are.
    :ivar known_world: what this objective takes for granted in stage 2, by the names of `WorldConfig`.
    """

    pretrain: Callable[[Training, "PretrainConfig"], StageObjective]
    refine: Callable[[Training, "RefineConfig"], StageObjective]
    acting: str = "actor"
    whole_tracks: bool = False
    follows_critics: bool = False
    known_world: Mapping[str, float | bool] = field(default_factory=dict)


class _BuiltIn(Mapping[str, Objective]):
    """The objectives of `OBJECTIVES`, imported when they are looked up."""

    def __getitem__(self, name: str) -> Objective:
        found: Objective = importlib.import_module(f"vpsci_ros.learning.{name}").OBJECTIVE
        return found

    def __contains__(self, name: object) -> bool:
        return name in OBJECTIVES

    def __iter__(self) -> Iterator[str]:
        return iter(OBJECTIVES)

    def __len__(self) -> int:
        return len(OBJECTIVES)


_ALL = PluginGroup("vpsci_ros.objectives", "objective", Objective, _BuiltIn())


def find_objective(name: str) -> Objective:
    """Return the objective of this name, one of `OBJECTIVES` or of another distribution.

    :raises InvalidInput: there is none.
    """
    return _ALL.find(name)


def require_objective(name: str) -> None:
    """Refuse a name that no objective has; a built-in one is not imported for that.

    :raises InvalidInput: see `find_objective`.
    """
    if name not in OBJECTIVES:
        find_objective(name)
