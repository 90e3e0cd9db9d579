"""Stage 2 through the known kinematics: the rewards of (25)-(27) made smooth, and followed through simulated seconds.

The learner knows how both agents move, (8)-(13) and (18)-(24), so it need not learn from a critic what an action leads
to. It takes moments out of its simulated experience, lets both actors act from there on in a differentiable copy of
the world, and follows the gradient of what they lose through the motion of the next seconds, as stochastic value
gradients with a known model do (Heess et al. 2015, 'Learning continuous control policies by stochastic value
gradients', https://arxiv.org/abs/1510.09142): also through what the agents then observe of each other and how they
react.

Events have no gradient, so each gets a smooth stand-in (`rewards`):

- collision (25): clearance of the footprints below a margin, now and, by a weight, where both would be shortly;
- goal (26): how far each agent's velocity is from that of the hand-over; a vehicle's is `CRUISE` along its lane at
  least. Weights say whose delay costs more; which agent learns to give way also depends on the seed of a training.

In some of the roll-outs one of the two does not act by its policy: the vehicle brakes to a stand and stays, or it keeps
its speed; or the pedestrian walks on. A policy that trains with one partner only learns a convention with that partner,
for example that the vehicle always gives way, and cannot answer others; policies that test a driving system must.

The speed reward is taken at the recorded steps rather than at the foreseen ones.

The copy is simpler than the world: the vehicle keeps to its lane whatever its lateral action, which in the world
moves it within the lane; so the lateral action learns from the speed reward and from rehearsal only. What transitions
do not hold is taken for granted: the paper's 0.5 of (21)-(24), lane following, and steps of 0.1 s. A world that
differs is refused and needs `objective: ddpg`.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.kinematics.lane import OnLane
from vpsci_ros.kinematics.rollout import Actions, ActorPair, Seen, roll_out
from vpsci_ros.kinematics.scene import from_heading_frame
from vpsci_ros.learning.replay import History, collate
from vpsci_ros.learning.rewards import collision_loss, pedestrian_pace_loss, vehicle_pace_loss
from vpsci_ros.policy.actor import Actors, before_step, previous
from vpsci_ros.policy.sst import StepState
from vpsci_ros.world.observation import AGENTS, LANE_GRID, STEP

CLEARANCE_MARGIN = 0.5  # [m] clearance of the footprints that both should keep
PACE_WEIGHTS = (0.5, 0.5)  # of the vehicle's and of the pedestrian's velocity in the goal loss
CRUISE = 3.5  # [m/s] pace that a vehicle which stands or creeps should take up
LONGEST = 20.0  # times the median: the length to which gradients of single roll-outs are shortened
BRAKING = (1.0, 5.0)  # [m/s2] least and greatest deceleration of a vehicle that brakes whatever its policy says

Memories = dict[str, list[StepState]]


class Moments(NamedTuple):
    """Moments from which M roll-outs begin, in the vehicle's heading frame of each; float32.

    The last four hold the steps before the moment, T at most.
    """

    speed: Tensor  # [M] [m/s] of the vehicle
    lane: Tensor  # [M, N] [rad] its direction ahead of the vehicle, every `LANE_GRID` metres
    pedestrian: Tensor  # [M, 2] [m] where it is
    walking: Tensor  # [M, 2] [m/s] its velocity
    cruise: Tensor  # [M] [m/s] speed of the vehicle at the hand-over, `CRUISE` at least
    course: Tensor  # [M, 2] [m/s] velocity of the pedestrian at the hand-over
    before: dict[str, Tensor]  # agent -> [M, 2] [m/s2] action of the step before
    observation: dict[str, Tensor]  # agent -> [M, T, 6]
    acted: dict[str, Tensor]  # agent -> [M, T, 2] [m/s2] action before each step
    curvttc: Tensor  # [M, T] [s]
    taken: Tensor  # int64[M] how many steps there were


def moments_at(histories: Sequence[History], at: NDArray[np.int64]) -> Moments:
    """Return the moments at step `at`, int64[M], of M simulated histories."""
    batch, rows = collate(histories), np.arange(len(histories))
    seen = batch.observation["pedestrian"][rows, at]
    taken = torch.from_numpy(at)
    longest = max(1, int(at.max()))
    return Moments(
        speed=(seen[:, 0] - seen[:, 4]).clamp(min=0.0),  # (7): own velocity minus the relative one is the vehicle's
        lane=torch.from_numpy(np.stack([h.lane[i] for h, i in zip(histories, at, strict=True)])),
        pedestrian=seen[:, 2:4],
        walking=seen[:, 0:2],
        cruise=batch.observation["vehicle"][:, 0, 0].clamp(min=CRUISE),
        course=from_heading_frame(batch.observation["pedestrian"][:, 0, 0:2], -_turned(histories, at)),
        before={agent: before_step(batch.action[agent], taken) for agent in AGENTS},
        observation={agent: batch.observation[agent][:, :longest] for agent in AGENTS},
        acted={agent: previous(batch.action[agent])[:, :longest] for agent in AGENTS},
        curvttc=batch.curvttc[:, :longest],
        taken=taken,
    )


def foresee(
    actors: Actors,
    start: Moments,
    *,
    steps: int,
    anticipation: float,
    pace: Sequence[float] = PACE_WEIGHTS,
    gain: float,
    scripted: Mapping[str, Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """Let both actors act together for `steps` steps, and return what they lose by collision and by goal.

    :param anticipation: weight of the clearances that the speeds of the moment lead to after `rewards.AHEAD`,
        beside that of the moment.
    :param pace: weights of the vehicle's and of the pedestrian's pace.
    :param gain: share of the pedestrian's acceleration that becomes motion, (21)-(24).
    :param scripted: as `ActorPair` takes recorded actions.
    :returns: float32 scalars with gradient, means of all roll-outs and steps.
    """
    lane = OnLane(start.lane, start.speed, start.pedestrian, start.walking, gain)
    pair = ActorPair(actors, remembered(actors, start), start.before, recorded=scripted, bound=bounded)
    collision, goal = torch.zeros(()), torch.zeros(())

    def act(seen: Seen) -> Actions:
        nonlocal goal
        actions, walking = pair(seen), seen.scene.pedestrian_velocity
        goal = goal + pace[0] * vehicle_pace_loss(lane.speed, start.cruise).mean()
        goal = goal + pace[1] * pedestrian_pace_loss(walking, start.course).mean()
        return actions

    for scene in roll_out(lane.start, act, [len(start.speed)] * steps, lane.advance):
        collision = collision + collision_loss(scene, lane.speed, CLEARANCE_MARGIN, anticipation).mean()
    return collision / steps, goal / steps


def draw_moments(
    histories: Sequence[History], count: int, hand_over_share: float, rng: np.random.Generator
) -> tuple[list[History], NDArray[np.int64]]:
    """Draw up to `count` different simulated histories, and a step of each: in such a share of them the hand-over."""
    size = min(count, len(histories))
    picked = [histories[i] for i in rng.choice(len(histories), size, replace=False)]
    anywhere = np.array([int(rng.random() * len(history)) for history in picked], np.int64)
    return picked, np.where(rng.random(size) < hand_over_share, 0, anywhere)


def draw_scripted(
    count: int, steps: int, braking: float, insisting: Sequence[float], rng: np.random.Generator
) -> dict[str, Tensor]:
    """Draw who does not do as its policy says in `count` roll-outs of `steps` steps, as `foresee` takes it.

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
    along = np.array([1.0, 0.0])
    return {
        agent: torch.from_numpy(np.outer(value, along).astype(np.float32))[:, None].expand(-1, steps, -1)
        for agent, value in done.items()
    }


