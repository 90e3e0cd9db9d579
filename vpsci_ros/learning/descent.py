"""The actors' optimiser in stage 1: AdamW, its step size rising over the first iterations, then falling by a cosine."""

import math
from typing import Any

import torch
from torch import Tensor

from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.policy.actor import Actors

RISE = 20  # iterations until the step size is at its peak
WEIGHT_DECAY = 0.05  # decoupled, of the actors' matrices


class Descent:
    """The actors' optimiser.

    :param groups: parameters of the actors with their `weight_decay`, and the `factor` on their step size.
    """

    def __init__(self, actors: Actors, groups: list[dict[str, Any]], config: PretrainConfig) -> None:
        self._actors, self._config = actors, config
        self.optimiser = torch.optim.AdamW(groups, lr=config.imitation.learning_rate)

    def step(self, loss: Tensor, iteration: int) -> float:
        """Take one step down the gradient of `loss`, and return the gradient's norm; `iteration` counts from 0."""
        rise = min(1.0, (iteration + 1) / RISE) * 0.5 * (1.0 + math.cos(math.pi * iteration / self._config.episodes))
        for group in self.optimiser.param_groups:
            group["lr"] = self._config.imitation.learning_rate * group["factor"] * rise
        self.optimiser.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self._actors.parameters(), self._config.updates.gradient_clip)
        self.optimiser.step()
        return float(norm)
