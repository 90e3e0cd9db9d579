"""Where a right turn begins: about a second before an onset like a recorded one, drawn as a whole.

Speeds, accelerations and CurvTTC of a recorded onset are taken together, for they depend on each other. The car is put
where the arc that it would drive on reaches the walker's line in that time, the walker where the two would touch, and
both are traced back along lane and route. Draws that would have been critical before are drawn again.
"""

import math

from vpsci_ros.safety import (
    CRITICAL_TTC,
    HORIZON,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvttc_pair,
)
from vpsci_ros.world import people
from vpsci_ros.world.approach import walker_speed
from vpsci_ros.world.autopilot import SPEED_TIME
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_SPAWN, draw, normal_pair, unit
from vpsci_ros.world.human_spawn import TRACE, cross, draw_driver, draw_walker, place_walker, put_car, put_walker
from vpsci_ros.world.kinds import ADULT, CHILD, SET_OFF
from vpsci_ros.world.paths import line_at
from vpsci_ros.world.people import car_speed

EARLIEST, LATEST = 0.8, 1.4  # [s] from the spawn to the onset
FRONT = 0.4  # share of the draws in which the walker would come before the car's front; else, to its side
STANDS = 0.3  # [m/s] below it somebody stands
NEAR_ENOUGH = 0.4  # [s] by which CurvTTC may differ from the recorded one
EDGE, GRAZING = 0.7, 0.2  # share of the draws at an edge of what would touch; part of it that is an edge
MOST_LATE = 0.7  # as a share of CurvTTC: how long a walker comes to the side after the front has passed
SAME, ATTEMPTS = 8, 48  # draws of the place for one recorded onset; in all
_FIRST_BLOCK = 16  # of the stream; those before it are the other spawns'
# mean over a second of a wave's acceleration about its greatest, as a share of that
_CAR_MEAN = people.CAR_PERIOD / math.pi * math.sin(math.pi / people.CAR_PERIOD)
_WALK_MEAN = people.WALK_PERIOD / math.pi * math.sin(math.pi / people.WALK_PERIOD)
_BACK, _STEP = 40.0, 2.0  # [m] how far, in which steps, the car's place is looked for
_HALF_LENGTH = 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS
_HALF_WIDTH = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS


@kernel
def spawn_right_turn(episode, row, tables, seed):  # type: ignore[no-untyped-def]
    """Draw a recorded onset and put both where they are at the spawn.

    Return the time [s] that the car needs from the spawn to the crossing.
    """
    draw_driver(episode, row, seed)
    draw_walker(episode, row, tables, seed, True)
    comfort = episode.lateral_comfort
    drives, speed, ttc, walks = 0.0, 1.0, 4.0, 1.0
    onset = 0.0
    for attempt in range(ATTEMPTS):
        block = _FIRST_BLOCK + 4 * attempt
        if attempt % SAME == 0:
            first, second = draw(episode, seed, STREAM_SPAWN, block), draw(episode, seed, STREAM_SPAWN, block + 1)
            onset = EARLIEST + unit(second[3]) * (LATEST - EARLIEST)
            speed, walks, ttc = _draw_people(episode, row, first, second, onset)
        place, more = draw(episode, seed, STREAM_SPAWN, block + 2), draw(episode, seed, STREAM_SPAWN, block + 3)
        episode.lateral_comfort = comfort
        drives = onset + ttc
        anyway = attempt == ATTEMPTS - 1
        if _place(episode, row, tables, place, more, onset, speed, walks, ttc, anyway):
            break
    if episode.kind == CHILD:
        place_walker(episode, row, tables, drives, seed)
    return drives


@kernel
def _smoothed(values, column, deviation):  # type: ignore[no-untyped-def]
    return values[column] + people.SMOOTHING[column] * min(2.0, max(-2.0, deviation))


@kernel
def _draw_people(episode, row, first, second, onset):  # type: ignore[no-untyped-def]
    """Draw how fast both are at the onset; return the car's speed, the walker's [m/s], and CurvTTC [s].

    The driver is behind its own speed by `SPEED_TIME`, so the record's is ahead by as much.
    """
    one = people.RIGHT_TURNS[int(unit(first[0]) * people.RIGHT_TURNS.shape[0])]
    a, b = normal_pair(unit(first[1]), unit(first[2]))
    c, d = normal_pair(unit(first[3]), unit(second[0]))
    e, _ = normal_pair(unit(second[1]), unit(second[2]))
    speed = max(0.6, _smoothed(one, people.CAR, a))
    ttc = min(CRITICAL_TTC - 0.05, max(1.0, _smoothed(one, people.TTC, e)))
    acceleration = _smoothed(one, people.BRAKES, b)
    # half a second before the onset speeds change most
    episode.approach_acceleration = acceleration / _CAR_MEAN
    episode.cruise_throttle = max(people.LEAST_CAR, speed - 0.5 * acceleration) / row.full_throttle_speed
    phase = (SPEED_TIME - (onset - 0.5)) / people.CAR_PERIOD
    episode.approach_phase = phase - math.floor(phase)
    walks, change = one[people.WALK], 0.0
    episode.start_delay = 0.0
    if episode.kind != ADULT:
        walks = episode.walking_speed
    elif walks < STANDS:
        walks, episode.walking_speed = 0.0, 1.0
        episode.start_delay = onset + 1.0
    else:
        walks = max(people.LEAST_WALK, _smoothed(one, people.WALK, c))
        episode.walking_speed = walks
        if one[people.SLOWEST] < STANDS and one[people.WALK] - one[people.HURRIES] < people.LEAST_WALK:
            episode.start_delay = max(0.05, onset - walks / SET_OFF[episode.kind])
        else:
            change = _smoothed(one, people.HURRIES, d)
            episode.walking_speed = max(people.LEAST_WALK, walks - 0.5 * change)
    episode.walking_acceleration = change / _WALK_MEAN
    phase = -(onset - 0.5) / people.WALK_PERIOD
    episode.walking_phase = phase - math.floor(phase)
    return speed, walks, ttc


