"""Kinematics of one vehicle and one pedestrian in torch, for training and evaluation.

(8)-(9) give each agent's next velocity in the vehicle's heading frame of step t; positions follow with the mean of the
velocities before and after. Then the vehicle's heading turns with its velocity, no more sharply than the simulated
Model 3 steers (0.52 rad over a wheelbase of 2.875 m), and the vehicle does not roll backwards.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.safety import curvttc
from vpsci_ros.world.kinematics import SHARPEST_TURN
from vpsci_ros.world.observation import STEP

_TO_THE_RIGHT = torch.tensor([1.0, -1.0])  # of a vector whose components are exchanged: it is turned by 90 degrees
_STANDING = 1e-3  # [m/s] below this the heading does not turn


class Scene(NamedTuple):
    """One vehicle and one pedestrian in each of B scenes, map frame; float32 or float64 throughout."""

    vehicle: Tensor  # [B, 2] [m]
    heading: Tensor  # [B] [rad] of the vehicle
    vehicle_velocity: Tensor  # [B, 2] [m/s]
    curvature: Tensor  # [B] [1/m] of the vehicle's path
    pedestrian: Tensor  # [B, 2] [m]
    pedestrian_velocity: Tensor  # [B, 2] [m/s]

    def rows(self) -> Tensor:
        """Return the scenes as rows of `Interactions.motion`, [B, 9]."""
        vehicle = self.vehicle, self.heading[:, None], self.vehicle_velocity
        return torch.cat([*vehicle, self.pedestrian, self.pedestrian_velocity], dim=1)

    @property
    def finite(self) -> bool:
        """Whether every number of the scenes is finite."""
        return bool(torch.cat([part.detach().flatten() for part in self]).isfinite().all())


def scene_at(motion: Tensor, at: Tensor, tracked_steps: int = 0) -> Scene:
    """Return the scene of step `at`, int64[B], of recorded histories [B, T, 9], rows as in `Interactions.motion`.

    The curvature of the vehicle's path comes from its turn since the step before.

    :param tracked_steps: number of steps before `at`, fewer where there are fewer, whose positions give the vehicle's
        velocity; 0: as recorded. Published vehicle speeds may be smoothed so much that they lag behind the positions,
        and a vehicle whose velocity is published along its heading drifts sideways in a bend.
    """
    rows = torch.arange(len(motion))
    now, before = motion[rows, at], motion[rows, (at - 1).clamp(min=0)]
    velocity = now[:, 3:5] if tracked_steps == 0 else _tracked_velocity(motion, at, tracked_steps)
    turn = (now[:, 2] - before[:, 2]) / STEP
    speed = velocity.norm(dim=1)
    curvature = torch.where(speed > 0.1, turn / speed.clamp(min=0.1), 0.0).clamp(-SHARPEST_TURN, SHARPEST_TURN)
    return Scene(
        vehicle=now[:, :2],
        heading=now[:, 2],
        vehicle_velocity=velocity,
        curvature=curvature,
        pedestrian=now[:, 5:7],
        pedestrian_velocity=now[:, 7:9],
    )


def _tracked_velocity(motion: Tensor, at: Tensor, steps: int) -> Tensor:
    """Return the vehicle's velocity by its positions, [B, 2] [m/s], map frame.

    A correction is added to the recorded velocity: over each of `steps` steps, the velocity by the two positions less
    the mean of the two recorded velocities, averaged. The vehicle neither rolls backwards nor drifts further aside than
    it can steer in a step.
    """
    rows = torch.arange(len(motion))
    now = motion[rows, at]
    total, count = torch.zeros_like(now[:, 3:5]), torch.zeros_like(now[:, :1])
    for age in range(1, steps + 1):
        first, second = motion[rows, (at - age).clamp(min=0)], motion[rows, (at - age + 1).clamp(min=0)]
        gap = (second[:, :2] - first[:, :2]) / STEP - 0.5 * (first[:, 3:5] + second[:, 3:5])
        known = (at >= age)[:, None]
        total, count = total + gap * known, count + known
    forward, left = to_heading_frame(now[:, 3:5] + total / count.clamp(min=1.0), now[:, 2]).unbind(dim=1)
    forward = forward.clamp(min=0.0)
    most = SHARPEST_TURN * STEP * forward**2
    return from_heading_frame(torch.stack([forward, torch.clamp(left, -most, most)], dim=1), now[:, 2])


def observe(scene: Scene) -> tuple[Tensor, Tensor]:
    """Return the observations of both agents, [B, 6] each, equations (6) and (7); as `vpsci_ros.world.observe`."""
    seen = scene.vehicle_velocity, scene.pedestrian_velocity, scene.vehicle - scene.pedestrian
    own, other, distance = to_heading_frame(torch.stack(seen, dim=1), scene.heading[:, None]).unbind(dim=1)
    return torch.cat([own, distance, own - other], dim=1), torch.cat([other, -distance, other - own], dim=1)


def advance(scene: Scene, actions: dict[str, Tensor]) -> Scene:
    """Return the scene one step of 0.1 s later; actions [B, 2] [m/s2] in the vehicle's heading frame, (8)-(9)."""
    velocity = to_heading_frame(scene.vehicle_velocity, scene.heading) + actions["vehicle"] * STEP
    forward = velocity[:, 0].clamp(min=0.0)
    bound = SHARPEST_TURN * STEP * forward
    turn = torch.atan((velocity[:, 1] / forward.clamp(min=_STANDING)).clamp(-bound, bound))
    heading = scene.heading + turn
    speed = forward / torch.cos(turn)
    vehicle_velocity = speed[:, None] * torch.stack([torch.cos(heading), torch.sin(heading)], dim=1)
    pedestrian_velocity = scene.pedestrian_velocity + from_heading_frame(actions["pedestrian"] * STEP, scene.heading)
    return Scene(
        vehicle=scene.vehicle + (scene.vehicle_velocity + vehicle_velocity) * (0.5 * STEP),
        heading=heading,
        vehicle_velocity=vehicle_velocity,
        curvature=(turn / (speed.clamp(min=_STANDING) * STEP)).clamp(-SHARPEST_TURN, SHARPEST_TURN),
        pedestrian=scene.pedestrian + (scene.pedestrian_velocity + pedestrian_velocity) * (0.5 * STEP),
        pedestrian_velocity=pedestrian_velocity,
    )


