"""Models that predict the next step of a near miss, under one interface: the learned policies, and the controls."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.policy.draws import draw_innovation, draw_latent, keys
from vpsci_ros.policy.residuals import Borrower, moments_of
from vpsci_ros.policy.stepped import actor_at_work
from vpsci_ros.policy.streaming import Draws
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import AGENTS

Actions = tuple[NDArray[np.float32], NDArray[np.float32]]


class Predictor(Protocol):
    """Anything that answers observations of N parallel interactions with both agents' accelerations.

    `tracked_steps` is that of `kinematics.scene.scene_at` from which its closed loop starts.
    """

    @property
    def tracked_steps(self) -> int:
        """Observed steps by which the vehicle's speed is known at the start; 0: as recorded."""

    def begin(self, count: int) -> None:
        """Prepare for `count` interactions with empty histories."""

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """Return both agents' accelerations, float32[N, 2] [m/s2], in the vehicle's heading frame of this step.

        :param vehicle, pedestrian: observations float32[N, 6], (6) and (7); curvttc: float64[N] [s].
        :param active: bool[N]; only these rows take a step, the others' answers do not matter.
        """

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """Take the accelerations [m/s2] that were executed where `active` into the histories."""


class RepeatVelocity:
    """The control: the last observed velocity repeated, that is, no acceleration.

    :param tracked_steps: 0: the recorded velocity; otherwise the vehicle's by its last observed positions.
    """

    def __init__(self, tracked_steps: int = 0) -> None:
        self.tracked_steps = tracked_steps

    def begin(self, count: int) -> None:
        """See `Predictor.begin`."""
        self._none = np.zeros((count, 2), np.float32)

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """See `Predictor.act`."""
        return self._none, self._none

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """See `Predictor.executed`; a velocity has no further history."""


class PredictionStart(NamedTuple):
    """Where predictions of N interactions of one source begin.

    :ivar observed: int64[N], steps that are observed before.
    :ivar moments: float64[N, 7], see `residuals.moments_of`.
    :ivar people: the source, whose own residuals are borrowed.
    """

    observed: NDArray[np.int64]
    moments: NDArray[np.float64]
    people: str

    @classmethod
    def of(cls, interactions: Interactions, people: str, observed: int) -> "PredictionStart":
        """Return the start of closed loops at the first critical steps, after up to `observed` steps."""
        moments = moments_of(interactions.observation["vehicle"], *interactions.trends())
        moments = moments[np.arange(len(interactions)), interactions.first]
        return cls(np.minimum(interactions.first, observed), moments, people)


class PolicyPredictor:
    """Both learned actors of a weights file, by the same streaming code that the nodes run.

    :param temperature: of stochastic policies, see `PolicyAgent`; 0, the default: their deterministic middle.
    :param seed: of what they draw; row i draws as episode i of scenario 0.
    :param start: where policies with residuals of recorded people borrow them; None: nowhere.
    """

    def __init__(
        self, weights: Weights, temperature: float = 0.0, seed: int = 0, start: "PredictionStart | None" = None
    ) -> None:
        self._weights, self._start = weights, start
        self._latent_size = weights.network.latent if temperature > 0.0 else 0
        self._temperature, self._seed = np.float32(temperature), seed
        self.tracked_steps = weights.network.tracked_steps

    def begin(self, count: int) -> None:
        """See `Predictor.begin`."""
        self._actors = [actor_at_work(self._weights.actor(agent), count) for agent in AGENTS]
        self._begun = np.zeros(count, bool)
        self._steps = 0
        self._taken = np.zeros(count, np.int64)
        rows = np.arange(count)
        self._key = keys(count, self._seed, 0, rows)
        self._borrowers = self._borrow(count)
        self._latents = [draw_latent(self._seed, 0, rows, agent, self._latent_size) for agent in range(len(AGENTS))]

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """See `Predictor.act`."""
        reset = active & ~self._begun
        self._begun |= active
        first, second = (self._draws(agent) for agent in range(len(AGENTS)))
        added, more = self._residuals(vehicle, active)
        self._steps += 1
        return (
            self._actors[0].step(vehicle, curvttc, reset, active, first, added),
            self._actors[1].step(pedestrian, curvttc, reset, active, second, more),
        )

    def _borrow(self, count: int) -> list[Borrower]:
        residuals = self._weights.residuals()
        if residuals is None or self._start is None or self._temperature == 0.0:
            return []
        people = self._weights.people(self._start.people)
        return [Borrower(residuals, agent, count, people) for agent in range(len(AGENTS))]

    def _residuals(
        self, vehicle: NDArray[np.float32], active: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
        """Return what recorded people add from the first predicted step on."""
        if not self._borrowers:
            return None, None
        assert self._start is not None
        predicted = active & (self._taken >= self._start.observed)
        moment = np.where((self._taken == self._start.observed)[:, None], self._start.moments, 0.0)
        moment[:, 0] = np.where(self._taken == self._start.observed, moment[:, 0], vehicle[:, 0])
        begun = predicted & (self._taken == self._start.observed)
        self._taken += active
        first, second = (b.step(moment, self._key, begun, predicted) * self._temperature for b in self._borrowers)
        return first, second

    def _draws(self, agent: int) -> Draws | None:
        if self._latent_size == 0:
            return None
        key = self._key.copy()
        key[:, 4] = self._steps
        innovation = draw_innovation(key, agent, np.ones(len(key), bool))
        return Draws(self._latents[agent], innovation, self._temperature)

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """See `Predictor.executed`."""
        for actor, action in zip(self._actors, actions, strict=True):
            actor.executed(action, active)
