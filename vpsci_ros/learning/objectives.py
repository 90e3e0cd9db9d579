"""Training objectives of the actors by name, for both stages; critics learn by temporal difference.

`ddpg` is the critics' policy gradient, as in Algorithm 1. With `closed_loop`, by which the shipped weights learned, the
actors are rolled out through the known kinematics: in stage 1 to imitate people, in stage 2 from simulated hand-overs
to avoid contact, with the imitation as a constraint. Other installed Python packages add theirs (docs/extending.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.evaluation.scene import Scene
from vpsci_ros.learning.closed_loop import Recorded, Start, penalties, roll_out, simulated_start
from vpsci_ros.learning.maddpg import Maddpg, UpdateResult
from vpsci_ros.learning.replay import Batch, History, ReplayBuffer
from vpsci_ros.learning.rewards import Rewards
from vpsci_ros.learning.training_config import ClosedLoopConfig, PretrainConfig, RefineConfig
from vpsci_ros.runs.plugins import PluginGroup


class Training(NamedTuple):
    """The networks, critics and data of a training, as an objective gets them.

    :ivar maddpg: networks, critics and their optimisers.
    :ivar rewards: the rewards of the stage, which choose and score the actions of a batch.
    :ivar real: the near misses to learn from.
    :ivar buffer: simulated histories; None in stage 1.
    """

    maddpg: Maddpg
    rewards: Rewards
    real: Interactions
    buffer: ReplayBuffer | None = None

    def update_critics(self, batch: Batch, rng: np.random.Generator) -> UpdateResult:
        """Update critics and targets once with the actors' present actions; the actors do not change."""
        actions = self.maddpg.act(batch, gradient=False)
        scored = self.rewards.score(batch, actions, rng)
        return replace(self.maddpg.update(batch, scored, None, rng), actions=actions)


class Stateful(Protocol):
    """What a checkpoint keeps of an objective: an optimiser, or anything else with these methods of it."""

    def state_dict(self) -> dict[str, Any]:
        """Return the state."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a state."""


class StageObjective(Protocol):
    """Interface of an objective in one stage."""

    @property
    def optimisers(self) -> Sequence[Stateful]:
        """The objective's own optimisers and other state, for checkpoints."""

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