def time_to_collision(scene: Scene) -> Tensor:
    """Return CurvTTC [s], float64[B], for the vehicle size of the Model 3; no gradient flows through it."""
    arrays: list[NDArray[np.float64]] = [part.detach().double().numpy() for part in scene]
    vehicle, heading, velocity, curvature, pedestrian, walking = arrays
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    place = (vehicle[:, 0], vehicle[:, 1], heading, speed, curvature, pedestrian[:, 0], pedestrian[:, 1])
    return torch.from_numpy(curvttc(*place, walking[:, 0], walking[:, 1]))


def to_heading_frame(vector: Tensor, heading: Tensor) -> Tensor:
    """Return the (forward, left) components [..., 2] of (east, north) vectors [..., 2] for headings [...] [rad].

    `world.observation.to_heading_frame` for tensors: gradients flow through both arguments.
    """
    c, s = torch.cos(heading)[..., None], torch.sin(heading)[..., None]
    return c * vector + s * (vector.flip(-1) * _TO_THE_RIGHT)


def from_heading_frame(vector: Tensor, heading: Tensor) -> Tensor:
    """Return the (east, north) components [..., 2] of (forward, left) vectors [..., 2] for headings [...] [rad]."""
    c, s = torch.cos(heading)[..., None], torch.sin(heading)[..., None]
    return c * vector - s * (vector.flip(-1) * _TO_THE_RIGHT)
