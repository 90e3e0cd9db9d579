"""What recorded people did beside the mean of the actors: borrowed in training, and kept for the policies to borrow.

A roll-out in training is the actors' mean plus the residual of one of the recorded moments most like its own, of
another clip: what was done there less the mean along that track, adjusted for how the moments differ. The
gradient runs through both, so the actors learn what is left over: how people react to what comes about on the way.

Recorded accelerations are those of the motion that passes nearest to the recorded positions through the kinematics,
with little jerk: differences of published speeds neither lead along these positions, nor are they free of noise.
"""

from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.errors import InvalidInput
from vpsci_ros.kinematics.rollout import Actions, Seen
from vpsci_ros.learning.imitation import OBSERVED, RecordedSteps, Start, recorded
from vpsci_ros.policy.actor import Actors, previous
from vpsci_ros.policy.draws import keys
from vpsci_ros.policy.residuals import (
    FURTHEST,
    NEAREST,
    SECOND,
    SECONDS,
    SLOWEST,
    Borrower,
    Residuals,
    describe,
    moments_of,
    people_of,
    slopes,
)
from vpsci_ros.world.observation import AGENTS, STEP

EVERY = 3  # steps from one moment of a track whose residuals are borrowed in training to the next
JERK_WEIGHT = 1e-4  # [s6] of squared jerk against squared distance to the recorded positions: noise of 1 to 3 cm
AT_ONCE = 256  # moments whose residuals are taken at once
RIDGE = 0.1  # penalty of slopes, per onset
_MOVING = 0.5  # [m/s] below it the direction of motion says nothing of a vehicle's heading

Floats = NDArray[np.float64]


