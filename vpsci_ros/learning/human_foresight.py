"""Stage 2 for stochastic actors: no collision and on to the goal, without leaving what stage 1 learned of people.

Moments of simulated experience are rolled out through the known kinematics with other latent numbers and noise, and
three losses are followed through them: the smooth stand-ins of (25) and (26), see `rewards`, and the departure from
people. The last is the divergence of each action's distribution from that of the frozen stage-1 actor at the same step,
for the same person and after the same history, as in 'Human-compatible driving partners through data-regularized
self-play reinforcement learning' by Cornelisse and Vinitsky 2024 (https://arxiv.org/abs/2403.19648), and what a driver
does beyond the limits below. Who gives way varies with the persons, so nobody need be scripted to insist.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from vpsci_ros.kinematics.lane import OnLane
from vpsci_ros.kinematics.rollout import Actions, ActorPair, Draws, Seen, roll_out
from vpsci_ros.kinematics.scene import Scene
from vpsci_ros.learning.config import ForesightConfig
from vpsci_ros.learning.foresight import CLEARANCE_MARGIN, PACE_WEIGHTS, Moments, bounded, remembered
from vpsci_ros.learning.residuals import Borrowing
from vpsci_ros.learning.rewards import collision_loss, pedestrian_pace_loss, vehicle_pace_loss
from vpsci_ros.policy.actor import Actors, Distribution
from vpsci_ros.policy.residuals import Residuals
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS

GAIN = 1.0  # `pedestrian_gain` of the world: a recorded person's acceleration is the motion's, not twice that (21)
TOLERANCE = 0.3  # [m/s2] added to the scale of stage 1's noise: an agent that does nothing may still do something else
SPEEDING_UP = 1.5  # [m/s2] above it people do not accelerate in a turn
CORNERING = 2.5  # [m/s2] lateral acceleration above which people do not drive through a turn


class Losses(NamedTuple):
    """What both actors lose, scalars with gradient, means of all roll-outs and steps.

    :ivar collision: the smooth stand-in of (25).
    :ivar goal: the smooth stand-in of (26).
    :ivar departure: from people.
    """

    collision: Tensor
    goal: Tensor
    departure: Tensor


def foresee_people(
    actors: Actors, stage_1: Actors, start: Moments, config: ForesightConfig, residuals: Residuals | None = None
) -> Losses:
    """Let persons drawn from torch's global generator act for `config.steps` steps from each moment.

    :param residuals: that actors without latent numbers borrow.
    """
    count, steps = len(start.speed), config.steps
    latent = {agent: torch.randn(count, actors[agent].latent) for agent in AGENTS}
    draws = Draws(latent, {agent: torch.randn(count, ACTION_SIZE) for agent in AGENTS})
    lane = OnLane(start.lane, start.speed, start.pedestrian, start.walking, GAIN)
    borrowing = None if residuals is None else Borrowing(residuals, count, start.before["vehicle"][:, 0])
    pair = ActorPair(actors, remembered(actors, start), start.before, draws, residual=borrowing, bound=bounded)
    rolled: list[_RolledStep] = []

    def act(seen: Seen) -> Actions:
        before, speed, actions = pair.before, lane.speed, pair(seen)
        rolled.append(_RolledStep(seen, speed, before, actions, pair.distribution))
        pair.distribution = {}
        return actions

    reached = [(scene, lane.speed) for scene in roll_out(lane.start, act, [count] * steps, lane.advance)]
    # One call for all steps rather than one a step: what they cost is mostly the number of calls.
    scene = _all([scene for scene, _ in reached])
    near = collision_loss(scene, torch.cat([speed for _, speed in reached]), CLEARANCE_MARGIN, config.clearance_ahead)
    scene, speed = _all([each.seen.scene for each in rolled]), torch.cat([each.speed for each in rolled])
    pace = vehicle_pace_loss(speed, start.cruise.repeat(len(rolled))).mean()
    walk = pedestrian_pace_loss(scene.pedestrian_velocity, start.course.repeat(len(rolled), 1)).mean()
    faster = torch.cat([each.actions["vehicle"][:, 0] for each in rolled]) - SPEEDING_UP
    sharper = speed * speed * scene.curvature.abs() - CORNERING
    departure = (faster.clamp(min=0.0) ** 2 + sharper.clamp(min=0.0) ** 2).mean()
    for agent in AGENTS:
        will = Distribution(*(torch.stack(part, dim=1) for part in zip(*(m.will[agent] for m in rolled), strict=True)))
        departure = departure + divergence(will, _reference(stage_1, agent, start, rolled, latent[agent])).mean()
    return Losses(near.mean(), PACE_WEIGHTS[0] * pace + PACE_WEIGHTS[1] * walk, departure)


class _RolledStep(NamedTuple):
    """A step of a roll-out of B scenes."""

    seen: Seen
    speed: Tensor  # [B] [m/s] of the vehicle
    before: Actions
    actions: Actions
    will: dict[str, Distribution]


def _all(scenes: list[Scene]) -> Scene:
    """Return the scenes of all steps, one after the other."""
    return Scene(*map(torch.cat, zip(*scenes, strict=True)))


@torch.no_grad()
def _reference(stage_1: Actors, agent: str, start: Moments, rolled: list[_RolledStep], latent: Tensor) -> Distribution:
    """Return what the actor of stage 1 would have done at each step, float32[B, T, 2]."""
    place = start.taken[:, None] + torch.arange(len(rolled))
    index = torch.arange(len(latent))[:, None], place

    def whole(known: Tensor, steps: list[Tensor]) -> Tensor:
        """Return [B, ...] of histories that go on after `start.taken` steps, each row at its own place."""
        following = torch.stack(steps, dim=1).to(known.dtype)
        out = torch.cat([known, torch.zeros_like(following)], dim=1)
        out[index] = following
        return out

    was = stage_1[agent].distributions(
        whole(start.observation[agent], [each.seen.observation[agent] for each in rolled]),
        whole(start.acted[agent], [each.before[agent] for each in rolled]),
        whole(start.curvttc, [each.seen.curvttc for each in rolled]),
        latent,
    )
    return Distribution(*(part[index] for part in was))


def divergence(will: Distribution, was: Distribution) -> Tensor:
    """Return the Kullback-Leibler divergence of `will` from `was`, float32[...], as if both were normal.

    The scales of both have `TOLERANCE` added, since a person who stands quite still has a scale near zero, and any
    other behaviour would then be infinitely far away.
    """
    scale, other = (torch.sqrt(part.scale**2 + TOLERANCE**2) for part in (will, was))
    ratio = (scale / other) ** 2
    return (0.5 * (((will.mean - was.mean) / other) ** 2 + ratio - 1.0 - torch.log(ratio))).sum(dim=-1)
