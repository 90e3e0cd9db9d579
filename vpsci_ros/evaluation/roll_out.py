"""The roll-out: policies observe and act, and known kinematics move the agents, in training and in evaluation.

Three inputs are independent: the start, the agents (any function of `Seen`), and the number of scenes that still move
at each step.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from vpsci_ros.evaluation.scene import Scene, advance, observe, time_to_collision
from vpsci_ros.world.observation import AGENTS

Actions = dict[str, Tensor]
"""Agent -> accelerations [B, 2] [m/s2], in the vehicle's heading frame."""


class Seen(NamedTuple):
    """Observations of both agents at a step of a roll-out of B scenes."""

    step: int
    scene: Scene
    observation: dict[str, Tensor]  # agent -> [B, 6], (6) and (7)
    curvttc: Tensor  # float64[B] [s]


def roll_out(start: Scene, act: Callable[[Seen], Actions], moving: Sequence[int]) -> Iterator[Scene]:
    """Yield the scene after each step of 0.1 s; after a value that is not finite, yield NaN once and stop.

    :param start: B scenes.
    :param act: returns both agents' accelerations.
    :param moving: for each step, the number of scenes that take it: the first ones, never more than the step before.
    """
    scene = start
    for step, count in enumerate(moving):
        scene = Scene(*(part[:count] for part in scene))
        seen = Seen(step, scene, dict(zip(AGENTS, observe(scene), strict=True)), time_to_collision(scene))
        scene = advance(scene, act(seen))
        if not scene.finite:
            yield Scene(*(part * torch.nan for part in scene))
            return
        yield scene
