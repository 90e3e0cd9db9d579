"""Who drives, in compiled code: what each driver makes of a record, and the motion that follows from it.

Vehicle and pedestrians are decided on the same frame: call `acceleration` and `controls` before any of them is moved.
The rule-based driver minds all pedestrians of its episode, so it brakes for the nearest of them.
"""

import math

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import kinematics as motion
from vpsci_ros.world.approach import (
    drive_then,
    drivers_acceleration,
    lane_sway,
    line_offset,
    onset_time,
    step_towards,
    walker_speed,
    walks_then,
)
from vpsci_ros.world.autopilot import (
    WALK_ACCELERATION,
    WALK_LOOK_AHEAD,
    pursuit_curvature,
    social_force,
    speed_acceleration,
    too_near,
    walk_acceleration,
    walk_velocity,
)
from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.config import PEDESTRIAN_DRIVERS, VEHICLE_DRIVERS
from vpsci_ros.world.crowd import TOP_SPEED
from vpsci_ros.world.observation import from_heading_frame, to_heading_frame
from vpsci_ros.world.people import limited

POLICY, EXTERNAL, REPLAY = (VEHICLE_DRIVERS.index(name) for name in ("policy", "external", "replay"))
CONSTANT_VELOCITY = PEDESTRIAN_DRIVERS.index("constant_velocity")
SOCIAL_FORCE = PEDESTRIAN_DRIVERS.index("social_force")
RUNNING_SPEED = 5.0  # [m/s] that a pedestrian does not exceed: above the 4 m/s of the paper's fastest walkers
EXTERNAL_GAIN = 0.5  # share of an external pedestrian's acceleration that becomes motion, (21)-(24)
_HALF_LENGTH, _HALF_WIDTH = 0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH
_STRAIGHT_AHEAD = _HALF_WIDTH + PEDESTRIAN_RADIUS + 0.25  # [m] to either side, for the autopilot


@kernel
def gap_ahead(state, first, count, proximity_distance):  # type: ignore[no-untyped-def]
    """Return how far before the vehicle's front [m] the nearest pedestrian straight ahead is; infinity: none is near.

    Of those in rows `first` to `first + count` of EPISODE[B], all of one episode.
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
def controls(state, i, count, answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) for the next tick, by the driver of the vehicle in rows `i` to `i + count`."""
    episode = state[i]
    speed = episode.vehicle_speed
    if settings.vehicle_driver == EXTERNAL and len(answers.vehicle_control):
        control = answers.vehicle_control
        return control[i, 0], control[i, 1], control[i, 2]
    row = tables.rows[episode.table]
    lane, place = (tables.lane, episode.table, row.lane_count, row.lane_step), (episode.vehicle_x, episode.vehicle_y)
    aside = lane_sway(episode) if settings.human else 0.0
    keeping = pursuit_curvature(*lane, episode.route_s, aside, *place, episode.vehicle_heading, speed)
    by_policy = settings.vehicle_driver == POLICY and episode.vehicle_held
    if by_policy or (settings.vehicle_driver == EXTERNAL and len(answers.vehicle_action)):
        if by_policy:
            along, left = episode.vehicle_long, episode.vehicle_lat
        else:
            along, left = answers.vehicle_action[i, 0], answers.vehicle_action[i, 1]
        if settings.lane_following:
            left += keeping * speed * speed
        if by_policy and settings.human:
            along = limited(along, episode.vehicle_acceleration, settings.period)
            left = limited(left, episode.vehicle_curvature * speed * speed, settings.period)
        return motion.steer_for(left, speed), motion.throttle_for(along), motion.brake_for(along)
    gap = gap_ahead(state, i, count, settings.proximity_distance)
    steer = motion.steer_to(keeping)
    if episode.driver_onset and (gap == math.inf or episode.pedestrians == 1):
        onset, then = tables.onsets[episode.driver_onset - 1], (episode.frame + 1) * settings.period
        if then < onset_time(onset) + 0.5 * settings.period:
            next_speed, curvature = drive_then(onset, then)
            along = (episode.approach_pace * next_speed - speed) / settings.period
            return motion.steer_to(curvature), motion.throttle_for(along), motion.brake_for(along)
    if settings.human:
        along = drivers_acceleration(episode, row, tables, gap, settings.period)
        return steer, motion.throttle_for(along), motion.brake_for(along)
    if gap < math.inf:
        return steer, 0.0, 1.0
    sample = min(max(int(episode.route_s / row.lane_step), 0), row.lane_count - 1)
    wanted = min(episode.cruise_throttle * row.full_throttle_speed, tables.lane_speed[episode.table, sample])
    along = speed_acceleration(speed, wanted)
    return steer, motion.throttle_for(along), motion.brake_for(along)


@inlined
def move_vehicle(episode, steer, throttle, brake, period):  # type: ignore[no-untyped-def]
    """Move the vehicle through one tick with these controls, clipped to what they can be."""
    steer = min(1.0, max(-1.0, steer))
    throttle, brake = min(1.0, max(0.0, throttle)), min(1.0, max(0.0, brake))
    speed = episode.vehicle_speed
    place = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
    x, y, heading, next_speed, distance = motion.drive(*place, speed, steer, throttle, brake, period)
    episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.vehicle_speed = x, y, heading, next_speed
    episode.vehicle_acceleration = (next_speed - speed) / period
    if distance > 0.0:
        episode.vehicle_curvature = motion.curvature_of(steer)
    episode.steer, episode.throttle, episode.brake = steer, throttle, brake
    episode.vehicle_path += distance


