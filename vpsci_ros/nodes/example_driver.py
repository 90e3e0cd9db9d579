"""The example's driver, without ROS: it keeps a speed, and brakes if it would come near a pedestrian.

`vpsci ads-test --ads-class vpsci_ros.nodes.example_driver:ExampleDriver` examines it as it stands here; `example_ads`
is the same as a program that speaks ROS 2. It needs nothing but Python, so that both files can be copied.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

FRONT, SIDE = 2.35, 0.93  # [m] from the vehicle's centre to its bumper and to its side
RADIUS = 0.3  # [m] of the pedestrian


class Mover(NamedTuple):
    """A road user in the plane: x east, y north, angles counter-clockwise from x."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad] of a pedestrian: of its velocity
    speed: float  # [m/s]
    yaw_rate: float = 0.0  # [rad/s]


@dataclass
class ExampleDriver:
    """A driver of one car; its fields are also parameters of the node `example_ads`."""

    cruise_speed: float = 4.0  # [m/s]
    comfort_acceleration: float = 2.0  # [m/s2]
    braking: float = 3.0  # [m/s2] at least, for a pedestrian
    strongest_braking: float = 8.0  # [m/s2]
    horizon: float = 2.5  # [s]
    margin: float = 0.7  # [m] to keep free around the vehicle

    def reset(self, begin: Any) -> None:
        """Begin an episode; this driver has no memory."""

    def act(self, observation: Any) -> float:
        """Return the acceleration along the car [m/s2]; the world keeps it in its lane."""
        return self.acceleration(observation.vehicle, observation.pedestrians)

    def acceleration(self, vehicle: Mover, pedestrians: Iterable[Mover]) -> float:
        """Return the acceleration [m/s2]: brake if a pedestrian gets within `margin` before `horizon`, else cruise."""
        ahead = max(vehicle.speed, 1.0)  # standing, it looks whether it could set off
        time = min((self.time_to_contact(vehicle, each, ahead) for each in pedestrians), default=math.inf)
        if time < self.horizon:
            firmly = max(self.braking, 0.5 * vehicle.speed / max(time, 0.1))  # to stop just short of it
            return -min(self.strongest_braking, firmly)
        wanted = (self.cruise_speed - vehicle.speed) / 0.5
        return max(-self.comfort_acceleration, min(self.comfort_acceleration, wanted))

    def time_to_contact(self, vehicle: Mover, pedestrian: Mover, speed: float) -> float:
        """Return the time [s] until the pedestrian is within `margin` of the vehicle; infinity beyond `horizon`."""
        x, y, heading, _, turning = vehicle
        px, py, direction, walking, _ = pedestrian
        time, step = 0.0, 0.1  # [s]
        while time < self.horizon:
            forward = math.cos(heading) * (px - x) + math.sin(heading) * (py - y)
            left = math.cos(heading) * (py - y) - math.sin(heading) * (px - x)
            if abs(forward) < FRONT + RADIUS + self.margin and abs(left) < SIDE + RADIUS + self.margin:
                return time
            time, heading = time + step, heading + turning * step
            x, y = x + speed * step * math.cos(heading), y + speed * step * math.sin(heading)
            px, py = px + walking * step * math.cos(direction), py + walking * step * math.sin(direction)
        return math.inf
