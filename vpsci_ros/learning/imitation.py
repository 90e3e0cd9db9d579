"""The closed-loop objective: actors learn to follow recorded trajectories through the known, differentiable kinematics.

An update rolls both actors out together, from some step of a recorded near miss on and after some observed steps, on
their own predictions (`rollout`), and follows the gradient of the distance to the recorded positions through the whole
roll-out and through both actors: each learns to act in the situations that the two of them bring about. A roll-out sets
out with the vehicle's velocity by its observed positions (`tracked_steps`): published speeds lag, and actors that had
to make up for that learned little else. The same histories, with every step as recorded, add the error of the next
velocity, which is what the reconstruction measures.

A few hundred near misses hold some fifty drivers, so the actors soon overfit. Dropout in front of
both layers of the head, weight decay and the running average of the weights delay that, and the number of iterations
ends it. Augmentation: a near miss is seen in a mirror half of the time; the place where the history begins and the
number of observed steps vary. Rotation needs none, since observations live in the vehicle's heading frame.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.kinematics.rollout import ActorPair, roll_out
from vpsci_ros.kinematics.scene import scene_at
from vpsci_ros.learning.config import ImitationConfig, PretrainConfig
from vpsci_ros.learning.descent import WEIGHT_DECAY, Descent
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Training
from vpsci_ros.policy.actor import before_step, previous
from vpsci_ros.policy.sst import StepState
from vpsci_ros.world.observation import AGENTS, STEP

OBSERVED = 10  # steps observed before a roll-out, at most
HEAD_FACTOR = 10.0  # the heads take larger steps by this; they begin near zero
VELOCITY_WEIGHT = 10.0  # [s] of the next velocity's error against the positions': both are then about as large
_SMOOTH = 0.02  # [m] below this, distances count by their square


class Start(NamedTuple):
    """Where roll-outs begin, and how they are altered."""

    row: NDArray[np.int64]  # [M] the interaction
    begin: NDArray[np.int64]  # [M] the first step of the history
    at: NDArray[np.int64]  # [M] the first predicted step
    mirror: NDArray[np.bool_]  # [M]

    def take(self, rows: NDArray[np.int64]) -> "Start":
        """Return the roll-outs `rows`, in that order."""
        return Start(row=self.row[rows], begin=self.begin[rows], at=self.at[rows], mirror=self.mirror[rows])


@dataclass(frozen=True)
class RecordedSteps:
    """Recorded steps of M roll-outs as tensors, `begin` first, mirrored by `Start.mirror`; past the end zero."""

    motion: Tensor  # [M, T, 9] rows as in `Interactions.motion`
    curvttc: Tensor  # [M, T] [s]
    present: Tensor  # bool[M, T]
    observation: dict[str, Tensor]  # agent -> [M, T, 6], (6) and (7)
    action: dict[str, Tensor]  # agent -> [M, T, 2] [m/s2]


def draw(interactions: Interactions, config: ImitationConfig, rng: np.random.Generator) -> Start:
    """Draw `config.rollouts` roll-outs: interactions evenly, then the first predicted step, then the observed steps."""
    row = rng.integers(len(interactions), size=config.rollouts)
    at = (rng.random(config.rollouts) * (interactions.length[row] - 1)).astype(np.int64)
    observed = np.where(rng.random(config.rollouts) < 0.5, OBSERVED, rng.integers(OBSERVED + 1, size=config.rollouts))
    mirror = (rng.random(config.rollouts) < 0.5) & config.mirror
    return Start(row=row, begin=np.maximum(at - observed, 0), at=at, mirror=mirror)


def recorded(interactions: Interactions, start: Start, steps: int) -> RecordedSteps:
    """Cut out `steps` steps of each roll-out, float32."""
    index = start.begin[:, None] + np.arange(steps)
    present = index < interactions.length[start.row, None]
    index = np.minimum(index, interactions.motion.shape[1] - 1)
    rows = start.row[:, None]
    motion = interactions.motion[rows, index].copy()
    motion -= _origin(motion)  # near the origin float32 resolves positions to less than a micrometre
    motion[start.mirror] *= _MIRROR_MOTION
    sign = np.where(start.mirror, -1.0, 1.0).astype(np.float32)[:, None, None]

    def mirrored(values: NDArray[np.float32]) -> Tensor:
        values = values.copy()
        values[..., 1::2] *= sign
        return torch.from_numpy(values)

    return RecordedSteps(
        motion=torch.from_numpy(motion.astype(np.float32)),
        curvttc=torch.from_numpy(interactions.curvttc[rows, index]),
        present=torch.from_numpy(present),
        observation={agent: mirrored(interactions.observation[agent][rows, index]) for agent in AGENTS},
        action={agent: mirrored(interactions.action[agent][rows, index]) for agent in AGENTS},
    )


_MIRROR_MOTION = np.array([1, -1, -1, 1, -1, 1, -1, 1, -1], np.float64)


def _origin(motion: NDArray[np.float64]) -> NDArray[np.float64]:
    origin = np.zeros_like(motion[:, :1])
    origin[..., [0, 5]], origin[..., [1, 6]] = motion[:, :1, [0]], motion[:, :1, [1]]
    return origin


def rollout_loss(
    networks: Networks, interactions: Interactions, start: Start, config: ImitationConfig
) -> tuple[Tensor, Tensor]:
    """Return the closed-loop error [m] and the error of the next velocity [m/s], both scalar with gradient.

    The first is the mean distance of predicted from recorded positions over both agents and all steps; the second the
    mean absolute error of each component of the velocities predicted from recorded histories.
    """
    steps = np.minimum(interactions.length[start.row] - 1 - start.at, config.rollout_steps)
    longest_first = np.argsort(-steps, kind="stable")
    start, steps = start.take(longest_first), steps[longest_first]
    lead = start.at - start.begin
    data = recorded(interactions, start, OBSERVED + config.rollout_steps + 1)
    velocity_error, histories = _observed(networks, data, lead)
    rows = np.arange(len(lead))
    begin = scene_at(data.motion, torch.from_numpy(lead), networks.config.tracked_steps)
    before = {agent: before_step(data.action[agent], torch.from_numpy(lead)) for agent in AGENTS}
    share = torch.from_numpy((0.5 / np.maximum(steps, 1) / len(steps)).astype(np.float32))
    moving = [int((steps > step).sum()) for step in range(int(steps[0]))]  # those that have ended lie at the end
    position_error = torch.zeros(())
    for step, scene in enumerate(roll_out(begin, ActorPair(networks.actor, histories, before), moving)):
        truth = data.motion[rows[: moving[step]], lead[: moving[step]] + step + 1]
        for position, columns in ((scene.vehicle, slice(0, 2)), (scene.pedestrian, slice(5, 7))):
            squared = ((position - truth[:, columns]) ** 2).sum(dim=1)
            distance = torch.sqrt(squared + _SMOOTH**2) - _SMOOTH
            position_error = position_error + (distance * share[: moving[step]]).sum()
    return position_error, velocity_error


def _observed(
    networks: Networks, data: RecordedSteps, lead: NDArray[np.int64]
) -> tuple[Tensor, dict[str, list[StepState]]]:
    """Return the error of the next velocity over recorded histories, and each actor's memory of the observed steps."""
    acted = torch.zeros_like(data.present)
    acted[:, :-1] = data.present[:, 1:]
    error, histories = torch.zeros(()), {}
    for agent in AGENTS:
        done = data.action[agent]
        predicted, histories[agent] = networks.actor[agent].remember(
            data.observation[agent], previous(done), data.curvttc, torch.from_numpy(lead)
        )
        error = error + ((predicted - done).abs().sum(dim=2) * acted).sum() * (STEP / 4.0) / acted.sum()
    return error, histories


