"""A CARLA server: all calls of CARLA's client that need a server, except those of the actors.

Written from the documentation of CARLA's client 0.9.15 and 0.9.16, and tested with a stand-in of the client's objects:
no server was at hand.
"""

import contextlib
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from vpsci_ros.cosim import Vehicle, Walker
from vpsci_ros.errors import InvalidInput, VpsciError, packages_of
from vpsci_ros.extras.carla.actors import vehicle_control, vehicle_of, vehicle_transform, walker_control, walker_of
from vpsci_ros.world.kinematics import MAX_STEERING_ANGLE

HOST, PORT = "127.0.0.1", 2000  # where a CARLA server listens unless it is told otherwise
EXAMPLE = "carla://127.0.0.1:2000/Town10HD_Opt"
PATIENCE = 20.0  # [s] for an answer of the server; loading a map takes the longest
LIFT = 0.3  # [m] above the road at which a vehicle is put, so that its wheels do not touch it
WAIST = 1.0  # [m] above the ground, of the middle of a walker's capsule
CAR, WALKER = "vehicle.tesla.model3", "walker.pedestrian.0001"


class Controls(NamedTuple):
    """The vehicle's controls at a tick: steer -1 (right) to 1 (left), throttle and brake 0 to 1."""

    steer: float
    throttle: float
    brake: float


class LiveServer:
    """A CARLA server, in synchronous mode until `close`; places and velocities have x east and y north.

    :param address: HOST:PORT/MAP, each of which may be left out; MAP is loaded, else the server keeps the one it has.
    :param period: of a tick [s].
    :param connect: what makes a client of host and port; None: `carla.Client`.
    :raises VpsciError: the client is not installed, or no server answers.
    :raises InvalidInput: PORT is not a number.
    """

    def __init__(self, address: str, period: float, connect: Callable[[str, int], Any] | None = None) -> None:
        try:
            import carla
        except ModuleNotFoundError:
            raise VpsciError(
                f"engine = carla needs CARLA's client in the server's version: pip install {packages_of('carla')}"
            ) from None
        self._carla, self._actors = carla, list[Any]()
        host, _, loaded = address.partition("/")
        name, _, port = host.partition(":")
        if port and not port.isdecimal():
            raise InvalidInput(f"engine = carla://{address}: expected carla://HOST:PORT/MAP, such as {EXAMPLE}")
        where = name or HOST, int(port or PORT)
        try:
            client = (connect or carla.Client)(*where)
            client.set_timeout(PATIENCE)
            self._world = client.load_world(loaded) if loaded else client.get_world()
        except RuntimeError as error:
            raise VpsciError(f"CARLA at {where[0]}:{where[1]}: {error}; is the server on?") from None
        self._found = self._world.get_settings()
        settings = self._world.get_settings()
        settings.synchronous_mode, settings.fixed_delta_seconds = True, period
        self._world.apply_settings(settings)
        self._map = self._world.get_map()

    def place(self, vehicle: Vehicle, walker: Walker | None) -> None:
        """Place both agents for the start of an episode, None: no pedestrian; the first call spawns them.

        :raises VpsciError: the map has no road there, or something stands there.
        """
        height = self._height(vehicle.x, vehicle.y)
        if not self._actors:
            self._spawn(CAR, vehicle_transform(vehicle, self._carla.Location(), height + LIFT))
            self._limit_steering()
        car = self._actors[0]
        car.set_transform(vehicle_transform(vehicle, car.bounding_box.location, height + LIFT))
        c, s = math.cos(vehicle.heading), math.sin(vehicle.heading)
        car.set_target_velocity(self._carla.Vector3D(vehicle.speed * c, -vehicle.speed * s, 0.0))
        car.set_target_angular_velocity(self._carla.Vector3D())
        if walker is not None:
            person = self._carla.Transform(self._carla.Location(walker.x, -walker.y, height + WAIST))
            if len(self._actors) == 1:
                self._spawn(WALKER, person)
            self._actors[1].set_transform(person)
            self._actors[1].apply_control(walker_control(walker.vx, walker.vy))
        elif len(self._actors) == 2:
            self._actors.pop().destroy()

    def tick(self, controls: Controls, walker: Walker) -> tuple[Vehicle, Walker | None]:
        """Apply both controls, advance by one tick, and return both states.

        :param walker: the pedestrian's wanted state at the end of the tick; ignored in an episode without pedestrian.
        :raises VpsciError: the server does not answer.
        """
        car, *people = self._actors
        car.apply_control(vehicle_control(*controls))
        for actor in people:
            actor.apply_control(walker_control(walker.vx, walker.vy))
        try:
            self._world.tick()
        except RuntimeError as error:
            raise VpsciError(f"the CARLA server does not answer: {error}") from None
        return vehicle_of(car), walker_of(people[0]) if people else None

    def close(self) -> None:
        """Destroy the actors and restore the world's settings; without effect if the server is gone."""
        with contextlib.suppress(RuntimeError):
            while self._actors:
                self._actors.pop().destroy()
            self._world.apply_settings(self._found)

    def _spawn(self, kind: str, transform: Any) -> None:
        blueprint = self._world.get_blueprint_library().find(kind)
        actor = self._world.try_spawn_actor(blueprint, transform)
        if actor is None:
            raise VpsciError(
                f"the CARLA server cannot spawn {kind} at {transform.location}; does something stand there?"
            )
        self._actors.append(actor)

    def _limit_steering(self) -> None:
        """Limit the front wheels to the angle of steer 1 in this package's world (CARLA's own limit is 70 degrees)."""
        physics = self._actors[0].get_physics_control()
        wheels = physics.wheels
        for wheel in wheels[:2]:
            wheel.max_steer_angle = math.degrees(MAX_STEERING_ANGLE)
        physics.wheels = wheels
        self._actors[0].apply_physics_control(physics)

    def _height(self, x: float, y: float) -> float:
        """Return the height of the road at x east, y north [m].

        :raises VpsciError: no road is within 5 m.
        """
        waypoint = self._map.get_waypoint(self._carla.Location(x, -y, 0.0))
        location = None if waypoint is None else waypoint.transform.location
        if location is None or math.hypot(location.x - x, location.y + y) > 5.0:
            raise VpsciError(
                f"{self._map.name}: no road within 5 m of ({x:.1f}, {y:.1f}) (CARLA's y is {-y:.1f}); the eight "
                f"scenarios lie in Town10HD: set engine to {EXAMPLE}"
            )
        return float(location.z)
