"""A stand-in of a CARLA server: the calls that the package makes, on the client's own types, with a car of its own.

Its car accelerates by three quarters of what ours does, and turns by a bicycle of its own; its walker takes up a speed
at once. All of it is in CARLA's frame: y to the south, degrees clockwise.
"""

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import carla

WHEELBASE, PULL, BRAKES = 2.9, 7.0, 8.0  # [m], [m/s2]
AHEAD = 0.2  # [m] of the middle of the car's box before its origin


@dataclass
class StandInActor:
    """A vehicle or a walker, which moves by the control that it was given last."""

    id: int
    kind: str
    transform: Any
    alive: bool = True
    velocity: Any = field(default_factory=carla.Vector3D)
    turning: float = 0.0  # [deg/s]
    control: Any = None
    wheels: list[Any] = field(default_factory=lambda: [SimpleNamespace(max_steer_angle=70.0) for _ in range(4)])

    @property
    def bounding_box(self) -> Any:
        return carla.BoundingBox(carla.Location(x=AHEAD), carla.Vector3D(2.4, 0.95, 0.7))

    def get_transform(self) -> Any:
        return self.transform

    def set_transform(self, transform: Any) -> None:
        self.transform = transform

    def get_velocity(self) -> Any:
        return self.velocity

    def set_target_velocity(self, velocity: Any) -> None:
        self.velocity = velocity

    def get_angular_velocity(self) -> Any:
        return carla.Vector3D(z=self.turning)

    def set_target_angular_velocity(self, velocity: Any) -> None:
        self.turning = velocity.z

    def get_acceleration(self) -> Any:
        return carla.Vector3D()

    def get_physics_control(self) -> Any:
        return SimpleNamespace(wheels=self.wheels)

    def apply_physics_control(self, physics: Any) -> None:
        self.wheels = physics.wheels

    def apply_control(self, control: Any) -> None:
        self.control = control

    def destroy(self) -> None:
        self.alive = False

    def move(self, period: float) -> None:
        yaw = math.radians(self.transform.rotation.yaw)
        if self.kind.startswith("vehicle"):
            speed = math.hypot(self.velocity.x, self.velocity.y)
            change = self.control.throttle * PULL - self.control.brake * BRAKES
            speed = max(0.0, speed + change * period)
            turning = speed / WHEELBASE * math.tan(self.control.steer * math.radians(self.wheels[0].max_steer_angle))
            yaw += turning * period
            self.turning = math.degrees(turning)
            self.velocity = carla.Vector3D(speed * math.cos(yaw), speed * math.sin(yaw), 0.0)
        else:
            way, speed = self.control.direction, self.control.speed
            self.velocity = carla.Vector3D(speed * way.x, speed * way.y, 0.0)
        place = self.transform.location
        there = carla.Location(place.x + self.velocity.x * period, place.y + self.velocity.y * period, place.z)
        self.transform = carla.Transform(there, carla.Rotation(yaw=math.degrees(yaw)))


class StandInServer:
    """What `carla.Client` returns, and the world in it."""

    def __init__(self, opendrive: str = "") -> None:
        self.actors: list[StandInActor] = []
        self.settings = carla.WorldSettings()
        self.map = carla.Map("StandIn", opendrive) if opendrive else None
        self.loaded = ""

    def set_timeout(self, seconds: float) -> None:
        assert seconds > 0.0

    def get_world(self) -> "StandInServer":
        return self

    def load_world(self, name: str) -> "StandInServer":
        self.loaded = name
        return self

    def get_settings(self) -> Any:
        copy = carla.WorldSettings()
        for name in ("synchronous_mode", "fixed_delta_seconds"):
            setattr(copy, name, getattr(self.settings, name))
        return copy

    def apply_settings(self, settings: Any) -> None:
        self.settings = settings

    def get_map(self) -> Any:
        return self.map

    def get_blueprint_library(self) -> Any:
        return SimpleNamespace(find=lambda kind: kind)

    def try_spawn_actor(self, kind: str, transform: Any) -> StandInActor | None:
        self.actors.append(StandInActor(100 + len(self.actors), kind, transform))
        return self.actors[-1]

    def tick(self) -> None:
        assert self.settings.synchronous_mode
        for actor in self.actors:
            actor.move(self.settings.fixed_delta_seconds)
