"""Where an episode of people begins: one or two seconds before they should come onto a course to collide.

Both are on their way already; a few walkers wait at the kerb and set off in time. What they are like at the onset is
drawn from recorded onsets (`people`), how near they come to each other uniformly from all the courses that collide, and
from there both are traced back along lane and route to the spawn. Further walkers join, each with a meeting of its own.
"""

import math

from numba import uint64

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import people
from vpsci_ros.world.approach import bend_speed, lane_sway, line_offset, walker_speed
from vpsci_ros.world.autopilot import pursuit_curvature
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_SPAWN, philox, unit
from vpsci_ros.world.kinds import CHILD, SET_OFF, speed_of_kind
from vpsci_ros.world.paths import nearest, point_at
from vpsci_ros.world.people import car_speed, quantile, sway

EARLIEST, LATEST = 1.0, 2.0  # [s] from the spawn to the onset
AHEAD = 5.0  # [s] from the onset to the collision of two who do not react
TRACE = 0.05  # [s] step in which both are traced back
_HALF_LENGTH = 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS
_HALF_WIDTH = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS
_OF_A_WAVE = math.sqrt(2.0)  # its height over its root mean square
_FIRST_BLOCK = 2  # of the stream; blocks 0 and 1 are the paper's spawn


@kernel
def _bits(episode, seed, block, person):  # type: ignore[no-untyped-def]
    counter, stream = uint64(_FIRST_BLOCK + block), uint64(STREAM_SPAWN)
    return philox(uint64(seed), uint64(episode.scenario), counter, stream, uint64(episode.episode), uint64(person))


@kernel
def _two_normals(first, second):  # type: ignore[no-untyped-def]
    radius = math.sqrt(-2.0 * math.log(1.0 - unit(first)))
    angle = 2.0 * math.pi * unit(second)
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def spawn_people(episode, table, row, tables, seed):  # type: ignore[no-untyped-def]
    """Draw two people, when and where they meet, and put them where they are then at the spawn.

    Return the time [s] that the car needs from the spawn to the crossing.
    """
    speed = _draw_driver(episode, row, seed)
    _draw_walker(episode, table, row, tables, seed)
    meeting = _bits(episode, seed, 2, 0)
    onset = EARLIEST + unit(meeting[0]) * (LATEST - EARLIEST)
    later = _meet(episode, row, meeting, onset, speed)
    # until it is at the crossing
    drives = onset + AHEAD - max(-_HALF_LENGTH / speed, later - _HALF_WIDTH / episode.walking_speed)
    _place_car(episode, table, row, tables, drives)
    _place_walker(episode, table, row, tables, drives + later, seed)
    return drives


@kernel
def join_people(episode, leader, table, row, tables, seed, drives):  # type: ignore[no-untyped-def]
    """Draw one more walker, who meets the `leader` record's car for itself, and put them where they are at the spawn.

    :param drives: time [s] that the car needs from the spawn to where it meets the leader.
    """
    speed = leader.cruise_throttle * tables.rows[leader.table].full_throttle_speed
    _draw_walker(episode, table, row, tables, seed)
    meeting = _bits(episode, seed, 2, episode.pedestrian)
    later = _meet(episode, row, meeting, EARLIEST + unit(meeting[0]) * (LATEST - EARLIEST), speed)
    _place_walker(episode, table, row, tables, drives + (episode.meeting_s - leader.meeting_s) / speed + later, seed)


@kernel
def _draw_driver(episode, row, seed):  # type: ignore[no-untyped-def]
    """Draw who drives; return the speed at the onset [m/s]."""
    driver, car_sway = _bits(episode, seed, 0, 0), _bits(episode, seed, 3, 0)
    speed = quantile(people.CAR_SPEED, unit(driver[0]))
    episode.cruise_throttle = speed / row.full_throttle_speed
    episode.approach_acceleration = _OF_A_WAVE * quantile(people.CAR_ACCELERATION, unit(driver[1]))
    comfort, _ = _two_normals(driver[2], driver[3])
    spread = people.LATERAL_SPREAD * min(2.0, max(-2.0, comfort))
    episode.lateral_comfort = people.LATERAL_COMFORT + spread
    episode.approach_phase = unit(car_sway[2])
    sine, cosine = _two_normals(car_sway[0], car_sway[1])
    episode.lane_sine, episode.lane_cosine = people.CAR_WANDER * sine, people.CAR_WANDER * cosine
    return speed


@kernel
def _draw_walker(episode, table, row, tables, seed):  # type: ignore[no-untyped-def]
    """Draw who walks, and along which line."""
    walker, walk_sway = _bits(episode, seed, 1, episode.pedestrian), _bits(episode, seed, 4, episode.pedestrian)
    episode.walking_phase = unit(walk_sway[2])
    sine, cosine = _two_normals(walk_sway[0], walk_sway[1])
    episode.walk_sine, episode.walk_cosine = people.WALK_WANDER * sine, people.WALK_WANDER * cosine
    episode.walking_speed = speed_of_kind(episode, seed, quantile(people.WALKING_SPEED, unit(walker[0])))
    episode.walking_acceleration = _OF_A_WAVE * quantile(people.WALKING_ACCELERATION, unit(walker[1]))
    oblique = math.tan(quantile(people.OBLIQUE, unit(walker[2])))
    offset = row.lowest_offset + unit(walker[3]) * (row.highest_offset - row.lowest_offset)
    _cross(episode, table, row, tables, offset, oblique)


