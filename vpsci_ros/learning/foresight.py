"""Stage 2 through the known kinematics: the rewards of (25)-(27) made smooth, and followed through simulated seconds.

The learner knows how both agents move, (8)-(13) and (18)-(24), so it need not learn from a critic what an action leads
to. It takes moments out of its simulated experience, lets both actors act from there on in a differentiable copy of
the world, and follows the gradient of what they lose through the motion of the next seconds, as stochastic value
gradients with a known model do (Heess et al. 2015, 'Learning continuous control policies by stochastic value
gradients', https://arxiv.org/abs/1510.09142): also through what the agents then observe of each other and how they
react.

Events have no gradient, so each gets a smooth stand-in:

- collision (25): how far the clearance of the footprints falls short of a margin, squared, now and, by a weight, where
  both would be within the next `AHEAD` seconds at the speeds and the curvature of the moment. The second is
  CurvTTC made smooth: who only minds clearance passes a hand's breadth from the other, and people do not;
- goal (26): how far each agent's velocity is from that of the hand-over, as a share of it, squared; a vehicle's is
  `CRUISE` along its lane at least. For a pedestrian sideways counts as well: who is free to drift is pushed along by
  the car, metres away from where it wanted to cross. Weights say whose delay costs more; who learns to give way hangs
  on the luck of a training, too. Being faster costs `haste` times as much as being slower: people in a near miss slow
  down, and who may as well speed up learns to race the other to the crossing.

In some of the roll-outs one of the two does not do as its policy says: the vehicle brakes to a stand, and stays, or it
keeps its speed; or the pedestrian walks on. Who learns beside one partner only learns a convention with it, say that
the vehicle always gives way, and has no answer to anybody else; people on the road have, and so should whoever meets a
driving system.

The speed reward has a gradient as it is, and is taken at the recorded steps rather than at the foreseen ones.

The copy is simpler than the world: the vehicle keeps to its lane whatever its lateral action, which in the world
moves it within the lane; so the lateral action learns from the speed reward and from rehearsal only. What transitions
do not tell is taken for granted: the paper's 0.5 of (21)-(24), lane following, and steps of 0.1 s. A world that
differs is refused and needs `online_objective: ddpg`.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.learning.actor import previous
from vpsci_ros.learning.config import AGENTS, STEP
from vpsci_ros.learning.networks import Actors
from vpsci_ros.learning.replay import History, collate
from vpsci_ros.learning.scene import Scene, from_heading_frame, observe, time_to_collision, to_heading_frame
from vpsci_ros.learning.sst import StepState
from vpsci_ros.learning.transitions import LANE_GRID
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION

AHEAD = (0.7, 1.4, 2.1)  # [s] from now at which anticipated clearance is taken; a car is as long as it drives between
CRUISE = 3.5  # [m/s] pace that a vehicle which stands or creeps should take up
HAND_OVERS = 0.7  # share of roll-outs that begin there
LONGEST = 20.0  # times the median: the length to which gradients of single roll-outs are shortened
BRAKING = (1.0, 5.0)  # [m/s2] least and greatest deceleration of a vehicle that brakes whatever its policy says
_STANDING = 0.3  # [m/s] below this a pedestrian has no direction

Memories = dict[str, list[StepState]]


class Start(NamedTuple):
    """Moments from which M roll-outs begin, in the vehicle's heading frame of each; float32.

    speed [M] [m/s] and lane [M, N] [rad], direction every 2 m, of the vehicle; pedestrian, walking [M, 2]: position [m]
    and velocity [m/s]; cruise [M]: speed of the vehicle, and course [M, 2]: velocity of the pedestrian at the hand-over
    [m/s]; before [M, 2] by agent: the action of the step before [m/s2]. observation [M, T, 6] and acted [M, T, 2] by
    agent and curvttc [M, T] hold what came before the moment, taken int64[M] steps.
    """

    speed: Tensor
    lane: Tensor
    pedestrian: Tensor
    walking: Tensor
    cruise: Tensor
    course: Tensor
    before: dict[str, Tensor]
    observation: dict[str, Tensor]
    acted: dict[str, Tensor]
    curvttc: Tensor
    taken: Tensor


def start_at(histories: Sequence[History], at: NDArray[np.int64]) -> Start:
    """Return the moments at step `at`, int64[M], of M simulated histories."""
    batch, rows = collate(histories), np.arange(len(histories))
    seen = batch.observation["pedestrian"][rows, at]
    taken = torch.from_numpy(at)
    before = {}
    for agent in AGENTS:
        first = torch.from_numpy((at > 0).astype(np.float32))[:, None]
        before[agent] = batch.action[agent][rows, np.maximum(at - 1, 0)] * first
    longest = max(1, int(at.max()))
    return Start(
        (seen[:, 0] - seen[:, 4]).clamp(min=0.0),  # (7): its own velocity minus the relative one is the vehicle's
        torch.from_numpy(np.stack([h.lane[i] for h, i in zip(histories, at, strict=True)])),
        seen[:, 2:4],
        seen[:, 0:2],
        batch.observation["vehicle"][:, 0, 0].clamp(min=CRUISE),
        from_heading_frame(batch.observation["pedestrian"][:, 0, 0:2], -_turned(histories, at)),
        before,
        {agent: batch.observation[agent][:, :longest] for agent in AGENTS},
        {agent: previous(batch.action[agent])[:, :longest] for agent in AGENTS},
        batch.curvttc[:, :longest],
        taken,
    )


def foresee(
    actors: Actors,
    start: Start,
    *,
    steps: int,
    margin: float,
    anticipation: float,
    pace: Sequence[float],
    gain: float,
    haste: float = 1.0,
    scripted: Mapping[str, Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """Let both actors act together for `steps` steps, and return what they lose by collision and by goal.

    :param margin: clearance [m] below which the first counts.
    :param anticipation: weight of the clearances that the speeds of the moment lead to after `AHEAD`, beside that of
        the moment.
    :param pace: weights of the vehicle's and of the pedestrian's pace.
    :param gain: share of the pedestrian's acceleration that becomes motion, (21)-(24).
    :param haste: what being faster than at the hand-over costs, against being slower by as much.
    :param scripted: by agent, what it does [M, 2] [m/s2] whatever its policy says; NaN: the policy acts.
    :returns: float32 scalars with gradient, means of all roll-outs and steps.
    """
    count = len(start.speed)
    memory, before = remembered(actors, start), start.before
    speed, driven, vehicle = start.speed, torch.zeros(count), torch.zeros(count, 2)
    pedestrian, walking = start.pedestrian, start.walking
    walked = start.course.norm(dim=1)
    moving, walked = walked > _STANDING, walked.clamp(min=_STANDING)
    scripted = scripted or {}
    collision, goal = torch.zeros(()), torch.zeros(())
    heading, bend = _direction(start.lane, driven)
    for _ in range(steps):
        ahead = torch.stack([torch.cos(heading), torch.sin(heading)], dim=1)
        scene = Scene(vehicle, heading, speed[:, None] * ahead, bend, pedestrian, walking)
        views, curvttc = dict(zip(AGENTS, observe(scene), strict=True)), time_to_collision(scene)
        before = {a: actors[a].step(views[a], before[a], curvttc, memory[a]) for a in AGENTS}
        before |= {agent: torch.where(done.isnan(), before[agent], done) for agent, done in scripted.items()}
        for answer in before.values():
            if answer.requires_grad:
                answer.register_hook(_bounded)
        faster = (speed / start.cruise - 1.0).clamp(min=0.0)
        goal = goal + pace[0] * ((1.0 - speed / start.cruise) ** 2 + (haste - 1.0) * faster**2).mean()
        faster = ((walking * start.course).sum(dim=1) / walked**2 - 1.0).clamp(min=0.0)
        astray = (walking - start.course).square().sum(dim=1) / walked**2 + (haste - 1.0) * faster**2
        goal = goal + pace[1] * (astray * moving).mean()
        along = before["vehicle"][:, 0].clamp(-MAX_DECELERATION, MAX_ACCELERATION)
        faster = (speed + along * STEP).clamp(min=0.0)
        way = 0.5 * (speed + faster) * STEP
        pushed = from_heading_frame(before["pedestrian"], heading) * (gain * STEP)
        vehicle, driven, speed = vehicle + way[:, None] * ahead, driven + way, faster
        pedestrian, walking = pedestrian + (walking + 0.75 * pushed) * STEP, walking + pushed
        heading, bend = _direction(start.lane, driven)
        near = _nearness(vehicle, heading, pedestrian, margin)
        for time in AHEAD if anticipation > 0.0 else ():
            turn = bend * speed * time
            chord = heading + 0.5 * turn
            there = vehicle + (speed * time)[:, None] * torch.stack([torch.cos(chord), torch.sin(chord)], dim=1)
            then = _nearness(there, heading + turn, pedestrian + walking * time, margin)
            near = near + anticipation / len(AHEAD) * then
        collision = collision + near.mean()
        if not bool(collision.isfinite()):
            return collision, goal  # for the check of losses to find, before CurvTTC is asked of it
    return collision / steps, goal / steps


def draw_moments(
    histories: Sequence[History], count: int, rng: np.random.Generator
) -> tuple[list[History], NDArray[np.int64]]:
    """Draw up to `count` different simulated histories, and a step of each: seven times of ten the hand-over."""
    size = min(count, len(histories))
    picked = [histories[i] for i in rng.choice(len(histories), size, replace=False)]
    anywhere = np.array([int(rng.random() * len(history)) for history in picked], np.int64)
    return picked, np.where(rng.random(size) < HAND_OVERS, 0, anywhere)


def draw_scripted(
    count: int, braking: float, insisting: Sequence[float], rng: np.random.Generator
) -> dict[str, Tensor]:
    """Draw who does not do as its policy says in `count` roll-outs, as `foresee` takes it.

    :param braking: share of the roll-outs in which the vehicle brakes to a stand, by a deceleration of `BRAKING`.
    :param insisting: shares of those in which the vehicle keeps its speed, and in which the pedestrian walks on. One
        roll-out has one of these three at most; the shares add up to 1 at most.
    """
    bounds = np.cumsum([braking, *insisting])
    kind = np.searchsorted(bounds, rng.random(count), side="right")
    deceleration = rng.uniform(*BRAKING, count)
    vehicle = np.select([kind == 0, kind == 1], [-deceleration, 0.0], np.nan)
    pedestrian = np.where(kind == 2, 0.0, np.nan)
    done = {"vehicle": vehicle, "pedestrian": pedestrian}
    return {a: torch.from_numpy(np.outer(v, [1.0, 0.0]).astype(np.float32)) for a, v in done.items()}


def step_along(
    optimiser: torch.optim.Optimizer, actors: Actors, lost: Tensor, rehearsal: Tensor, weight: float, clip: float
) -> float:
    """Take a step with the actors down the gradients of what they lose and, `weight` times, of the rehearsal.

    Each is scaled down to the norm `clip` before they are added, so that neither drowns the other.

    :returns: the norm of the first gradient.
    """
    parameters = list(actors.parameters())
    parts, norms = [], []
    for loss in (lost, rehearsal):
        gradients = torch.autograd.grad(loss, parameters, allow_unused=True, materialize_grads=True)
        norms.append(float(torch.linalg.vector_norm(torch.stack([g.norm() for g in gradients]))))
        parts.append([g * min(1.0, clip / max(norms[-1], 1e-12)) for g in gradients])
    for parameter, first, second in zip(parameters, *parts, strict=True):
        parameter.grad = first + weight * second
    optimiser.step()
    return norms[0]


@torch.no_grad()
def remembered(actors: Actors, start: Start) -> Memories:
    """Return what each actor remembers of the steps before the moment."""
    out = {}
    for agent in AGENTS:
        arguments = start.observation[agent], start.acted[agent], start.curvttc
        _, out[agent] = actors[agent].remember(*arguments, start.taken)
    return out


def clearance(vehicle: Tensor, heading: Tensor, pedestrian: Tensor) -> Tensor:
    """Return the distance [B] [m] between the footprints, negative where they overlap; differentiable.

    :param vehicle, pedestrian: centres, [B, 2] [m]; heading [B] [rad].
    """
    forward, left = to_heading_frame(pedestrian - vehicle, heading).unbind(dim=1)
    along, across = forward.abs() - 0.5 * VEHICLE_LENGTH, left.abs() - 0.5 * VEHICLE_WIDTH
    outside = torch.sqrt(along.clamp(min=0.0) ** 2 + across.clamp(min=0.0) ** 2 + 1e-8)
    return outside + torch.maximum(along, across).clamp(max=0.0) - PEDESTRIAN_RADIUS


def _nearness(vehicle: Tensor, heading: Tensor, pedestrian: Tensor, margin: float) -> Tensor:
    return (1.0 - clearance(vehicle, heading, pedestrian) / margin).clamp(min=0.0) ** 2


def _turned(histories: Sequence[History], at: NDArray[np.int64]) -> Tensor:
    """Return by how much each vehicle has turned left since the hand-over [M] [rad]."""
    turned = []
    for history, i in zip(histories, at, strict=True):
        seen, lane = history.observation["pedestrian"][:i], history.lane[:i]
        way = (seen[:, 0] - seen[:, 4]) * STEP
        turned.append(((lane[:, 1] - lane[:, 0]) * way / LANE_GRID).sum())
    return torch.from_numpy(np.array(turned, np.float32))


def _direction(lane: Tensor, driven: Tensor) -> tuple[Tensor, Tensor]:
    """Return direction [B] [rad] and curvature [B] [1/m] of `lane` [B, N] after `driven` [B] metres."""
    place = (driven / LANE_GRID).clamp(0.0, lane.shape[1] - 1.001)
    node = place.detach().floor().long()
    low, high = (lane.gather(1, (node + k)[:, None])[:, 0] for k in (0, 1))
    return low + (high - low) * (place - node), (high - low) / LANE_GRID


def _bounded(gradient: Tensor) -> Tensor:
    """Shorten the rows of a gradient [B, n] that are `LONGEST` times longer than the median one."""
    norm = gradient.norm(dim=1, keepdim=True)
    bound = LONGEST * norm[norm > 0.0].median() if bool((norm > 0.0).any()) else norm.sum()
    return gradient * (bound / norm.clamp(min=1e-12)).clamp(max=1.0)
