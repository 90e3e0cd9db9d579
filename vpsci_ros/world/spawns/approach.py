"""The motion of the rule-based pair with the spawns `right_turns` and `human`, which draw driver and walker.

Until it crosses the walker's line (`meeting_s`), a driver's speed is a function of time, as a walker's is, but lower in
a bend; beyond, the driver drives on a little faster. Neither reacts to the other, but for the fixed distance at which
the autopilot brakes.
"""

import math

from vpsci_ros.world import calibration
from vpsci_ros.world.calibration import (
    BEFORE,
    CAR,
    COLUMNS,
    CURVATURE,
    HISTORY,
    TRACK,
    WALK_ALONG,
    WALK_LEFT,
    car_speed,
    limited,
    sway,
    walking_pace,
)
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.kinds import SET_OFF
from vpsci_ros.world.lane_driving import SPEED_TIME, look_ahead
from vpsci_ros.world.observation import STEP

GENTLE = 0.8  # [m/s2] with which a driver brakes at least for somebody ahead
BRAKING = 2.5  # [m/s2] of a driver that nothing threatens
FIRMEST = 8.0  # [m/s2]
ROOM = 1.0  # [m] at which a car stops before somebody


@kernel
def line_offset(episode, row, s):  # type: ignore[no-untyped-def]
    """Return the offset [m] of a walker to the left of its route at arc length `s` [m]."""
    oblique = episode.walk_slope * min(calibration.STRAIGHTENS, max(-calibration.OBLIQUE_FROM, s - row.conflict))
    return episode.pedestrian_offset + oblique + sway(episode.walk_sine, episode.walk_cosine, calibration.WALK_WAVE, s)


@kernel
def bend_speed(episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Return the greatest speed [m/s] of this driver at arc length `s` [m] of the lane, for a bend there or ahead."""
    sample = min(max(int(s / row.lane_step), 0), row.lane_count - 1)
    return math.sqrt(episode.lateral_comfort) * tables.turning_speed[episode.table, sample]


@kernel
def walker_speed(episode, time):  # type: ignore[no-untyped-def]
    """Return the speed [m/s] at which this walker walks, `time` [s] after the spawn."""
    moving = time - episode.start_delay if episode.start_delay > 0.0 else math.inf
    rhythm = episode.walking_acceleration, episode.walking_phase
    return walking_pace(episode.walking_speed, *rhythm, time, moving, SET_OFF[episode.kind])


@kernel
def onset_time(onset):  # type: ignore[no-untyped-def]
    """Return the time after the spawn [s] at which a row of `calibration.right_turns` becomes critical."""
    return STEP * onset[BEFORE]


@kernel
def _recorded(onset, column, time):  # type: ignore[no-untyped-def]
    """Return a column of an onset's track, `time` [s] after the spawn, interpolated between recorded steps."""
    first = HISTORY - onset[BEFORE]
    step = min(1.0 * HISTORY, max(first, first + time / STEP))
    i = min(int(step), HISTORY - 1)
    begin, end = onset[TRACK + COLUMNS * i + column], onset[TRACK + COLUMNS * (i + 1) + column]
    return begin + (step - i) * (end - begin)


@kernel
def drive_then(onset, time):  # type: ignore[no-untyped-def]
    """Return the speed [m/s] and curvature [1/m] of the recorded car, `time` [s] after the spawn."""
    return _recorded(onset, CAR, time), _recorded(onset, CURVATURE, time)


@kernel
def walk_then(onset, time):  # type: ignore[no-untyped-def]
    """Return the recorded velocity (along, left) [m/s] of a walker in the car's onset frame, at `time` [s]."""
    return _recorded(onset, WALK_ALONG, time), _recorded(onset, WALK_LEFT, time)


@kernel
def walks_then(episode, onset, time):  # type: ignore[no-untyped-def]
    """Return this walker's velocity (vx, vy) [m/s] in the map frame, `time` [s] after the spawn, before the onset."""
    along, left = walk_then(onset, time)
    cosine, sine = episode.walk_cosine_then, episode.walk_sine_then
    return along * cosine - left * sine, along * sine + left * cosine


@kernel
def lane_sway(episode):  # type: ignore[no-untyped-def]
    """Return the offset [m], to the left of the lane's centre, of the point that this driver steers to."""
    ahead = look_ahead(episode.route_s, episode.vehicle_speed)
    return sway(episode.lane_sine, episode.lane_cosine, calibration.CAR_WAVE, ahead)


@kernel
def drivers_acceleration(episode, row, tables, gap, period):  # type: ignore[no-untyped-def]
    """Return a driver's acceleration along the heading [m/s2]; `gap` [m]: to a pedestrian ahead, infinity for none."""
    speed = episode.vehicle_speed
    cruise = episode.cruise_throttle * row.full_throttle_speed
    if episode.route_s < episode.meeting_s:
        wanted = car_speed(cruise, episode.approach_acceleration, episode.approach_phase, episode.frame * period)
    else:
        wanted = min(calibration.GREATEST_CAR, cruise + calibration.DRIVE_ON)
    wanted = min(wanted, bend_speed(episode, row, tables, episode.route_s))
    along = min(episode.drive_on, max(-BRAKING, (wanted - speed) / SPEED_TIME))
    if gap < math.inf:
        along = -min(FIRMEST, max(GENTLE, 0.5 * speed * speed / max(0.2, gap - ROOM)))
    return limited(along, episode.vehicle_acceleration, period)


@kernel
def step_towards(episode, ax, ay, period):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] nearest to the given one that the limit of the walker's jerk allows."""
    dx, dy = ax - episode.pedestrian_ax, ay - episode.pedestrian_ay
    change, most = math.sqrt(dx * dx + dy * dy), calibration.JERK * period
    share = 1.0 if change <= most else most / change
    return episode.pedestrian_ax + share * dx, episode.pedestrian_ay + share * dy