def step_along(
    optimiser: torch.optim.Optimizer,
    actors: Actors,
    lost: Tensor,
    rehearsal: Callable[[], Tensor],
    weight: float,
    clip: float,
) -> tuple[float, float]:
    """Take a step with the actors down the gradients of what they lose and, `weight` times, of the rehearsal.

    Each is scaled down to the norm `clip` before they are added, so that neither drowns the other.

    :param rehearsal: returns its loss, while another thread goes back through `lost`: that draws no random numbers and
        needs no lock of Python, so both come out as one after the other.
    :returns: the norm of the first gradient, and the loss of the rehearsal.
    """
    parameters = list(actors.parameters())

    def gradient_of(loss: Tensor) -> tuple[Tensor, ...]:
        return torch.autograd.grad(loss, parameters, allow_unused=True, materialize_grads=True)

    with ThreadPoolExecutor(1, initializer=torch.set_num_threads, initargs=(torch.get_num_threads(),)) as other_core:
        of_lost = other_core.submit(gradient_of, lost)
        rehearsed = rehearsal()
        both = gradient_of(rehearsed), of_lost.result()
    parts, norms = [], []
    for gradients in both[::-1]:
        norms.append(float(torch.linalg.vector_norm(torch.stack([g.norm() for g in gradients]))))
        parts.append([g * min(1.0, clip / max(norms[-1], 1e-12)) for g in gradients])
    for parameter, first, second in zip(parameters, *parts, strict=True):
        parameter.grad = first + weight * second
    optimiser.step()
    return norms[0], float(rehearsed.detach())


@torch.no_grad()
def remembered(actors: Actors, start: Moments) -> Memories:
    """Return what each actor remembers of the steps before the moment."""
    out = {}
    for agent in AGENTS:
        arguments = start.observation[agent], start.acted[agent], start.curvttc
        _, out[agent] = actors[agent].remember(*arguments, start.taken)
    return out


def _turned(histories: Sequence[History], at: NDArray[np.int64]) -> Tensor:
    """Return by how much each vehicle has turned left since the hand-over [M] [rad]."""
    turned = []
    for history, i in zip(histories, at, strict=True):
        seen, lane = history.observation["pedestrian"][:i], history.lane[:i]
        way = (seen[:, 0] - seen[:, 4]) * STEP
        turned.append(((lane[:, 1] - lane[:, 0]) * way / LANE_GRID).sum())
    return torch.from_numpy(np.array(turned, np.float32))


def bounded(gradient: Tensor) -> Tensor:
    """Shorten the rows of a gradient [B, n] that are `LONGEST` times longer than the median one."""
    norm = gradient.norm(dim=1, keepdim=True)
    bound = LONGEST * norm[norm > 0.0].median() if bool((norm > 0.0).any()) else norm.sum()
    return gradient * (bound / norm.clamp(min=1e-12)).clamp(max=1.0)
