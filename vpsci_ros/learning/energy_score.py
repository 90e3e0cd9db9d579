"""The objective of stochastic actors: stage 1 learns what people do and not its mean, stage 2 stays near it.

From a moment of a recorded near miss both actors run on together through the known kinematics (`rollout`), several
times with other latent numbers and noise. The gradient of their energy score against what happened is followed through
all of it: of positions at every step and of velocities, and the texture of their accelerations (`likeness`). A
deterministic actor that minimised a distance instead would learn the mean of what people do, which nobody does.
"""

import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.errors import InvalidInput
from vpsci_ros.kinematics.rollout import ActorPair, Draws, roll_out
from vpsci_ros.kinematics.scene import Scene, scene_at
from vpsci_ros.learning import foresight
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.descent import WEIGHT_DECAY, Descent
from vpsci_ros.learning.foresight import step_along
from vpsci_ros.learning.human_foresight import GAIN, foresee_people
from vpsci_ros.learning.imitation import OBSERVED, RecordedSteps, Start, recorded
from vpsci_ros.learning.likeness import (
    REACH,
    direction,
    energy_score,
    smoothed,
    texture_distance,
    velocities,
    with_residual,
)
from vpsci_ros.learning.maddpg import UpdateResult
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Objective, Training
from vpsci_ros.learning.replay import Batch
from vpsci_ros.learning.residuals import Adding, Donors
from vpsci_ros.policy.actor import Actors, before_step, previous
from vpsci_ros.policy.residuals import residuals_of
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, STEP

AT_ONSET = 0.5  # share of roll-outs that begin within two steps of the first critical one, as they are measured
OTHERS = 200  # recorded moments beside the rolled-out ones, to compare textures with and to borrow residuals from
VELOCITY_SHARE = 0.5  # [s] weight of the velocities' score against the positions'
TEXTURE_WEIGHT = 1.0  # of the distance of the accelerations' texture to people's against the score
REHEARSED_STEPS = 30  # of the near misses rolled out again in stage 2
NOISE_FACTOR = 10.0  # steps of the few numbers of the noise are larger by this
_COLUMNS = {"vehicle": (slice(0, 2), slice(3, 5)), "pedestrian": (slice(5, 7), slice(7, 9))}


class Sampled(NamedTuple):
    """Roll-outs beside what happened, each moment's own step first.

    :ivar motion: float32[M, K, T + 1, 9], rows as in `Interactions.motion`.
    :ivar happened: float32[M, T + 1, 9].
    """

    motion: Tensor
    happened: Tensor


def draw_moments(interactions: Interactions, count: int, steps: int, mirror: bool, rng: np.random.Generator) -> Start:
    """Draw moments with `steps` recorded steps after them, half of them near the onset, after up to ten observed steps.

    :raises InvalidInput: no interaction is so long.
    """
    long = np.flatnonzero(interactions.length > steps)
    if long.size == 0:
        raise InvalidInput(
            f"near misses: expected an interaction of more than {steps} steps for roll-outs of {steps}, got none among "
            f"{len(interactions)}; set learner.imitation.rollout_steps lower, or import whole tracks"
        )
    row = rng.choice(long, count)
    latest = interactions.length[row] - 1 - steps
    near = np.clip(interactions.first[row] + rng.integers(-2, 3, count), 0, latest)
    at = np.where(rng.random(count) < AT_ONSET, near, (rng.random(count) * (latest + 1)).astype(np.int64))
    return Start(row, np.maximum(at - OBSERVED, 0), at, (rng.random(count) < 0.5) & mirror)


def sample(
    actors: Actors,
    data: RecordedSteps,
    lead: NDArray[np.int64],
    samples: int,
    steps: int,
    tracked: int,
    residuals: Tensor | None = None,
) -> Sampled:
    """Roll each moment out `samples` times, with latent numbers and noise from torch's global generator.

    :param data: as `recorded` cuts it out, with `steps` + 1 steps from the moment on.
    :param lead: int64[M], steps observed before each moment.
    :param residuals: as `Donors.borrowed` returns them, of actors without latent numbers.
    """
    rows, taken = np.arange(len(lead)), torch.from_numpy(lead)
    scene = Scene(*(part.repeat_interleave(samples, dim=0) for part in scene_at(data.motion, taken, tracked)))
    memory, before, draws = {}, {}, Draws({}, {})
    for agent in AGENTS:
        done = data.action[agent]
        _, states = actors[agent].remember(data.observation[agent], previous(done), data.curvttc, taken)
        memory[agent] = [state.repeated(samples) for state in states]
        before[agent] = before_step(done, taken).repeat_interleave(samples, dim=0)
        draws.latent[agent] = torch.randn(len(lead) * samples, actors[agent].latent)
        draws.noise[agent] = torch.randn(len(lead) * samples, ACTION_SIZE)
    moving, added = [len(lead) * samples] * steps, None if residuals is None else Adding(residuals)
    pair = ActorPair(actors, memory, before, draws, residual=added)
    out = [scene.rows(), *(now.rows() for now in roll_out(scene, pair, moving))]
    out += out[-1:] * (steps + 1 - len(out))  # NaN, for the check of losses to find
    at = lead[:, None] + np.arange(steps + 1)
    return Sampled(torch.stack(out, dim=1).unflatten(0, (-1, samples)), data.motion[rows[:, None], at])


