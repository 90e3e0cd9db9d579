"""The policy drivers: an agent moves by its policy's last action, held until the next policy frame."""

from vpsci_ros.world import kinematics
from vpsci_ros.world.calibration import limited
from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.observation import from_heading_frame
from vpsci_ros.world.spawns import as_recorded, gain_of, keeps_lane


@inlined
def vehicle(state, i, _count, keeping, _answers, _tables, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) of the vehicle's policy; `keeping` [1/m] is the curvature that keeps the lane."""
    episode = state[i]
    speed, along, left = episode.vehicle_speed, episode.vehicle_long, episode.vehicle_lat
    if keeps_lane(settings, episode):
        left += keeping * speed * speed
    if as_recorded(settings.spawn, episode):
        along = limited(along, episode.vehicle_acceleration, settings.period)
        left = limited(left, episode.vehicle_curvature * speed * speed, settings.period)
    return kinematics.steer_for(left, speed), kinematics.throttle_for(along), kinematics.brake_for(along)


@inlined
def pedestrian(episode, _i, _answers, _tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] of the pedestrian's policy, map frame, and whether to limit its jerk."""
    ax, ay = from_heading_frame(episode.action_heading, episode.pedestrian_long, episode.pedestrian_lat)
    gain = gain_of(settings, episode)
    return gain * ax, gain * ay, as_recorded(settings.spawn, episode)
