"""Models that predict the next step of a near miss, under one interface: the learned policies, and the controls."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.config import AGENTS
from vpsci_ros.learning.streaming import StreamingActor
from vpsci_ros.learning.weights import Weights

Actions = tuple[NDArray[np.float32], NDArray[np.float32]]


class Predictor(Protocol):
    """Anything that answers observations of N parallel interactions with both agents' accelerations.

    `tracked_steps` is that of `scene.scene_at` from which its closed loop starts.
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
        """Tell which accelerations were executed where `active`: these enter the histories."""


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


class PolicyPredictor:
    """Both learned actors of a weights file, by the same streaming code that the nodes run."""

    def __init__(self, weights: Weights) -> None:
        self._weights = weights
        self.tracked_steps = weights.network.tracked_steps

    def begin(self, count: int) -> None:
        """See `Predictor.begin`."""
        self._actors = [StreamingActor(self._weights.actor(agent), count) for agent in AGENTS]
        self._begun = np.zeros(count, bool)

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
        first, second = self._actors
        return first.step(vehicle, curvttc, reset, active), second.step(pedestrian, curvttc, reset, active)

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """See `Predictor.executed`."""
        for actor, action in zip(self._actors, actions, strict=True):
            actor.executed(action, active)