def likeness_loss(sampled: Sampled, others_motion: Tensor) -> dict[str, Tensor]:
    """Return energy score of positions [m] and velocities [m/s] and texture distance, means of both agents, by name.

    :param others_motion: float32[n, T + 1, 9], recorded motion of other moments.
    """
    count, samples = sampled.motion.shape[:2]
    other = others_motion[torch.randint(len(others_motion), (count * samples,))]
    parts = {"position_score": torch.zeros(()), "velocity_score": torch.zeros(()), "texture": torch.zeros(())}
    for place, speed in _COLUMNS.values():
        track, happened = sampled.motion[..., place], sampled.happened[..., place]
        parts["position_score"] = parts["position_score"] + 0.5 * energy_score(track[:, :, 1:], happened[:, 1:])
        start = sampled.motion[:, :, 0].flatten(0, 1)
        ways = direction(start[:, speed], start[:, 2]), direction(other[:, 0, speed], other[:, 0, 2])
        borrowed = smoothed(with_residual(track.flatten(0, 1), ways[0], other[..., place], ways[1]))
        velocity = velocities(borrowed).unflatten(0, (count, samples))
        known = smoothed(happened)
        parts["velocity_score"] = parts["velocity_score"] + 0.5 * energy_score(velocity, velocities(known))
        recordings = torch.cat([known, smoothed(others_motion[..., place])])
        parts["texture"] = parts["texture"] + 0.5 * texture_distance(borrowed, recordings)
    return parts


def score_loss(sampled: Sampled) -> dict[str, Tensor]:
    """Return `likeness_loss` but for the texture, which is people's own where their residuals act."""
    parts = {"position_score": torch.zeros(()), "velocity_score": torch.zeros(())}
    for place, _ in _COLUMNS.values():
        track, happened = sampled.motion[..., place], sampled.happened[..., place]
        parts["position_score"] = parts["position_score"] + 0.5 * energy_score(track[:, :, 1:], happened[:, 1:])
        score = energy_score(velocities(smoothed(track)), velocities(smoothed(happened)))
        parts["velocity_score"] = parts["velocity_score"] + 0.5 * score
    return parts


