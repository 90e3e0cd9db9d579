"""The external drivers: vehicle or pedestrian moves by commands from outside the world."""

from vpsci_ros.world import kinematics
from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.observation import from_heading_frame
from vpsci_ros.world.spawns import gain_of


@inlined
def vehicle(episode, along, left, keeping, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) for an acceleration in the heading frame [m/s2].

    :param keeping: curvature [1/m] that keeps the lane, which is added where `lane_following` is on.
    """
    speed = episode.vehicle_speed
    if settings.lane_following:
        left += keeping * speed * speed
    return kinematics.steer_for(left, speed), kinematics.throttle_for(along), kinematics.brake_for(along)


@inlined
def pedestrian(episode, along, left, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2], map frame: a command (vehicle's heading frame), times the gain."""
    ax, ay = from_heading_frame(episode.vehicle_heading, along, left)
    gain = gain_of(settings, episode)
    return gain * ax, gain * ay