@kernel
def _meet(episode, row, meeting, onset, speed):  # type: ignore[no-untyped-def]
    """Draw how much later than the car the walker is at the crossing [s], and whether it waits at the kerb before."""
    episode.start_delay = unit(meeting[3]) * onset if unit(meeting[2]) < row.waiting else 0.0
    side = 2.0 * unit(meeting[1]) - 1.0  # the car is later, or the walker
    beside = quantile(people.BESIDE, abs(side)) * (1.0 if side >= 0.0 else -1.0)
    return beside * (_HALF_LENGTH / speed + _HALF_WIDTH / episode.walking_speed)


@kernel
def _cross(episode, table, row, tables, offset, oblique):  # type: ignore[no-untyped-def]
    """Set the walker's line, `oblique` [m/m] along with the car, and where it crosses the lane."""
    x, y = point_at(tables.walk, table, row.walk_count, row.walk_step, row.conflict)
    ahead_x, ahead_y = point_at(tables.walk, table, row.walk_count, row.walk_step, row.conflict + row.walk_step)
    ux, uy = (ahead_x - x) / row.walk_step, (ahead_y - y) / row.walk_step
    x, y = x - offset * uy, y + offset * ux
    s = nearest(tables.lane, table, row.lane_count, row.lane_step, x, y)
    here_x, here_y = point_at(tables.lane, table, row.lane_count, row.lane_step, s)
    there_x, there_y = point_at(tables.lane, table, row.lane_count, row.lane_step, s + row.lane_step)
    from_the_right = (there_x - here_x) * uy - (there_y - here_y) * ux > 0.0
    episode.meeting_s = s
    episode.pedestrian_offset = offset
    episode.walk_slope = -oblique if from_the_right else oblique


@kernel
def _place_car(episode, table, row, tables, drives):  # type: ignore[no-untyped-def]
    """Put the car where it has `drives` [s] to go to the crossing."""
    cruise = episode.cruise_throttle * row.full_throttle_speed
    s, left = episode.meeting_s, drives
    speed = 0.0
    while left > 0.0:
        pace = car_speed(cruise, episode.approach_acceleration, episode.approach_phase, left - TRACE)
        speed = min(pace, bend_speed(episode, row, tables, s))
        s -= speed * min(TRACE, left)
        left -= TRACE
    x, y = point_at(tables.lane, table, row.lane_count, row.lane_step, s)
    ahead_x, ahead_y = point_at(tables.lane, table, row.lane_count, row.lane_step, s + row.lane_step)
    ux, uy = (ahead_x - x) / row.lane_step, (ahead_y - y) / row.lane_step
    here = sway(episode.lane_sine, episode.lane_cosine, people.CAR_WAVE, s)
    there = sway(episode.lane_sine, episode.lane_cosine, people.CAR_WAVE, s + row.lane_step)
    episode.route_s = s
    episode.vehicle_x, episode.vehicle_y = x - here * uy, y + here * ux
    episode.vehicle_heading = math.atan2(uy, ux) + math.atan((there - here) / row.lane_step)
    episode.action_heading = episode.vehicle_heading
    episode.vehicle_speed = speed
    aside = lane_sway(episode)
    episode.vehicle_curvature = pursuit_curvature(
        tables.lane,
        table,
        row.lane_count,
        row.lane_step,
        s,
        aside,
        episode.vehicle_x,
        episode.vehicle_y,
        episode.vehicle_heading,
        speed,
    )


@kernel
def _place_walker(episode, table, row, tables, walks, seed):  # type: ignore[no-untyped-def]
    """Put the walker where it has `walks` [s] to go to the crossing, time that it waits included.

    A child waits at the kerb for what it does not need to run.
    """
    if episode.kind == CHILD:
        kerb = row.standing_room * unit(_bits(episode, seed, 4, episode.pedestrian)[3])
        running = (row.conflict - kerb) / episode.walking_speed + 0.5 * episode.walking_speed / SET_OFF[CHILD]
        if running < walks:
            episode.start_delay = walks - running
            put_walker(episode, table, row, tables, kerb)
            return
    way, time = 0.0, 0.0
    while time < walks:
        way += walker_speed(episode, time) * min(TRACE, walks - time)
        time += TRACE
    put_walker(episode, table, row, tables, row.conflict - way)


@kernel
def put_walker(episode, table, row, tables, s):  # type: ignore[no-untyped-def]
    """Put the walker on its line at arc length `s` [m] of the route, at the speed it has at the spawn."""
    x, y = point_at(tables.walk, table, row.walk_count, row.walk_step, s)
    ahead_x, ahead_y = point_at(tables.walk, table, row.walk_count, row.walk_step, s + row.walk_step)
    ux, uy = (ahead_x - x) / row.walk_step, (ahead_y - y) / row.walk_step
    here, there = line_offset(episode, row, s), line_offset(episode, row, s + row.walk_step)
    aside = (there - here) / row.walk_step
    pace = walker_speed(episode, 0.0) / math.sqrt(1.0 + aside * aside)
    episode.pedestrian_s = s
    episode.pedestrian_x, episode.pedestrian_y = x - here * uy, y + here * ux
    episode.pedestrian_vx, episode.pedestrian_vy = pace * (ux - aside * uy), pace * (uy + aside * ux)
