"""Vehicles that keep to their lanes whatever their lateral actions, as the simulated one does, (18)-(24)."""

import torch
from torch import Tensor

from vpsci_ros.kinematics.scene import Scene, from_heading_frame
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION
from vpsci_ros.world.observation import LANE_GRID, STEP


class OnLane:
    """The kinematics of B scenes on lanes; each begins at the origin, in the heading frame of its vehicle.

    :param lane: direction ahead of each vehicle every `LANE_GRID` metres, [B, N] [rad].
    :param speed: of the vehicles, [B] [m/s].
    :param pedestrian, walking: position [B, 2] [m] and velocity [B, 2] [m/s].
    :param gain: share of the pedestrian's acceleration that becomes motion.
    :ivar speed: of the vehicles now, [B] [m/s].
    """

    def __init__(self, lane: Tensor, speed: Tensor, pedestrian: Tensor, walking: Tensor, gain: float) -> None:
        self._lane, self._gain, self.speed = lane, gain, speed
        self._driven = torch.zeros(len(speed))
        still = torch.zeros(len(speed))
        self.start = self._scene(torch.stack([still, still], dim=1), pedestrian, walking)

    def advance(self, scene: Scene, actions: dict[str, Tensor]) -> Scene:
        """Return the scene one step of 0.1 s later; actions [B, 2] [m/s2] in the vehicle's heading frame."""
        along = actions["vehicle"][:, 0].clamp(-MAX_DECELERATION, MAX_ACCELERATION)
        faster = (self.speed + along * STEP).clamp(min=0.0)
        way = 0.5 * (self.speed + faster) * STEP
        pushed = from_heading_frame(actions["pedestrian"], scene.heading) * (self._gain * STEP)
        vehicle = scene.vehicle + way[:, None] * self._ahead
        self._driven, self.speed = self._driven + way, faster
        pedestrian = scene.pedestrian + (scene.pedestrian_velocity + 0.75 * pushed) * STEP
        return self._scene(vehicle, pedestrian, scene.pedestrian_velocity + pushed)

    def _scene(self, vehicle: Tensor, pedestrian: Tensor, walking: Tensor) -> Scene:
        heading, bend = _direction(self._lane, self._driven)
        self._ahead = torch.stack([torch.cos(heading), torch.sin(heading)], dim=1)
        return Scene(vehicle, heading, self.speed[:, None] * self._ahead, bend, pedestrian, walking)


def _direction(lane: Tensor, driven: Tensor) -> tuple[Tensor, Tensor]:
    """Return direction [B] [rad] and curvature [B] [1/m] of `lane` [B, N] after `driven` [B] metres."""
    place = (driven / LANE_GRID).clamp(0.0, lane.shape[1] - 1.001)
    node = place.detach().floor().long()
    low, high = (lane.gather(1, (node + k)[:, None])[:, 0] for k in (0, 1))
    return low + (high - low) * (place - node), (high - low) / LANE_GRID