class Imitation:
    """Stage 1: the actors imitate recorded near misses in closed loop; see `StageObjective`."""

    optimisers = ()

    def __init__(self, training: Training, config: ClosedLoopConfig) -> None:
        self._training, self._config = training, config
        self._recorded = Recorded(training.real, config)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once, see `StageObjective.update`."""
        result = self._training.update_critics(batch, rng)
        start, actors = self._recorded.draw(rng), self._training.maddpg.networks.actor
        error = start.error([scene for scene, _ in roll_out(actors, start.start, self._config.imitated_steps)])
        norm = self._training.maddpg.improve(error, slower(iteration))
        return replace(result, more={"closed_loop_error": float(error.detach()), "gradient_norm": norm})


def slower(iteration: int) -> float:
    """Return the share of its step size that an update has."""
    return 1.0 / (1.0 + iteration / 500.0)


class DualWeight:
    """The weight of a constraint, by dual ascent: it grows while a running mean of the error is above the limit."""

    STEP, MEMORY, LEAST = 0.02, 0.05, 0.2

    def __init__(self, config: ClosedLoopConfig) -> None:
        self.value, self.mean = config.weight, config.limit
        self._limit, self._most = config.limit, config.most_weight

    def note(self, error: float) -> None:
        """Take an error [m] into the mean, and change the weight by it."""
        self.mean += self.MEMORY * (error - self.mean)
        factor = 1.0 + self.STEP if self.mean > self._limit else 1.0 - self.STEP
        self.value = min(self._most, max(self.LEAST, self.value * factor))

    def state_dict(self) -> dict[str, float]:
        """Return the state, for checkpoints."""
        return {"value": self.value, "mean": self.mean}

    def load_state_dict(self, state: dict[str, float]) -> None:
        """Go on from a state."""
        self.value, self.mean = state["value"], state["mean"]


class Constrained:
    """Stage 2: the actors follow what is wrong with simulated roll-outs, and stay like people; see `StageObjective`.

    Starts are steps of the buffer's simulated histories, half of them hand-overs, more often those that last ended
    near a contact; and recorded steps, whose error is limited by a `DualWeight`.
    """

    HAND_OVERS, RARELY = 0.5, 0.1

    def __init__(self, training: Training, config: ClosedLoopConfig) -> None:
        self._training, self._config = training, config
        self._recorded, self._weight = Recorded(training.real, config), DualWeight(config)
        self.optimisers = (self._weight,)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """Update critics, actors and targets once, see `StageObjective.update`."""
        config, maddpg = self._config, self._training.maddpg
        actions = maddpg.act(batch, gradient=config.policy_gradient > 0)
        scored = self._training.rewards.score(batch, actions, rng)
        histories, start, recorded = *self._draw(rng), self._recorded.draw(rng)
        scenes, done = zip(
            *roll_out(maddpg.networks.actor, start.and_then(recorded.start), config.steps, config.beyond), strict=True
        )
        error = recorded.error([_rows(scene, len(histories), None) for scene in scenes[: config.imitated_steps]])
        own = [{agent: values[: len(histories)] for agent, values in one.items()} for one in done]
        bad = penalties(start, [_rows(scene, 0, len(histories)) for scene in scenes], own, config)
        for history, near in zip(histories, bad.near.tolist(), strict=True):
            history.near = 0.5 * (history.near + near)
        prices = config.contact, config.lane, config.late, config.effort
        loss = self._weight.value * error
        for price, part in zip(prices, bad, strict=True):
            loss = loss + price * part.mean()
        result = maddpg.update(
            batch, scored, actions, rng, besides=loss, weight=config.policy_gradient, rate=slower(iteration)
        )
        self._weight.note(float(error.detach()))
        means = {f"closed_loop_{name}": float(part.detach().mean()) for name, part in bad._asdict().items()}
        means |= {"closed_loop_weight": self._weight.value, "closed_loop_error": self._weight.mean}
        return replace(result, actions=actions, more=means)

    def _draw(self, rng: np.random.Generator) -> tuple[list[History], Start]:
        """Return simulated histories, equally many of each kind of scenes, and a step of each as a start."""
        assert self._training.buffer is not None
        kinds: dict[bytes, list[History]] = {}
        for history in self._training.buffer.simulated:
            kinds.setdefault(history.rules.tobytes(), []).append(history)
        histories, steps = [], []
        for _, known in sorted(kinds.items()):
            chance = np.array([history.near + self.RARELY for history in known])
            for i in rng.choice(len(known), size=self._config.simulated // len(kinds), p=chance / chance.sum()):
                first = rng.random() < self.HAND_OVERS
                histories.append(known[i])
                steps.append(0 if first else int(rng.integers(len(known[i]))))
        return histories, simulated_start(histories, steps)


def _rows(scene: Scene, begin: int, end: int | None) -> Scene:
    """Return some of the scenes."""
    return Scene(*(part[begin:end] for part in scene))


DDPG = Objective(pretrain=_by_critics, refine=_by_critics)
CLOSED_LOOP = Objective(
    pretrain=lambda training, config: Imitation(training, config.closed_loop),
    refine=lambda training, config: Constrained(training, config.closed_loop),
)

_ALL = PluginGroup("vpsci_ros.objectives", "objective", Objective, {"ddpg": DDPG, "closed_loop": CLOSED_LOOP})


def find_objective(name: str) -> Objective:
    """Return the objective of this name.

    :raises InvalidInput: no objective has this name, or the package that adds it is broken.
    """
    return _ALL.find(name)
