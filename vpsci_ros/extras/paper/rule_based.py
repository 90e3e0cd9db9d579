"""The rule-based pair from recorded onsets: a pedestrian of the social force model, and a car that brakes for it."""

import numpy as np
import torch
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets
from vpsci_ros.evaluation.predictors import TRACKED_STEPS
from vpsci_ros.evaluation.roll_out import Seen, roll_out
from vpsci_ros.evaluation.scene import scene_at
from vpsci_ros.evaluation.simulators import curvatures, exchange, positions_of
from vpsci_ros.safety import PEDESTRIAN_RADIUS
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.drivers.autopilot import too_near
from vpsci_ros.world.drivers.social_force import social_force
from vpsci_ros.world.kinematics import MAX_DECELERATION
from vpsci_ros.world.observation import AGENTS, to_heading_frame

Floats = NDArray[np.float64]
_STRAIGHT_AHEAD = 0.25  # [m] beside the footprints in which the autopilot brakes, as in the world


def rule_based(onsets: Onsets, *, reacting: bool = True, turning: bool = False) -> Floats:
    """Return positions, float64[n, 1, 2, 30, 2] [m], of a social force pedestrian and a braking car.

    The pedestrian wants the velocity of the onset. The vehicle keeps its direction and tracked speed, and brakes fully
    for a pedestrian near and straight ahead of its front. Both move by `roll_out`'s kinematics.

    :param reacting: False: the pedestrian keeps its velocity, as CARLA's walkers do.
    :param turning: the vehicle goes on turning as it did over the last 0.5 s, by at most 90 degrees.
    """
    motion, count = torch.from_numpy(onsets.interactions.motion), len(onsets)
    start = scene_at(motion, torch.from_numpy(onsets.interactions.first), TRACKED_STEPS)
    bend = curvatures(onsets) if turning else np.zeros(count)
    near, wanted = WorldConfig().proximity_distance, start.pedestrian_velocity.numpy()
    half, straight, exchanged = 0.5 * onsets.size, start.heading.numpy(), exchange(onsets)

    def act(seen: Seen) -> dict[str, torch.Tensor]:
        out = {agent: np.zeros((count, 2)) for agent in AGENTS}
        for i, row in enumerate(seen.scene.rows().numpy().tolist()):
            x, y, heading, east, north, px, py, vx, vy = row
            ahead = to_heading_frame(heading, px - x, py - y)
            if too_near(*ahead, half[i, 0], half[i, 1] + PEDESTRIAN_RADIUS + _STRAIGHT_AHEAD, near):
                out["vehicle"][i, 0] = -MAX_DECELERATION
            if abs(heading - straight[i]) < 0.5 * np.pi:
                out["vehicle"][i, 1] = bend[i] * (east * east + north * north)
            if reacting:
                push = social_force(*wanted[i], vx, vy, px, py, x, y, heading, *half[i], PEDESTRIAN_RADIUS)
                out["pedestrian"][i] = to_heading_frame(heading, *push)
        done = exchanged(seen, (out["vehicle"], out["pedestrian"]))
        return {agent: torch.from_numpy(np.asarray(action, float)) for agent, action in zip(AGENTS, done, strict=True)}

    return positions_of(np.stack([scene.rows().numpy() for scene in roll_out(start, act, [count] * STEPS)], axis=1))