class Donors:
    """Recorded moments whose people's residuals others borrow.

    :param interactions: whole tracks.
    :param steps: of a residual in training, and at least those of one that is kept.
    :param frozen: actors that do not learn, beside whose means residuals are always borrowed: they are taken once.
    """

    def __init__(self, interactions: Interactions, steps: int, frozen: Actors | None = None) -> None:
        self._fitted, self._steps = fitted(interactions), steps
        own_people = [people_of(clip) for clip in interactions.clip]
        self.people = list(dict.fromkeys(own_people))
        self._source = np.array([self.people.index(name) for name in own_people])
        shape = interactions.motion.shape[:2]
        moments = moments_of(interactions.observation["vehicle"], *interactions.trends())
        features, side = describe(moments.reshape(-1, moments.shape[-1]))
        self._side = side.reshape(shape)
        latest = interactions.length - 1 - steps
        self._onsets = np.flatnonzero(interactions.first <= latest)
        self._row, self._at = (
            np.concatenate(part).astype(np.int64)
            for part in zip(
                *(
                    (np.full(len(own), row), own)
                    for row, end in enumerate(latest)
                    for own in [np.arange(0, end + 1, EVERY)]
                ),
                strict=True,
            )
        )
        if len(self._onsets) == 0:
            raise InvalidInput(f"near misses: expected one with {steps} steps after its onset; import whole tracks")
        own = features.reshape(*shape, -1)[self._onsets, interactions.first[self._onsets]]
        self._scale = np.ones((len(self.people), own.shape[1]))
        for number in range(len(self.people)):
            here = own[self._source[self._onsets] == number]
            self._scale[number] = np.maximum(here.std(axis=0), 1e-3) if len(here) else 1.0
        self._features = features.reshape(*shape, -1) / self._scale[self._source][:, None]
        _, self._clip = np.unique(interactions.clip.astype(str), return_inverse=True)
        self._slope = self._slopes()
        self._beside_frozen = (
            None if frozen is None else torch.stack([self._all_beside(frozen, side) for side in (False, True)])
        )

    def borrowed(self, actors: Actors, start: Start, samples: int, rng: np.random.Generator) -> Tensor:
        """Return what others did beside the mean of `actors` at moments like these, [M * samples, steps, 2, 2].

        Rows as `beside` has them; nothing is borrowed from each moment's own people.

        :param actors: not read where `frozen` ones were given.
        :raises InvalidInput: a moment's clip is the only one of its source.
        """
        pairs = zip(start.row, start.at, strict=True)
        picked = np.stack([self._pick(row, at, samples, rng) for row, at in pairs]).ravel()
        row, at = self._row[picked], self._at[picked]
        side = np.where(start.mirror, -1.0, 1.0) * self._side[start.row, start.at]
        mirror = np.repeat(side, samples) != self._side[row, at]
        if self._beside_frozen is None:
            beside = self._beside(actors, Start(row, np.maximum(at - OBSERVED, 0), at, mirror), self._steps)[0]
        else:
            beside = self._beside_frozen[mirror.astype(np.int64), picked]
        own = np.repeat(self._features[start.row, start.at], samples, axis=0)
        gap = np.clip(own - self._features[row, at], -FURTHEST, FURTHEST)
        adjust = np.einsum("bf,bfsc->bsc", gap, self._slope[self._source[row]])
        adjust[..., 1::2] *= np.repeat(side, samples)[:, None, None]
        until = min(self._steps, SECONDS * SECOND)
        each = np.repeat(adjust, SECOND, axis=1)[:, :until].reshape(len(row), until, len(AGENTS), 2)
        beside[:, :until] += torch.from_numpy(each.astype(np.float32))
        return beside

    def tensors(self, actors: Actors) -> dict[str, NDArray[np.float32]]:
        """Return the residuals of all onsets, to the ends of their tracks, as tensors of a weights file."""
        row, at = self._onsets, self._fitted.first[self._onsets]
        length = self._fitted.length[row] - 1 - at
        start = Start(row, np.maximum(at - OBSERVED, 0), at, np.zeros(len(row), np.bool_))
        with torch.no_grad():
            beside, known = self._beside(actors, start, int(length.max()))
        return Residuals(
            features=self._features[row, at].astype(np.float32),
            scale=self._scale.astype(np.float32),
            side=self._side[row, at].astype(np.float32),
            source=self._source[row].astype(np.float32),
            length=length.astype(np.float32),
            steps=beside[known].flatten(1).numpy(),
            slope=self._slope.astype(np.float32),
        ).tensors()

    @torch.no_grad()
    def _all_beside(self, actors: Actors, mirror: bool) -> Tensor:
        """Return `_beside` of every moment, [moments, steps, 2, 2]."""
        begin, sides = np.maximum(self._at - OBSERVED, 0), np.full(len(self._at), mirror)
        whole = Start(self._row, begin, self._at, sides)
        parts = np.array_split(np.arange(len(self._at)), 1 + len(self._at) // AT_ONCE)
        return torch.cat([self._beside(actors, whole.take(part), self._steps)[0] for part in parts])

    def _slopes(self) -> Floats:
        """Return `Residuals.slope`: ridge regressions of what was done after the onsets of each kind of people."""
        row, at = self._onsets, self._fitted.first[self._onsets]
        start = Start(row, np.maximum(at - OBSERVED, 0), at, np.zeros(len(row), np.bool_))
        done, known = (value.numpy().astype(np.float64) for value in self._beside(None, start, SECONDS * SECOND))
        count = known.reshape(len(row), SECONDS, SECOND).sum(axis=2)
        done = done.reshape(len(row), SECONDS, SECOND, -1).sum(axis=2) / np.maximum(count, 1)[..., None]
        done[..., 1::2] *= self._side[row, at][:, None, None]
        out = np.zeros(slopes(len(self.people)))
        for people, second in np.ndindex(len(self.people), SECONDS):
            rows = (self._source[row] == people) & (count[:, second] == SECOND)
            if rows.any():
                features, actions = self._features[row[rows], at[rows]], done[rows, second]
                features, actions = features - features.mean(axis=0), actions - actions.mean(axis=0)
                ridge = RIDGE * len(features) * np.eye(features.shape[1])
                out[people, :, second] = np.linalg.solve(features.T @ features + ridge, features.T @ actions)
        return out

    def _pick(self, row: int, at: int, samples: int, rng: np.random.Generator) -> NDArray[np.int64]:
        others = np.flatnonzero(
            (self._clip[self._row] != self._clip[row]) & (self._source[self._row] == self._source[row])
        )
        if len(others) == 0:
            raise InvalidInput(
                "near misses: expected two clips or more of each source, to borrow residuals from another"
            )
        apart = self._features[self._row[others], self._at[others]] - self._features[row, at]
        gap = np.einsum("mf,mf->m", apart, apart)
        count = min(NEAREST, len(others))
        near = others[np.argpartition(gap, count - 1)[:count]]
        return near[rng.permutation(count)[np.arange(samples) % count]]

    def _beside(self, actors: Actors | None, start: Start, steps: int) -> tuple[Tensor, Tensor]:
        """Return what was done less the means (None: 0) along the own tracks, [B, steps, 2, 2], and where it is known.

        Agents in the order of `AGENTS`; along [m/s2] and left: of the vehicle a curvature [1/m], of the pedestrian
        [m/s2], both in the vehicle's heading frame. Zero beyond the end of a track.
        """
        data = recorded(self._fitted, start, OBSERVED + steps + 1)
        lead = start.at - start.begin
        rows, at = torch.arange(len(lead))[:, None], torch.from_numpy(lead)[:, None] + torch.arange(steps)
        parts = []
        for agent in AGENTS:
            done = data.action[agent]
            mean = actors[agent](data.observation[agent], previous(done), data.curvttc) if actors else 0.0
            parts.append((done - mean)[rows, at])
        parts[0] = torch.stack([parts[0][..., 0], parts[0][..., 1] / _steering(data, rows, at)], dim=-1)
        known = torch.from_numpy(start.at[:, None] + np.arange(steps) < self._fitted.length[start.row, None] - 1)
        return torch.stack(parts, dim=2) * known[..., None, None], known


def _steering(data: RecordedSteps, rows: Tensor, at: Tensor) -> Tensor:
    speed = data.motion[rows, at, 3:5].norm(dim=-1).clamp(min=SLOWEST)
    return speed * speed


class Adding:
    """Adds borrowed residuals, as `Donors.borrowed` returns them, to a roll-out: see `ActorPair`."""

    def __init__(self, residuals: Tensor) -> None:
        self._residuals = residuals

    def __call__(self, seen: Seen) -> Actions:
        """Return what is added to this step."""
        vehicle, pedestrian = self._residuals[:, seen.step].unbind(dim=1)
        speed = seen.scene.vehicle_velocity.norm(dim=1).clamp(min=SLOWEST)
        return dict(
            zip(AGENTS, (torch.stack([vehicle[:, 0], vehicle[:, 1] * speed**2], dim=1), pedestrian), strict=True)
        )


class Borrowing:
    """Adds residuals to a roll-out as policies at work borrow them: see `ActorPair` and `policy.residuals.Borrower`."""

    def __init__(self, residuals: Residuals, count: int, acceleration: Tensor) -> None:
        self._borrowers = [Borrower(residuals, agent, count) for agent in range(len(AGENTS))]
        self._speed: Floats | None = None
        self._acceleration: Floats = acceleration.detach().double().numpy()
        self._key = keys(count, torch.randint(2**62, (count,)).numpy(), 0, 0)

    def __call__(self, seen: Seen) -> Actions:
        """Return what is added to this step."""
        own = seen.observation["vehicle"].detach().double().numpy()
        if self._speed is not None:
            self._acceleration = (own[:, 0] - self._speed) / STEP
        self._speed = own[:, 0]
        yaw_rate = own[:, 0] * seen.scene.curvature.detach().double().numpy()
        moment = moments_of(own, self._acceleration, yaw_rate)
        self._key[:, 4] = seen.step
        every = np.ones(len(own), np.bool_)
        added = (b.step(moment, self._key, every & (seen.step == 0), every) for b in self._borrowers)
        return dict(zip(AGENTS, map(torch.from_numpy, added), strict=True))


def fitted(interactions: Interactions) -> Interactions:
    """Return interactions with the motion that passes nearest to the recorded positions, and its accelerations.

    The vehicle moves along its heading and does not roll backwards.
    """
    motion = interactions.motion.copy()
    for row, length in enumerate(interactions.length):
        own = motion[row, :length]
        velocity, position = _fit(int(length))
        recorded_heading = own[:, 2].copy()
        for place, speed in ((0, 3), (5, 7)):
            own[:, speed : speed + 2] = velocity @ own[:, place : place + 2]
            own[:, place : place + 2] = position @ own[:, place : place + 2]
        own[:, 2] = _headings(recorded_heading, own[:, 3:5])
        c, s = np.cos(own[:, 2]), np.sin(own[:, 2])
        along = np.maximum(c * own[:, 3] + s * own[:, 4], 0.0)
        own[:, 3], own[:, 4] = along * c, along * s
    return interactions.moving(motion)


def _headings(recorded_heading: Floats, velocity: Floats) -> Floats:
    """Return the direction of motion [T] [rad]; where a vehicle hardly moves, the recorded one, turned as nearby."""
    moving = np.flatnonzero(np.hypot(velocity[:, 0], velocity[:, 1]) > _MOVING)
    if moving.size == 0:
        return recorded_heading
    turn = np.arctan2(velocity[:, 1], velocity[:, 0]) - recorded_heading
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    nearest = moving[np.abs(np.arange(len(velocity))[:, None] - moving).argmin(axis=1)]
    result: Floats = recorded_heading + turn[nearest]
    return result


@cache
def _fit(length: int) -> tuple[Floats, Floats]:
    """Return matrices [T, T] from recorded positions to velocities and positions with little jerk, by least squares.

    A position follows from the one before with the mean of both velocities, as in the kinematics.
    """
    way = np.zeros((length, length + 1))  # from the first position and the velocities to positions
    way[:, 0] = 1.0
    for step in range(1, length):
        way[step, 1:] = way[step - 1, 1:]
        way[step, step : step + 2] += 0.5 * STEP
    jerk = np.zeros((max(length - 2, 0), length + 1))
    for step in range(len(jerk)):
        jerk[step, step + 1 : step + 4] = np.array([1.0, -2.0, 1.0]) / STEP**2
    # By torch, since numpy's products take as many threads as there are cores, and other last bits with each number.
    ways, jerks = torch.from_numpy(way), torch.from_numpy(jerk)
    normal = ways.T @ ways + JERK_WEIGHT * jerks.T @ jerks + 1e-9 * torch.eye(length + 1, dtype=torch.float64)
    solved = torch.linalg.solve(normal, ways.T)
    return solved[1:].numpy(), (ways @ solved).numpy()