class Likeness:
    """What is left of the distance to people, of a few moments, drawn again each time.

    :param donor: actors beside whose mean residuals are what people did; None: those that learn.
    """

    def __init__(
        self, networks: Networks, interactions: Interactions, config: PretrainConfig, donor: Actors | None = None
    ) -> None:
        if networks.config.latent == 0 and not networks.config.residuals:
            raise InvalidInput(
                "network.latent = 0: the objective energy_score learns a distribution; expected residuals, or 1 latent "
                "number or more, e.g. --set learner.residuals=true or --set learner.latent=8"
            )
        if (steps := config.imitation.rollout_steps) < REACH:
            raise InvalidInput(
                f"learner.imitation.rollout_steps = {steps}: the objective energy_score expects {REACH} or more, "
                "since it averages positions over so many"
            )
        self._networks, self._interactions, self._config, self._donor = networks, interactions, config, donor
        self.donors = Donors(interactions, steps, donor) if networks.config.residuals else None

    def loss(self, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
        """Return a scalar with gradient, and its parts by name."""
        config, steps = self._config.imitation, self._config.imitation.rollout_steps
        torch.manual_seed(int(rng.integers(2**62)))
        start = draw_moments(self._interactions, config.rollouts, steps, config.mirror, rng)
        lead = start.at - start.begin
        data = recorded(self._interactions, start, OBSERVED + steps + 1)
        tracked, samples = self._networks.config.tracked_steps, self._config.energy_score.samples
        known = self._networks.actor, data, lead, samples, steps, tracked
        if self.donors is not None:
            residuals = self.donors.borrowed(self._donor or self._networks.actor, start, samples, rng)
            parts = score_loss(sample(*known, residuals))
            total = parts["position_score"] + VELOCITY_SHARE * parts["velocity_score"]
            return total, {name: float(part.detach()) for name, part in parts.items()}
        others = draw_moments(self._interactions, OTHERS, steps, config.mirror, rng)
        others = Start(others.row, others.at, others.at, others.mirror)
        parts = likeness_loss(sample(*known), recorded(self._interactions, others, steps + 1).motion)
        total = parts["position_score"] + VELOCITY_SHARE * parts["velocity_score"]
        total = total + TEXTURE_WEIGHT * parts["texture"]
        return total, {name: float(part.detach()) for name, part in parts.items()}


class Scoring:
    """See `StageObjective`: the actors learn what people do."""

    def __init__(self, training: Training, config: PretrainConfig) -> None:
        self._training, self._config = training, config
        self._actors = training.maddpg.networks.actor
        self._likeness = Likeness(training.maddpg.networks, training.real, config)
        if self._likeness.donors is not None:
            training.maddpg.networks.residuals = self._likeness.donors.tensors
        self._descent = Descent(self._actors, _groups(self._actors), config)
        self.optimisers = (self._descent.optimiser,)

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `StageObjective.update`."""
        with self._actors.dropping_out(self._config.imitation.dropout):
            loss, losses = self._likeness.loss(rng)
        losses["likeness_gradient_norm"] = self._descent.step(loss, iteration)
        return replace(self._training.update_critics(batch, rng), more=losses)


class Regularised:
    """See `StageObjective`: the actors learn not to collide and to reach their goals, and stay near what people do."""

    optimisers = ()

    def __init__(self, training: Training, config: RefineConfig) -> None:
        self._training, self._config = training, config
        networks = training.maddpg.networks
        imitation = replace(
            training.stage_1.imitation, rollouts=config.rehearsal.rollouts, rollout_steps=REHEARSED_STEPS
        )
        self._stage_1 = copy.deepcopy(networks.actor).requires_grad_(False)
        stage_1 = replace(training.stage_1, imitation=imitation)
        self._likeness = Likeness(networks, training.real, stage_1, donor=self._stage_1)
        tensors = networks.residuals(self._stage_1)
        self._residuals = residuals_of(tensors, "weights") if networks.config.residuals else None

    def update(self, batch: Batch, iteration: int, rng: np.random.Generator) -> UpdateResult:
        """See `StageObjective.update`."""
        return replace(self._training.update_critics(batch, rng), more=self._look_ahead(rng))

    def _look_ahead(self, rng: np.random.Generator) -> dict[str, float]:
        """Improve the actors by what they lose in the next simulated seconds, and return it by name."""
        config, maddpg, simulated = self._config, self._training.maddpg, self._training.simulated()
        if not simulated:
            return {}
        torch.manual_seed(int(rng.integers(2**62)))
        histories, at = foresight.draw_moments(
            simulated, config.foresight.rollouts, config.foresight.hand_over_share, rng
        )
        actors = maddpg.networks.actor
        moments = foresight.moments_at(histories, at)
        lost = foresee_people(actors, self._stage_1, moments, config.foresight, self._residuals)
        weights = self._training.weights() * config.foresight.scale
        total = sum((float(w) * part for w, part in zip(weights, lost, strict=True)), torch.zeros(()))
        weight, clip = config.rehearsal.weight, config.updates.gradient_clip
        norm, likeness = step_along(
            maddpg.actor_optimiser, actors, total, lambda: self._likeness.loss(rng)[0], weight, clip
        )
        parts = {f"lost_{name}": float(part.detach()) for name, part in lost._asdict().items()}
        return parts | {"likeness": likeness, "gradient_norm": norm}


OBJECTIVE = Objective(
    pretrain=Scoring,
    refine=Regularised,
    acting="target_actor",
    whole_tracks=True,
    known_world={"pedestrian_gain": GAIN, "lane_following": True, "policy_period": STEP},
)


def _groups(actors: Actors) -> list[dict[str, object]]:
    """Return the optimiser's groups: matrices decay, the numbers of the noise take larger steps."""
    named = [(name, p) for agent in AGENTS for name, p in actors[agent].named_parameters()]
    noise = [p for name, p in named if name in ("persistence_logit", "stillness")]
    rest = [p for name, p in named if name not in ("persistence_logit", "stillness")]
    return [
        {"params": [p for p in rest if p.ndim == 2], "weight_decay": WEIGHT_DECAY, "factor": 1.0},
        {"params": [p for p in rest if p.ndim != 2], "weight_decay": 0.0, "factor": 1.0},
        {"params": noise, "weight_decay": 0.0, "factor": NOISE_FACTOR},
    ]
