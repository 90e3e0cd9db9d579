"""The external drivers: vehicle or pedestrian moves by commands from outside the world."""

from vpsci_ros.world import kinematics
from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.observation import from_heading_frame
from vpsci_ros.world.spawns import gain_of


@inlined
def vehicle(state, i, _count, keeping, answers, _tables, settings):  # type: ignore[no-untyped-def]
    """Return the command (steer, throttle, brake), or that for a commanded acceleration in the heading frame [m/s2].

    :param keeping: curvature [1/m] that keeps the lane, which is added to the latter where `lane_following` is on.
    """
    if len(answers.vehicle_control):
        control = answers.vehicle_control
        return control[i, 0], control[i, 1], control[i, 2]
    along, left = answers.vehicle_action[i, 0], answers.vehicle_action[i, 1]
    speed = state[i].vehicle_speed
    if settings.lane_following:
        left += keeping * speed * speed
    return kinematics.steer_for(left, speed), kinematics.throttle_for(along), kinematics.brake_for(along)


@inlined
def pedestrian(episode, i, answers, _tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2], map frame: a command (vehicle's heading frame) times the gain; False."""
    along, left = answers.pedestrian_action[i, 0], answers.pedestrian_action[i, 1]
    ax, ay = from_heading_frame(episode.vehicle_heading, along, left)
    gain = gain_of(settings, episode)
    return gain * ax, gain * ay, False
