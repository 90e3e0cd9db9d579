"""Both actors rolled out in closed loop through the kinematics, with gradients.

The world's kinematics are known, so an actor's action has a derivative of everything that follows from it, not only of
what a critic expects: see 'Learning continuous control policies by stochastic value gradients' by Heess et al. 2015
(https://arxiv.org/abs/1510.09142) and 'Accelerated policy learning with parallel differentiable simulation' by Xu et
al. 2022 (https://arxiv.org/abs/2204.07137). From recorded steps the distance to the recorded positions is a loss, from
simulated ones what is wrong with an episode: contact, leaving the lane, a pedestrian that does not go on, and effort.

Simulated steps come from the world and know their road (`world.road`). The roll-out differs from the world: it has one
step of 0.1 s for two ticks, its rule-based pair goes on without regard to each other, and the policies' memory goes on
where they take control again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.evaluation.scene import Scene, advance, observe, scene_at, time_to_collision, to_heading_frame
from vpsci_ros.learning.replay import History
from vpsci_ros.learning.training_config import ClosedLoopConfig
from vpsci_ros.policy.actor import Actors
from vpsci_ros.policy.sst import Memory
from vpsci_ros.safety import CRITICAL_TTC, PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world.calibration import JERK
from vpsci_ros.world.kinematics import SHARPEST_TURN
from vpsci_ros.world.lane_driving import (
    COMFORT_ACCELERATION,
    COMFORT_DECELERATION,
    LOOK_AHEAD,
    LOOK_AHEAD_TIME,
    SPEED_TIME,
)
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, STEP
from vpsci_ros.world.road import LANE_POINTS, LANE_STEP

Actions = dict[str, Tensor]
_HALF = torch.tensor([0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH])
_MIRRORED = torch.tensor([1.0, -1.0])
_MIRRORED_MOTION = torch.tensor([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # a row of `Interactions.motion`
NEAR_OFFSET = 0.3  # [m] of lacking clearance, above which its price grows with the square
_SMALL = 0.05  # [m] below which the error of a position grows with its square
_STRIDE = 2.0  # [m/s2] with which a walker goes on


class Lane(NamedTuple):
    """The lanes of B vehicles as points [B, LANE_POINTS, 2] [m], `LANE_STEP` apart."""

    points: Tensor

    def project(self, place: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return arc length [B] [m], distance to the left [B] [m] and the lane's direction [B, 2] nearest to places."""
        begin, way = self.points[:, :-1], self.points[:, 1:] - self.points[:, :-1]
        length = way.norm(dim=2).clamp(min=1e-6)
        share = ((place[:, None] - begin) * way).sum(dim=2) / length**2
        # Joined, not assigned in place: an assignment to a slice of itself is a cycle of the graph that is never freed.
        share = torch.cat([share[:, :-1].clamp(0.0, 1.0), share[:, -1:].clamp(min=0.0)], dim=1)
        gap = (place[:, None] - begin - share[..., None] * way).norm(dim=2)
        rows, nearest = torch.arange(len(place)), gap.detach().argmin(dim=1)
        unit = way[rows, nearest] / length[rows, nearest, None]
        off = place - begin[rows, nearest]
        left = unit[:, 0] * off[:, 1] - unit[:, 1] * off[:, 0]
        return (nearest + share[rows, nearest]) * LANE_STEP, left, unit

    def at(self, s: Tensor) -> Tensor:
        """Return the points [B, 2] at arc lengths [B] [m]; beyond the end the lane goes straight on."""
        rows, place = torch.arange(len(s)), (s / LANE_STEP).clamp(min=0.0)
        i = place.floor().long().clamp(max=LANE_POINTS - 2)
        begin, end = self.points[rows, i], self.points[rows, i + 1]
        return begin + (place - i)[:, None] * (end - begin)

    @torch.no_grad()
    def keeping(self, scene: Scene) -> Tensor:
        """Return the lateral acceleration [m/s2], [B], that keeps the lane, as `world.lane_driving` has it."""
        speed = scene.vehicle_velocity.norm(dim=1)
        s, _, _ = self.project(scene.vehicle)
        target = self.at(s + LOOK_AHEAD + LOOK_AHEAD_TIME * speed)
        ahead, left = to_heading_frame(target - scene.vehicle, scene.heading).unbind(dim=1)
        curvature = 2.0 * left / (ahead**2 + left**2).clamp(min=1e-6)
        return curvature.clamp(-SHARPEST_TURN, SHARPEST_TURN) * speed**2


