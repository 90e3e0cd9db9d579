"""Rewards: the speed reward of both stages (14)-(15), and collision, goal and their weighting in stage 2 (25)-(28).

Speeds are those of the next step, expressed in the vehicle's heading frame of the step at which the action was taken.
In its own frame the vehicle never moves sideways, so a deviation taken there would be zero and (14) undefined.
"""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.learning.config import STEP, RefineConfig


def predicted_velocity(velocity: Tensor, action: Tensor) -> Tensor:
    """Return v(t+1) = v(t) + a(t) dt, (8)-(9): velocity [..., 2] m/s, action [..., 2] m/s2, in the frame of step t."""
    return velocity + action * STEP


def speed_reward(predicted: Tensor, observed: Tensor, deviation: Tensor) -> Tensor:
    """Return R_v of (14)-(15), float[...], never positive, before scaling.

    -sum over both components of ((v_predicted - mu) / sigma - (v_observed - mu) / sigma)^2, in which mu cancels.

    :param predicted: v(t+1) by the policy's action, float[..., 2] [m/s].
    :param observed: v(t+1) as recorded, float[..., 2] [m/s].
    :param deviation: sigma of the recorded speeds, float[2] [m/s].
    """
    return -(((predicted - observed) / deviation) ** 2).sum(dim=-1)


class RewardWeights:
    """w_1 (collision), w_2 (goal), w_3 (speed) of (27): fixed, or adapted after every episode by (28).

    (28) multiplies each weight by exp(lambda |mean reward|) and normalises, so a component that is larger on average
    takes over in the end, whatever lambda; lambda only sets how many episodes that takes.
    """

    def __init__(self, config: RefineConfig) -> None:
        self.adaptive = not config.reward_weights
        self._temperature = config.weight_temperature
        self.values: NDArray[np.float64] = np.full(3, 1.0 / 3.0)
        if not self.adaptive:
            self.values = np.array(config.reward_weights) / sum(config.reward_weights)

    def episode(self, components: NDArray[np.float64]) -> None:
        """Take the rewards of one episode, float64[steps, 3] as (collision, goal, speed), into account."""
        if not self.adaptive or len(components) == 0:
            return
        exponent = self._temperature * np.abs(components.mean(axis=0))
        grown = self.values * np.exp(exponent - exponent.max())
        self.values = grown / grown.sum()

    def total(self, components: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return R of (27), float64[...], of components float64[..., 3]."""
        total: NDArray[np.float64] = components @ self.values
        return total
