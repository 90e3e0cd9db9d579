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

from vpsci_ros.evaluation.scene import observe, time_to_collision
from vpsci_ros.learning.config import ForesightConfig
from vpsci_ros.learning.foresight import Moments, advance_on_lane, bounded, remembered, set_out
from vpsci_ros.learning.networks import Actors
from vpsci_ros.learning.rewards import collision_loss, pedestrian_pace_loss, vehicle_pace_loss
from vpsci_ros.policy.actor import Distribution
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS

GAIN = 1.0  # `pedestrian_gain` of the world: a recorded person's acceleration is the motion's, not twice that (21)
TOLERANCE = 0.3  # [m/s2] added to the scale of stage 1's noise: whoever does nothing at all may still do something else
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


def foresee_people(actors: Actors, stage_1: Actors, start: Moments, config: ForesightConfig) -> Losses:
    """Let persons drawn from torch's global generator act for `config.steps` steps from each moment."""
    count = len(start.speed)
    memory, reference = remembered(actors, start), remembered(stage_1, start)
    before, now = start.before, set_out(start)
    latent = {agent: torch.randn(count, actors[agent].latent) for agent in AGENTS}
    noise = {agent: torch.randn(count, ACTION_SIZE) for agent in AGENTS}
    losses = Losses(*(torch.zeros(()) for _ in Losses._fields))
    for step in range(config.steps):
        scene, speed = now.scene, now.speed
        views, curvttc = dict(zip(AGENTS, observe(scene), strict=True)), time_to_collision(scene).float()
        departure, done = torch.zeros(()), {}
        for agent in AGENTS:
            actor, seen, did = actors[agent], views[agent], before[agent]
            will = actor.distribution(seen, did, curvttc, memory[agent], latent[agent])
            with torch.no_grad():
                was = stage_1[agent].distribution(seen, did, curvttc, reference[agent], latent[agent])
            departure = departure + divergence(will, was).mean()
            if step:
                noise[agent] = actor.next_noise(noise[agent], torch.randn(count, ACTION_SIZE))
            action = (will.mean + will.scale * actor.burst(noise[agent])).clamp(-actor.limit, actor.limit)
            if action.requires_grad:
                action.register_hook(bounded)
            done[agent] = action
        before = done
        lateral = speed * speed * scene.curvature.abs()
        beyond = (done["vehicle"][:, 0] - SPEEDING_UP).clamp(min=0.0) ** 2 + (lateral - CORNERING).clamp(min=0.0) ** 2
        pace = config.pace_weights[0] * vehicle_pace_loss(speed, start.cruise, config.speeding_weight).mean()
        walk = pedestrian_pace_loss(scene.pedestrian_velocity, start.course, config.speeding_weight).mean()
        now = advance_on_lane(now, start.lane, done["vehicle"], done["pedestrian"], GAIN)
        near = collision_loss(now.scene, now.speed, config.clearance_margin, config.clearance_ahead).mean()
        now_lost = near, pace + config.pace_weights[1] * walk, departure + beyond.mean()
        losses = Losses(*(a + b / config.steps for a, b in zip(losses, now_lost, strict=True)))
        if not bool(losses.collision.isfinite()):
            break  # for the check of losses to find, before CurvTTC is asked of it
    return losses


def divergence(will: Distribution, was: Distribution) -> Tensor:
    """Return the Kullback-Leibler divergence of `will` from `was`, float32[B], as if both were normal.

    The scales of both have `TOLERANCE` added, since a person who stands quite still has a scale near zero, and any
    other behaviour would then be infinitely far away.
    """
    scale, other = (torch.sqrt(part.scale**2 + TOLERANCE**2) for part in (will, was))
    ratio = (scale / other) ** 2
    return (0.5 * (((will.mean - was.mean) / other) ** 2 + ratio - 1.0 - torch.log(ratio))).sum(dim=1)