@dataclass(frozen=True)
class Start:
    """B hand-overs from which both actors are rolled out.

    :ivar came: by agent [B, 2] [m/s2], the acceleration with which it comes; curvttc: [B] [s].
    :ivar lane: of the vehicles; way: [B, 2], along the pedestrians' routes. Both in the frame of `scene`.
    :ivar wanted: [B, 2] [m/s]; release: [B] [s]; gain: [B, 1]; keeps_lane, limited: bool[B]; see `world.road.Road`.
    """

    scene: Scene
    came: Actions
    curvttc: Tensor
    lane: Lane
    way: Tensor
    wanted: Tensor
    release: Tensor
    gain: Tensor
    keeps_lane: Tensor
    limited: Tensor

    def __len__(self) -> int:
        return len(self.curvttc)

    def and_then(self, other: "Start") -> "Start":
        """Return the hand-overs of both."""
        names = "curvttc", "way", "wanted", "release", "gain", "keeps_lane", "limited"
        return Start(
            scene=Scene(*(torch.cat(parts) for parts in zip(self.scene, other.scene, strict=True))),
            came={agent: torch.cat([self.came[agent], other.came[agent]]) for agent in AGENTS},
            lane=Lane(torch.cat([self.lane.points, other.lane.points])),
            **{name: torch.cat([getattr(self, name), getattr(other, name)]) for name in names},
        )

    def asked(self, scene: Scene, actions: Actions, acts: Tensor) -> Actions:
        """Return the accelerations [m/s2] asked of the agents, by agent [B, 2].

        :param actions: of the policies; acts: bool[B], where these have control, elsewhere the rule-based pair.
        """
        keeping, none = self.lane.keeping(scene), torch.zeros(len(self))
        vehicle = actions["vehicle"] + torch.stack([none, keeping * self.keeps_lane], dim=1)
        speed = scene.vehicle_velocity.norm(dim=1)
        along = ((self.wanted[:, 0] - speed) / SPEED_TIME).clamp(-COMFORT_DECELERATION, COMFORT_ACCELERATION)
        walking = self.way * self.wanted[:, 1:] - scene.pedestrian_velocity
        stride = to_heading_frame(walking, scene.heading) / SPEED_TIME
        stride = stride * (_STRIDE / stride.norm(dim=1, keepdim=True).clamp(min=_STRIDE))
        own = acts[:, None]
        return {
            "vehicle": torch.where(own, vehicle, torch.stack([along, keeping], dim=1)),
            "pedestrian": torch.where(own, actions["pedestrian"] * self.gain, stride),
        }

    def executed(self, asked: Actions, before: Actions) -> Actions:
        """Return the accelerations [m/s2] that the agents execute after those `before`, by agent [B, 2]."""
        most, limited = JERK * STEP, self.limited[:, None]
        bounded = torch.maximum(torch.minimum(asked["vehicle"], before["vehicle"] + most), before["vehicle"] - most)
        change = asked["pedestrian"] - before["pedestrian"]
        share = (most / change.norm(dim=1, keepdim=True).clamp(min=1e-6)).clamp(max=1.0)
        return {
            "vehicle": torch.where(limited, bounded, asked["vehicle"]),
            "pedestrian": torch.where(limited, before["pedestrian"] + share * change, asked["pedestrian"]),
        }


def roll_out(actors: Actors, start: Start, steps: int, beyond: int = 0) -> Iterator[tuple[Scene, Actions]]:
    """Yield the scene after each step of 0.1 s, and the actors' actions, by agent [B, 2] [m/s2], that led to it.

    After the release time without danger the rule-based pair has control, until CurvTTC is critical again.

    :param beyond: further steps in which the rule-based pair has control everywhere; their actions are zero.
    """
    memory, none = {agent: Memory() for agent in AGENTS}, torch.zeros(len(start), ACTION_SIZE)
    scene, before, done, quiet = start.scene, start.came, start.came, torch.zeros(len(start))
    for step in range(steps + beyond):
        if not scene.finite:  # the loss says so
            scene = Scene(*(part * torch.nan for part in scene))
            yield from ((scene, dict.fromkeys(AGENTS, none)) for _ in range(step, steps + beyond))
            return
        curvttc = time_to_collision(scene).float() if step else start.curvttc
        quiet = torch.where(curvttc < CRITICAL_TTC, 0.0, quiet + STEP)
        acts = (quiet < start.release) & (step < steps)
        actions = dict.fromkeys(AGENTS, none)
        if step < steps:
            seen = dict(zip(AGENTS, observe(scene), strict=True))
            actions = {
                agent: actors[agent].next(seen[agent], before[agent], curvttc, memory[agent]) for agent in AGENTS
            }
        asked = start.asked(scene, actions, acts)
        before = {agent: torch.where(acts[:, None], actions[agent], asked[agent]) for agent in AGENTS}
        done = start.executed(asked, done)
        scene = advance(scene, done)
        yield scene, actions


