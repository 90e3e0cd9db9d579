"""Conversion of CARLA's actors: CARLA's frame is left-handed, y to the south, degrees clockwise from x, z up.

An actor's location is the origin of its model; this package's place of an agent is the centre of its bounding box.
"""

import math
from typing import Any

from vpsci_ros.cosim import Vehicle, Walker

STANDING = 0.1  # [m/s] below which a yaw rate says nothing of a curvature


def vehicle_of(actor: Any) -> Vehicle:
    """Return the state of a carla.Vehicle: centre of its box, x east, y north, heading counter-clockwise from x."""
    place, box = actor.get_transform(), actor.bounding_box
    heading = -math.radians(place.rotation.yaw)
    c, s = math.cos(heading), math.sin(heading)
    ahead, left = box.location.x, -box.location.y
    velocity, push = actor.get_velocity(), actor.get_acceleration()
    speed = c * velocity.x - s * velocity.y
    yaw_rate = -math.radians(actor.get_angular_velocity().z)
    return Vehicle(
        x=place.location.x + c * ahead - s * left,
        y=-place.location.y + s * ahead + c * left,
        heading=heading,
        speed=speed,
        curvature=yaw_rate / speed if abs(speed) > STANDING else 0.0,
        acceleration=c * push.x - s * push.y,
        length=2.0 * box.extent.x,
        width=2.0 * box.extent.y,
    )


def walker_of(actor: Any) -> Walker:
    """Return the present place [m] of a carla.Walker and velocity [m/s], x east, y north."""
    location, velocity = actor.get_transform().location, actor.get_velocity()
    return Walker(location.x, -location.y, velocity.x, -velocity.y)


def vehicle_transform(vehicle: Vehicle, centre: Any, height: float) -> Any:
    """Return the carla.Transform at which the box of a CARLA vehicle has the place and heading of `vehicle`.

    :param centre: carla.Location of its box in its own frame [m].
    :param height: z of the actor [m].
    """
    import carla

    c, s = math.cos(vehicle.heading), math.sin(vehicle.heading)
    x, y = vehicle.x - c * centre.x - s * centre.y, vehicle.y - s * centre.x + c * centre.y
    return carla.Transform(carla.Location(x, -y, height), carla.Rotation(yaw=-math.degrees(vehicle.heading)))


def walker_control(vx: float, vy: float) -> Any:
    """Return the carla.WalkerControl that walks with a velocity [m/s], x east, y north."""
    import carla

    speed = math.hypot(vx, vy)
    if speed == 0.0:
        return carla.WalkerControl(speed=0.0)
    return carla.WalkerControl(carla.Vector3D(vx / speed, -vy / speed, 0.0), speed)


def vehicle_control(steer: float, throttle: float, brake: float) -> Any:
    """Return a carla.VehicleControl; the given `steer`, -1 to 1, is positive to the left, CARLA's to the right."""
    import carla

    return carla.VehicleControl(throttle=throttle, steer=-steer, brake=brake)
