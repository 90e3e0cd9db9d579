"""The rule-based driver: keeps its lane and its speed, and brakes for the nearest pedestrian straight ahead.

It drives until an episode is critical, and with `walker` whole episodes as the baseline of sections 4.5 and 4.6 of the
paper ("CARLA default"). It brakes when a pedestrian is within a fixed distance straight ahead, whatever the speeds:
fully with the spawn `paper`, and as firmly as speed and distance require with `right_turns` and `human`. With these two
it drives by `approach`; an episode of `right_turns` follows the recorded car until the onset.
"""

import math

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import kinematics
from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.lane_driving import speed_acceleration
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.spawns import as_recorded
from vpsci_ros.world.spawns.approach import drive_then, drivers_acceleration, onset_time

_HALF_LENGTH = 0.5 * VEHICLE_LENGTH
_STRAIGHT_AHEAD = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS + 0.25  # [m] to either side


@kernel
def gap_ahead(state, first, count, proximity_distance):  # type: ignore[no-untyped-def]
    """Return the distance [m] from the vehicle's front to the nearest pedestrian that is `too_near`; infinity: none.

    The `count` pedestrians of one episode are those in the rows of EPISODE[B] from `first` on. The distance is that of
    a pedestrian's centre, and below 0 beside the front half of the vehicle.
    """
    gap = math.inf
    for i in range(first, first + count):
        episode = state[i]
        dx, dy = episode.pedestrian_x - episode.vehicle_x, episode.pedestrian_y - episode.vehicle_y
        forward, left = to_heading_frame(episode.vehicle_heading, dx, dy)
        if too_near(forward, left, _HALF_LENGTH, _STRAIGHT_AHEAD, proximity_distance):
            gap = min(gap, forward - _HALF_LENGTH)
    return gap


@inlined
def vehicle(state, i, count, keeping, _answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) for the next tick of the vehicle in the `count` rows from `i` on.

    :param keeping: curvature [1/m] that keeps the lane.
    """
    episode = state[i]
    speed, row = episode.vehicle_speed, tables.rows[episode.table]
    gap = gap_ahead(state, i, count, settings.proximity_distance)
    steer = kinematics.steer_to(keeping)
    if episode.driver_onset and (gap == math.inf or episode.pedestrians == 1):
        onset, then = tables.onsets[episode.driver_onset - 1], (episode.frame + 1) * settings.period
        if then < onset_time(onset) + 0.5 * settings.period:
            next_speed, curvature = drive_then(onset, then)
            along = (episode.approach_pace * next_speed - speed) / settings.period
            return kinematics.steer_to(curvature), kinematics.throttle_for(along), kinematics.brake_for(along)
    if as_recorded(settings.spawn, episode):
        along = drivers_acceleration(episode, row, tables, gap, settings.period)
        return steer, kinematics.throttle_for(along), kinematics.brake_for(along)
    if gap < math.inf:
        return steer, 0.0, 1.0
    sample = min(max(int(episode.route_s / row.lane_step), 0), row.lane_count - 1)
    wanted = min(episode.cruise_throttle * row.full_throttle_speed, tables.lane_speed[episode.table, sample])
    along = speed_acceleration(speed, wanted)
    return steer, kinematics.throttle_for(along), kinematics.brake_for(along)


@kernel
def too_near(forward: float, left: float, half_length: float, reach: float, distance: float) -> bool:
    """Whether a pedestrian at (forward, left) [m] of the vehicle's centre is less than `distance` [m] before its front.

    Only pedestrians straight ahead count: ahead of the vehicle's centre, and within `reach` [m] of its centre line.
    """
    return 0.0 < forward < half_length + distance and abs(left) < reach
