"""The spawn `human`: both agents begin one to two seconds before the drawn onset of a conflict.

Both are on their way already; a few walkers wait at the kerb and set off in time. Speeds, accelerations and lines at
the onset are drawn from recorded onsets (`people`), and so is the distance by which the two miss each other. From the
onset both are traced back along lane and route to the spawn. Further walkers join, each with a conflict of its own.
"""

import math

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import calibration
from vpsci_ros.world.calibration import car_speed, quantile, sway
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_SPAWN, draw, normal_pair, unit
from vpsci_ros.world.kinds import ADULT, CHILD, SET_OFF, speed_of_kind
from vpsci_ros.world.lane_driving import pursuit_curvature
from vpsci_ros.world.paths import line_at, nearest
from vpsci_ros.world.spawns.approach import bend_speed, lane_sway, line_offset, onset_time, walk_then, walker_speed

EARLIEST, LATEST = 1.0, 2.0  # [s] from the spawn to the onset
AHEAD = 5.0  # [s] from the onset to the collision of two who do not react
TRACE = 0.05  # [s] step in which both are traced back
_HALF_LENGTH = 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS
_HALF_WIDTH = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS
_OF_A_WAVE = math.sqrt(2.0)  # its height over its root mean square
# blocks of the stream; 0 and 1 are the paper's
_DRIVER, _WALKER, _MEETING, _CAR_SWAY, _WALK_SWAY, _SPEEDING_UP = range(2, 8)


@kernel
def begin(episode, row, tables, seed, _period):  # type: ignore[no-untyped-def]
    """Draw a driver and a walker and their conflict point and time, and place both at the spawn.

    Return the time [s] that the car needs from the spawn to the crossing.
    """
    speed = draw_driver(episode, row, seed)
    draw_walker(episode, row, tables, seed, False)
    meeting = draw(episode, seed, STREAM_SPAWN, _MEETING)
    onset = EARLIEST + unit(meeting[0]) * (LATEST - EARLIEST)
    later = _meet(episode, row, meeting, onset, speed)
    # until it is at the crossing
    drives = onset + AHEAD - max(-_HALF_LENGTH / speed, later - _HALF_WIDTH / episode.walking_speed)
    _place_car(episode, row, tables, drives)
    place_walker(episode, row, tables, drives + later, seed)
    return drives


@kernel
def join(episode, leader, row, tables, seed, drives):  # type: ignore[no-untyped-def]
    """Draw one more walker and put it where it is at the spawn, see `meet_car`."""
    meet_car(episode, leader, row, tables, seed, drives, False)


@kernel
def meet_car(episode, leader, row, tables, seed, drives, turning):  # type: ignore[no-untyped-def]
    """Draw a further walker with its own conflict with the `leader` record's car, and place it at the spawn.

    :param drives: time [s] that the car needs from the spawn to where it meets the leader.
    :param turning: the walker's speed and line are those of right turns.
    """
    speed = leader.cruise_throttle * tables.rows[leader.table].full_throttle_speed
    draw_walker(episode, row, tables, seed, turning)
    meeting = draw(episode, seed, STREAM_SPAWN, _MEETING)
    later = _meet(episode, row, meeting, EARLIEST + unit(meeting[0]) * (LATEST - EARLIEST), speed)
    place_walker(episode, row, tables, drives + (episode.meeting_s - leader.meeting_s) / speed + later, seed)


@kernel
def draw_driver(episode, row, seed):  # type: ignore[no-untyped-def]
    """Draw the driver; return the speed at the onset [m/s]."""
    driver, car_sway = draw(episode, seed, STREAM_SPAWN, _DRIVER), draw(episode, seed, STREAM_SPAWN, _CAR_SWAY)
    speed = quantile(calibration.CAR_SPEED, unit(driver[0]))
    episode.cruise_throttle = speed / row.full_throttle_speed
    episode.approach_acceleration = _OF_A_WAVE * quantile(calibration.CAR_ACCELERATION, unit(driver[1]))
    comfort, _ = normal_pair(unit(driver[2]), unit(driver[3]))
    spread = calibration.LATERAL_SPREAD * min(2.0, max(-2.0, comfort))
    episode.lateral_comfort = calibration.LATERAL_COMFORT + spread
    episode.approach_phase = unit(car_sway[2])
    episode.drive_on = quantile(calibration.DRIVES_ON, unit(draw(episode, seed, STREAM_SPAWN, _SPEEDING_UP)[0]))
    sine, cosine = _wave(car_sway)
    episode.lane_sine, episode.lane_cosine = calibration.CAR_WANDER * sine, calibration.CAR_WANDER * cosine
    return speed


@kernel
def _wave(drawn):  # type: ignore[no-untyped-def]
    """Return the coefficients of sine and cosine of an agent's sway, standard normal."""
    return normal_pair(unit(drawn[0]), unit(drawn[1]))


@kernel
def _pace(onset, time):  # type: ignore[no-untyped-def]
    along, left = walk_then(onset, time)
    return math.sqrt(along * along + left * left)