class Recorded:
    """Recorded steps, as they are and mirrored, as starts of roll-outs.

    :param interactions: what to learn from.
    """

    def __init__(self, interactions: Interactions, config: ClosedLoopConfig) -> None:
        self._interactions, self._config = interactions, config
        left = interactions.length - 1 - interactions.first
        self._rows = np.flatnonzero(left >= config.least_steps)
        self._motion = torch.from_numpy(interactions.motion.astype(np.float32))

    def draw(self, rng: np.random.Generator) -> "RecordedStart":
        """Return random steps, half of them onsets; half are mirrored, and all are moved a little."""
        config, own = self._config, self._interactions
        row = rng.choice(self._rows, size=config.recorded)
        last = np.maximum(own.length[row] - 1 - config.least_steps, 0)
        early = np.minimum(np.maximum(own.first[row] - config.before_onset, 0), last)
        anywhere = early + (rng.random(len(row)) * (last - early + 1)).astype(np.int64)
        at = np.where(rng.random(len(row)) < 0.5, own.first[row], anywhere)
        mirrored = torch.from_numpy(rng.random(len(row)) < 0.5)
        motion = self._motion[row] * torch.where(mirrored[:, None, None], _MIRRORED_MOTION, 1.0)
        across = torch.where(mirrored[:, None], _MIRRORED, 1.0)
        came = {agent: torch.from_numpy(values) * across for agent, values in own.came_to(row, at).items()}
        return self._moved(motion, row, at, came, rng)

    def _moved(
        self, motion: Tensor, row: NDArray[np.int64], at: NDArray[np.int64], came: Actions, rng: np.random.Generator
    ) -> "RecordedStart":
        """Return starts with normal noise on velocities, the pedestrian's place, and accelerations."""
        config, count = self._config, len(row)

        def noise(deviation: float, width: int) -> Tensor:
            return torch.from_numpy(rng.normal(0.0, deviation, (count, width)).astype(np.float32))

        scene, place = scene_at(motion, torch.from_numpy(at)), noise(config.place_noise, 2)
        scene = scene._replace(
            vehicle_velocity=scene.vehicle_velocity * (1.0 + noise(config.speed_noise, 1)),
            pedestrian_velocity=scene.pedestrian_velocity + noise(config.walking_noise, 2),
            pedestrian=scene.pedestrian + place,
        )
        start = Start(
            scene,
            {agent: came[agent] + noise(config.acceleration_noise, 2) for agent in AGENTS},
            torch.from_numpy(self._interactions.curvttc[row, at].astype(np.float32)),
            Lane(torch.zeros(count, LANE_POINTS, 2)),
            torch.zeros(count, 2),
            torch.zeros(count, 2),
            torch.full((count,), torch.inf),
            torch.ones(count, 1),
            *(torch.zeros(count, dtype=torch.bool) for _ in range(2)),
        )
        later = at[:, None] + 1 + np.arange(config.imitated_steps)
        known = torch.from_numpy(later < self._interactions.length[row][:, None])
        after = motion[torch.arange(count)[:, None], torch.from_numpy(np.minimum(later, motion.shape[1] - 1))]
        return RecordedStart(start, after[..., 0:2], after[..., 5:7] + place[:, None], known)