class TrajectoryImitation:
    """Both actors, their optimiser, and the near misses that they learn from."""

    def __init__(self, networks: Networks, interactions: Interactions, config: PretrainConfig) -> None:
        self._networks, self._interactions, self._config = networks, interactions, config.imitation
        groups = []
        for part, factor in (("encoder", 1.0), ("head", HEAD_FACTOR)):
            mine = [p for agent in AGENTS for p in getattr(networks.actor[agent], part).parameters()]
            for matrices, decay in ((True, WEIGHT_DECAY / factor), (False, 0.0)):
                parameters = [p for p in mine if (p.ndim == 2) == matrices]
                groups.append({"params": parameters, "weight_decay": decay, "factor": factor})
        self._descent = Descent(networks.actor, groups, config)
        self.optimiser = self._descent.optimiser

    def update(self, rng: np.random.Generator, iteration: int) -> dict[str, float]:
        """Take one step, and return the losses by name."""
        start = draw(self._interactions, self._config, rng)
        torch.manual_seed(int(rng.integers(2**62)))  # of the dropout
        with self._networks.actor.dropping_out(self._config.dropout):
            position, velocity = rollout_loss(self._networks, self._interactions, start, self._config)
        norm = self._descent.step(position + VELOCITY_WEIGHT * velocity, iteration)
        return {
            "rollout_error": float(position.detach()),
            "velocity_error": float(velocity.detach()),
            "imitation_gradient_norm": norm,
        }


class Rehearsal:
    """A few real near misses rolled out again in stage 2, as stage 1 minimised their error."""

    def __init__(self, training: Training, rollouts: int) -> None:
        self._networks, self._interactions = training.maddpg.networks, training.real
        self._config = replace(training.stage_1.imitation, rollouts=rollouts)

    def loss(self, rng: np.random.Generator) -> Tensor:
        """Return the closed-loop error of some of them, a scalar with gradient."""
        start = draw(self._interactions, self._config, rng)
        position, velocity = rollout_loss(self._networks, self._interactions, start, self._config)
        return position + VELOCITY_WEIGHT * velocity