@kernel
def draw_walker(episode, row, tables, seed, turning):  # type: ignore[no-untyped-def]
    """Draw the walker and its line; with `turning` from recorded right turns."""
    walker, walk_sway = draw(episode, seed, STREAM_SPAWN, _WALKER), draw(episode, seed, STREAM_SPAWN, _WALK_SWAY)
    episode.walking_phase = unit(walk_sway[2])
    stride = quantile(calibration.STRIDES, unit(draw(episode, seed, STREAM_SPAWN, _SPEEDING_UP)[1]))
    episode.stride = stride * SET_OFF[episode.kind] / SET_OFF[ADULT]
    sine, cosine = _wave(walk_sway)
    episode.walk_sine, episode.walk_cosine = calibration.WALK_WANDER * sine, calibration.WALK_WANDER * cosine
    if turning:
        onset = tables.onsets[int(unit(walker[0]) * tables.onsets.shape[0])]
        time = onset_time(onset)
        pace, change = max(calibration.LEAST_WALK, _pace(onset, time)), (_pace(onset, time) - _pace(onset, 0.0)) / time
        oblique = calibration.SLOPE + calibration.SLOPE_SPREAD * (2.0 * unit(walker[2]) - 1.0)
    else:
        pace = quantile(calibration.WALKING_SPEED, unit(walker[0]))
        change = quantile(calibration.WALKING_ACCELERATION, unit(walker[1]))
        oblique = math.tan(quantile(calibration.OBLIQUE, unit(walker[2])))
    episode.walking_speed = speed_of_kind(episode, seed, pace)
    episode.walking_acceleration = _OF_A_WAVE * change
    offset = row.lowest_offset + unit(walker[3]) * (row.highest_offset - row.lowest_offset)
    cross(episode, row, tables, offset, oblique)


@kernel
def _meet(episode, row, meeting, onset, speed):  # type: ignore[no-untyped-def]
    """Draw how much later than the car the walker is at the crossing [s], and whether it waits at the kerb before."""
    episode.start_delay = unit(meeting[3]) * onset if unit(meeting[2]) < row.waiting else 0.0
    side = 2.0 * unit(meeting[1]) - 1.0  # the car is later, or the walker
    beside = quantile(calibration.BESIDE, abs(side)) * (1.0 if side >= 0.0 else -1.0)
    return beside * (_HALF_LENGTH / speed + _HALF_WIDTH / episode.walking_speed)


@kernel
def cross(episode, row, tables, offset, oblique):  # type: ignore[no-untyped-def]
    """Set the walker's line: its slope `oblique` [m/m] in the car's direction, and where it crosses the lane."""
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    x, y, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, row.conflict)
    s = nearest(*lane, x - offset * uy, y + offset * ux)
    _, _, along_x, along_y = line_at(*lane, s)
    from_the_right = along_x * uy - along_y * ux > 0.0
    episode.meeting_s = s
    episode.pedestrian_offset = offset
    episode.walk_slope = -oblique if from_the_right else oblique


@kernel
def _place_car(episode, row, tables, drives):  # type: ignore[no-untyped-def]
    """Put the car where it has `drives` [s] to go to the crossing."""
    cruise = episode.cruise_throttle * row.full_throttle_speed
    s, left = episode.meeting_s, drives
    speed = 0.0
    while left > 0.0:
        pace = car_speed(cruise, episode.approach_acceleration, episode.approach_phase, left - TRACE)
        speed = min(pace, bend_speed(episode, row, tables, s))
        s -= speed * min(TRACE, left)
        left -= TRACE
    put_car(episode, row, tables, s, speed)


@kernel
def put_car(episode, row, tables, s, speed):  # type: ignore[no-untyped-def]
    """Put the car in its lane at arc length `s` [m], at this speed [m/s]."""
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    x, y, ux, uy = line_at(*lane, s)
    here = sway(episode.lane_sine, episode.lane_cosine, calibration.CAR_WAVE, s)
    there = sway(episode.lane_sine, episode.lane_cosine, calibration.CAR_WAVE, s + row.lane_step)
    episode.route_s = s
    episode.vehicle_x, episode.vehicle_y = x - here * uy, y + here * ux
    episode.vehicle_heading = math.atan2(uy, ux) + math.atan((there - here) / row.lane_step)
    episode.action_heading = episode.vehicle_heading
    episode.vehicle_speed = speed
    place = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
    episode.vehicle_curvature = pursuit_curvature(*lane, s, lane_sway(episode), *place, speed)


@kernel
def place_walker(episode, row, tables, walks, seed):  # type: ignore[no-untyped-def]
    """Place the walker `walks` [s] before the crossing, including its waiting time.

    A child waits at the kerb for the rest of that time, if its run takes less.
    """
    if episode.kind == CHILD:
        kerb = row.standing_room * unit(draw(episode, seed, STREAM_SPAWN, _WALK_SWAY)[3])
        running = (row.conflict - kerb) / episode.walking_speed + 0.5 * episode.walking_speed / SET_OFF[CHILD]
        if running < walks:
            episode.start_delay = walks - running
            put(episode, row, tables, kerb)
            return
    way, time = 0.0, 0.0
    while time < walks:
        way += walker_speed(episode, time) * min(TRACE, walks - time)
        time += TRACE
    put(episode, row, tables, row.conflict - way)


@kernel
def put(episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Put the walker on its line at arc length `s` [m] of the route, at its speed at the spawn."""
    x, y, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, s)
    here, there = line_offset(episode, row, s), line_offset(episode, row, s + row.walk_step)
    aside = (there - here) / row.walk_step
    pace = walker_speed(episode, 0.0) / math.sqrt(1.0 + aside * aside)
    episode.pedestrian_s = s
    episode.pedestrian_x, episode.pedestrian_y = x - here * uy, y + here * ux
    episode.pedestrian_vx, episode.pedestrian_vy = pace * (ux - aside * uy), pace * (uy + aside * ux)