class RecordedStart(NamedTuple):
    """Recorded starts, and where both agents then were.

    :ivar vehicle, pedestrian: [B, H, 2] [m]; known: bool[B, H].
    """

    start: Start
    vehicle: Tensor
    pedestrian: Tensor
    known: Tensor

    def error(self, scenes: Sequence[Scene]) -> Tensor:
        """Return the mean distance [m] of rolled-out scenes, H of them, to the recorded positions."""
        total = torch.zeros(())
        for step, scene in enumerate(scenes):
            for here, there in ((scene.vehicle, self.vehicle), (scene.pedestrian, self.pedestrian)):
                square = ((here - there[:, step]) ** 2).sum(dim=1)
                total = total + (torch.sqrt(square + _SMALL**2) * self.known[:, step]).sum()
        return total / (2.0 * self.known.sum())


def simulated_start(histories: Sequence[History], steps: Sequence[int]) -> Start:
    """Return these steps of simulated histories as starts, in the vehicle's frame, as if control began there."""
    pairs = list(zip(histories, steps, strict=True))

    def of(name: str, agent: str | None = None) -> Tensor:
        own = ((getattr(h, name) if agent is None else getattr(h, name)[agent])[step] for h, step in pairs)
        return torch.from_numpy(np.stack(list(own)))

    seen, came = of("observation", "vehicle"), {agent: of("came", agent) for agent in AGENTS}
    rules = torch.from_numpy(np.stack([h.rules for h, _ in pairs]))
    speed = seen[:, 0]
    curvature = (came["vehicle"][:, 1] / speed.clamp(min=1.0) ** 2).clamp(-SHARPEST_TURN, SHARPEST_TURN)
    zero = torch.zeros_like(speed)
    scene = Scene(torch.stack([zero, zero], 1), zero, seen[:, :2], curvature, -seen[:, 2:4], seen[:, :2] - seen[:, 4:6])
    lane = Lane(of("lane").reshape(len(pairs), LANE_POINTS, 2))
    wanted = torch.from_numpy(np.stack([h.wanted for h, _ in pairs]))
    rules_of = rules[:, 0], rules[:, 1:2], rules[:, 2] > 0, rules[:, 3] > 0
    return Start(scene, came, of("curvttc"), lane, of("way"), wanted, *rules_of)


def clearance(scene: Scene) -> Tensor:
    """Return the free distance [m], [B], between the vehicle's rectangle and the pedestrian; below 0: they touch."""
    gap = to_heading_frame(scene.pedestrian - scene.vehicle, scene.heading).abs() - _HALF
    outside = torch.sqrt((gap.clamp(min=0.0) ** 2).sum(dim=1) + 1e-8)
    return outside + gap.amax(dim=1).clamp(max=0.0) - PEDESTRIAN_RADIUS


class Penalties(NamedTuple):
    """Penalties of B roll-outs, float[B] each, before their prices; 0 is best.

    :ivar near: d (d + `NEAR_OFFSET`) [m2], where the least clearance is d below the margin.
    :ivar off: distance [m] of the vehicle beyond half a metre from the middle of its lane, mean over the steps; 0 where
        the world keeps the lane.
    :ivar late: share of its initial speed that the pedestrian lacks at the end, along its route. The car may wait, as
        people's do: with both priced the car goes first where people let the pedestrian go (docs/stage_2.md).
    :ivar effort: squared accelerations of both agents, mean over the steps [m2/s4].
    """

    near: Tensor
    off: Tensor
    late: Tensor
    effort: Tensor


def penalties(start: Start, scenes: Sequence[Scene], actions: Sequence[Actions], config: ClosedLoopConfig) -> Penalties:
    """Return the penalties of the roll-outs of B starts, given as scenes and actions of each step."""
    more = config.margin - config.margin_beyond
    gaps = [clearance(scene) + (more if step >= config.steps else 0.0) for step, scene in enumerate(scenes)]
    near = torch.stack(gaps).amin(dim=0)
    own = scenes[: config.steps]
    beside = torch.stack([torch.relu(start.lane.project(scene.vehicle)[1].abs() - 0.5) for scene in own]).mean(dim=0)
    lack = torch.relu(config.margin - near)
    squares = [sum(((one[agent] ** 2).sum(dim=1) for agent in AGENTS), torch.zeros(())) for one in actions]
    paces = start.scene.pedestrian_velocity.norm(dim=1).clamp(min=0.5, max=2.0)
    walks = (scenes[config.steps - 1].pedestrian_velocity * start.way).sum(dim=1) / paces
    return Penalties(
        lack * (lack + NEAR_OFFSET),
        beside * ~start.keeps_lane,
        torch.relu(1.0 - walks),
        torch.stack(squares[: config.steps]).mean(dim=0),
    )


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