@kernel
def _place(episode, row, tables, place, more, onset, speed, walks, ttc, anyway):  # type: ignore[no-untyped-def]
    """Put both where they are at the spawn; return whether they come to the onset, and not before.

    :param anyway: put them there whatever becomes of it.
    """
    oblique, _ = normal_pair(unit(place[0]), unit(place[1]))
    offset = row.lowest_offset + unit(place[2]) * (row.highest_offset - row.lowest_offset)
    cross(episode, row, tables, offset, people.SLOPE + people.SLOPE_SPREAD * min(2.0, max(-2.0, oblique)))
    x, y, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, row.conflict)
    x, y = x - offset * uy, y + offset * ux
    slope = episode.walk_slope
    length = math.sqrt(1.0 + slope * slope)
    ux, uy = (ux - slope * uy) / length, (uy + slope * ux) / length
    _, _, along_x, along_y = line_at(tables.lane, episode.table, row.lane_count, row.lane_step, episode.meeting_s)
    sign = 1.0 if along_x * uy - along_y * ux > 0.0 else -1.0

    beside, reaches = _touch(place, more, speed, walks, ttc)
    way = speed * reaches + _HALF_LENGTH
    s, beyond, across = episode.meeting_s - 0.3 * way, 1.0, 0.0
    while beyond > 0.0 and s > episode.meeting_s - _BACK:
        s -= min(_STEP, 0.1 + 0.5 * beyond)
        put_car(episode, row, tables, s, speed)
        front_x, front_y = _ahead(episode, way)
        beyond = sign * ((front_x - x) * uy - (front_y - y) * ux)
        across = (front_x - x) * ux + (front_y - y) * uy
    if beyond > 0.0 and not anyway:
        return False
    walked = row.conflict + (across + beside - walks * reaches) / length
    return _trace_back(episode, row, tables, onset, s, walked, length, ttc, anyway)


@kernel
def _touch(place, more, speed, walks, ttc):  # type: ignore[no-untyped-def]
    """Draw where the two would touch.

    Return how far beyond the middle of the car's path the walker is [m] when the car's front comes to its line,
    and in what time that is [s]: CurvTTC, or earlier where the walker comes to the car's side.
    """
    share, edge = unit(more[1]), unit(more[0]) < EDGE
    if edge:  # they would only just touch, for until now they would not have
        share = (1.0 if share > 0.5 else 0.0) + (0.5 - share) * GRAZING
    if unit(place[3]) < FRONT or walks == 0.0:
        return (2.0 * share - 1.0) * _HALF_WIDTH, ttc
    late = 1.0 - GRAZING * unit(more[2]) if edge else 1.0 - abs(1.0 - 2.0 * share)
    late *= min(2.0 * _HALF_LENGTH / speed, MOST_LATE * ttc)
    return -_HALF_WIDTH - walks * late, ttc - late


@kernel
def _ahead(episode, way):  # type: ignore[no-untyped-def]
    """Return where the car would be after so much `way` [m] on its present arc."""
    turn = episode.vehicle_curvature * way
    heading = episode.vehicle_heading + 0.5 * turn
    chord = way if abs(turn) < 1e-6 else way * math.sin(0.5 * turn) / (0.5 * turn)
    return episode.vehicle_x + chord * math.cos(heading), episode.vehicle_y + chord * math.sin(heading)


@kernel
def _curvttc(episode):  # type: ignore[no-untyped-def]
    car = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.vehicle_speed
    walker = episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy
    size = VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS, HORIZON
    return curvttc_pair(*car, episode.vehicle_curvature, *walker, *size)


@kernel
def _trace_back(episode, row, tables, onset, s, walked, length, ttc, anyway):  # type: ignore[no-untyped-def]
    """Trace both back from the onset to the spawn; return whether it is critical then as meant, and not before."""
    cruise = episode.cruise_throttle * row.full_throttle_speed
    left, step, comfort = onset, 0, episode.lateral_comfort
    right = True
    while True:
        speed = car_speed(cruise, episode.approach_acceleration, episode.approach_phase, left - SPEED_TIME)
        sample = min(max(int(s / row.lane_step), 0), row.lane_count - 1)
        comfort = max(comfort, (1.02 * speed / tables.turning_speed[episode.table, sample]) ** 2)
        if step % 2 == 0 or left <= 0.0:
            put_car(episode, row, tables, s, speed)
            put_walker(episode, row, tables, walked, left)
            now = _curvttc(episode)
            right = now >= CRITICAL_TTC if step else abs(now - ttc) < NEAR_ENOUGH and now < CRITICAL_TTC
        if left <= 0.0 or not (right or anyway):
            break
        period = min(TRACE, left)
        s -= speed * period
        walked -= walker_speed(episode, left - period) * period / length
        left -= period
        step += 1
    episode.lateral_comfort = comfort
    return right