@inlined
def replay_vehicle(episode, recordings, period):  # type: ignore[no-untyped-def]
    """Put the vehicle where its recording has it next; beyond the recording it goes on straight."""
    frame = episode.frame + 1
    if frame >= recordings.frames[episode.recording]:
        move_vehicle(episode, 0.0, 0.0, 0.0, period)
        return
    x, y, heading, speed, curvature = recordings.vehicle[episode.recording, frame]
    episode.vehicle_path += math.sqrt((x - episode.vehicle_x) ** 2 + (y - episode.vehicle_y) ** 2)
    episode.vehicle_acceleration = (speed - episode.vehicle_speed) / period
    episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading = x, y, heading
    episode.vehicle_speed, episode.vehicle_curvature = speed, curvature


@inlined
def acceleration(episode, i, answers, tables, settings, pushes):  # type: ignore[no-untyped-def]
    """Return the pedestrian's acceleration (ax, ay) [m/s2] in the world's frame, with the gain of (21)-(24) in it.

    What the others of its episode push it, `pushes` [B, 2] [m/s2], is added to whatever moves it.
    """
    ax, ay, smooth = _intended(episode, i, answers, tables, settings)
    if episode.pedestrians > 1:
        ax, ay = ax + pushes[i, 0], ay + pushes[i, 1]
    if smooth:
        ax, ay = step_towards(episode, ax, ay, settings.period)
    return ax, ay


@inlined
def _intended(episode, i, answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] that the pedestrian intends, and whether it keeps to its jerk."""
    driver = settings.pedestrian_driver
    if driver == EXTERNAL and len(answers.pedestrian_action):
        action = answers.pedestrian_action
        ax, ay = from_heading_frame(episode.vehicle_heading, action[i, 0], action[i, 1])
        return EXTERNAL_GAIN * ax, EXTERNAL_GAIN * ay, False
    if driver == POLICY and episode.pedestrian_held:
        ax, ay = from_heading_frame(episode.action_heading, episode.pedestrian_long, episode.pedestrian_lat)
        return settings.pedestrian_gain * ax, settings.pedestrian_gain * ay, settings.human
    vx, vy = episode.pedestrian_vx, episode.pedestrian_vy
    waiting = episode.frame * settings.period < episode.start_delay
    if driver == CONSTANT_VELOCITY and (waiting or vx != 0.0 or vy != 0.0):
        return 0.0, 0.0, False
    row = tables.rows[episode.table]
    pace, offset = episode.walking_speed, episode.pedestrian_offset
    if settings.human:
        if driver != CONSTANT_VELOCITY:
            pace = walker_speed(episode, episode.frame * settings.period)
        offset = line_offset(episode, row, episode.pedestrian_s + WALK_LOOK_AHEAD)
    route, place = (
        (tables.walk, episode.table, row.walk_count, row.walk_step),
        (episode.pedestrian_x, episode.pedestrian_y),
    )
    pace = 0.0 if waiting or (episode.pedestrian_goal and not settings.walk_on) else pace
    wanted_x, wanted_y = walk_velocity(*route, episode.pedestrian_s, offset, *place, pace)
    if driver == CONSTANT_VELOCITY:  # sets off, once
        return wanted_x / settings.period, wanted_y / settings.period, False
    then = (episode.frame + 1) * settings.period
    if episode.walker_onset and driver != SOCIAL_FORCE:
        onset = tables.onsets[episode.walker_onset - 1]
        if then < onset_time(onset) + 0.5 * settings.period:
            next_vx, next_vy = walks_then(episode, onset, then)
            return (next_vx - vx) / settings.period, (next_vy - vy) / settings.period, False
    if driver == SOCIAL_FORCE:
        car = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, _HALF_LENGTH, _HALF_WIDTH
        ax, ay = social_force(wanted_x, wanted_y, vx, vy, *place, *car, PEDESTRIAN_RADIUS)
        return ax, ay, False
    most = episode.stride if settings.human else WALK_ACCELERATION
    ax, ay = walk_acceleration(wanted_x - vx, wanted_y - vy, most, settings.period)
    return ax, ay, settings.human


@inlined
def move_pedestrian(episode, ax, ay, settings):  # type: ignore[no-untyped-def]
    """Move the pedestrian through one tick with an acceleration [m/s2] in the world's frame."""
    now = episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy
    x, y, vx, vy = motion.walk(*now, ax, ay, 1.0, min(RUNNING_SPEED, TOP_SPEED[episode.kind]), settings.period)
    episode.pedestrian_path += math.sqrt((x - episode.pedestrian_x) ** 2 + (y - episode.pedestrian_y) ** 2)
    episode.pedestrian_ax = (vx - episode.pedestrian_vx) / settings.period
    episode.pedestrian_ay = (vy - episode.pedestrian_vy) / settings.period
    episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy = x, y, vx, vy


@inlined
def replay_pedestrian(episode, recordings, settings):  # type: ignore[no-untyped-def]
    """Put the pedestrian where its recording has it next; beyond the recording it keeps its velocity."""
    frame = episode.frame + 1
    if frame >= recordings.frames[episode.recording]:
        move_pedestrian(episode, 0.0, 0.0, settings)
        return
    x, y, vx, vy = recordings.pedestrian[episode.recording, frame]
    episode.pedestrian_path += math.sqrt((x - episode.pedestrian_x) ** 2 + (y - episode.pedestrian_y) ** 2)
    episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy = x, y, vx, vy
