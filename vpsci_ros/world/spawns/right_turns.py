"""The spawn `right_turns`: up to a second before a recorded onset, with the recorded motion until then.

A row of `calibration.right_turns` is one recorded onset: where the walker is seen from the car, how fast both were, how
the car steered and which way the walker walked, at each step of the second before. The car is put into the lane where
the walker then walks along the scenario's crossing and where the lane turns as the recorded car turned afterwards.
Onsets that fit the scenario badly are drawn seldom. Until the onset, both move as recorded (`approach`).
"""

import math

from vpsci_ros.safety import (
    CRITICAL_TTC,
    HORIZON,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvttc_pair,
    touches_box,
)
from vpsci_ros.world import calibration
from vpsci_ros.world.calibration import AHEAD, LEFT, TURNS, WAY
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_SPAWN, draw, normal_pair, unit
from vpsci_ros.world.kinds import ADULT, CHILD
from vpsci_ros.world.paths import line_at, nearest, project
from vpsci_ros.world.spawns.approach import drive_then, line_offset, onset_time, walk_then, walks_then
from vpsci_ros.world.spawns.human import draw_driver, draw_walker, meet_car, place_walker, put, put_car

__all__ = ["begin", "join", "put"]

STANDS = 0.3  # [m/s] below it somebody stands
WAITS = 1.0  # [s] after the onset, for which somebody who stands then waits
# what is one standard deviation of a place that fits the onset: [m] from the walking route, [rad] between the walker's
# direction and the route's, [rad] between the recorded turn of the 3 s after the onset and the lane's
BESIDE_ROUTE, ASKEW, OTHERWISE = 1.5, math.radians(25.0), math.radians(8.0)
TOLERANCE = 6.0  # squared deviations by which an onset becomes seldom by a factor e
# standard deviations around a recorded onset: shares of both speeds, [rad] of the walking direction, [m] of its place
CAR_PACE, WALK_PACE, DIRECTION, PLACE = 0.04, 0.04, math.radians(4.0), 0.2
ATTEMPTS = 48  # draws of an onset
LEAST_WAY = 5.0  # [m] along the lane, from its beginning and to its goal, at the onset
STEEPEST = 0.6  # [m/m] of a walking line against the route, beyond the onset
HESITATES = 0.8  # [m/s] somebody slower at the onset goes on at another drawn speed, if that is greater
_FIRST_BLOCK = 16  # of the stream; those before it are the other spawns'
_JUST_BEFORE = 0.15  # [s] before the onset, in which it may be critical already


@kernel
def begin(episode, row, tables, seed, period):  # type: ignore[no-untyped-def]
    """Draw a recorded onset and place both agents up to a second before it.

    Return the time [s] that the car needs from the spawn to the crossing.

    :param period: [s] of a tick.
    """
    draw_driver(episode, row, seed)
    draw_walker(episode, row, tables, seed, True)
    comfort, pace = episode.lateral_comfort, episode.walking_speed
    half = tables.onsets.shape[0] // 2
    mirrored = half if _turns_left(row, tables, episode.table) else 0
    drives = 0.0
    for attempt in range(ATTEMPTS):
        block, last = _FIRST_BLOCK + 4 * attempt, attempt == ATTEMPTS - 1
        first = draw(episode, seed, STREAM_SPAWN, block)
        number = mirrored + int(unit(first[0]) * half)
        s, deviation = _fitting_place(episode, row, tables, tables.onsets[number])
        if unit(first[1]) >= math.exp(-deviation / TOLERANCE) and not last:
            continue
        episode.driver_onset = episode.walker_onset = number + 1
        episode.lateral_comfort, episode.walking_speed = comfort, pace
        second, third = draw(episode, seed, STREAM_SPAWN, block + 1), draw(episode, seed, STREAM_SPAWN, block + 2)
        drives = _put_at_onset(episode, row, tables, s, first, second, third)
        if _trace_back(episode, row, tables, period) or last:
            break
    if episode.kind == CHILD:
        episode.walker_onset = 0
        place_walker(episode, row, tables, drives, seed)
    return drives


@kernel
def join(episode, leader, row, tables, seed, drives):  # type: ignore[no-untyped-def]
    """Draw one more walker, who walks as in right turns, and put it where it is at the spawn, see `meet_car`."""
    meet_car(episode, leader, row, tables, seed, drives, True)


@kernel
def _turns_left(row, tables, table):  # type: ignore[no-untyped-def]
    """Return whether a lane turns left: there recorded right turns are mirrored."""
    lane = tables.lane, table, row.lane_count, row.lane_step
    _, _, ux, uy = line_at(*lane, 0.0)
    _, _, vx, vy = line_at(*lane, row.lane_step * (row.lane_count - 2))
    return ux * vy - uy * vx > 0.3


@kernel
def _angle(ux, uy, vx, vy):  # type: ignore[no-untyped-def]
    """Return the angle [rad] from one direction to another, -pi to pi."""
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@kernel
def _fitting_place(episode, row, tables, onset):  # type: ignore[no-untyped-def]
    """Return where along the lane [m] the car is at this onset, and by how many squared deviations it does not fit."""
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    route = tables.walk, episode.table, row.walk_count, row.walk_step
    along, left = walk_then(onset, onset_time(onset))
    stands = math.sqrt(along * along + left * left) < STANDS
    best, least, near = LEAST_WAY, math.inf, row.conflict
    s = LEAST_WAY
    while s < row.vehicle_goal - LEAST_WAY:
        x, y, ux, uy = line_at(*lane, s)
        x, y = x + onset[AHEAD] * ux - onset[LEFT] * uy, y + onset[AHEAD] * uy + onset[LEFT] * ux
        near, aside = project(*route, x, y, near)
        _, _, rx, ry = line_at(*route, near)
        askew = _angle(rx, ry, along * ux - left * uy, along * uy + left * ux)
        if stands:  # who stands waits on this side
            askew = math.pi if near > row.conflict else 0.0
        _, _, vx, vy = line_at(*lane, s + onset[WAY])
        otherwise = _angle(ux, uy, vx, vy) - onset[TURNS]
        deviation = (aside / BESIDE_ROUTE) ** 2 + (askew / ASKEW) ** 2 + (otherwise / OTHERWISE) ** 2
        if deviation < least:
            best, least = s, deviation
        s += row.lane_step
    return best, least


@kernel
def _within(deviation):  # type: ignore[no-untyped-def]
    return min(2.0, max(-2.0, deviation))


@kernel
def _put_at_onset(episode, row, tables, s, first, second, third):  # type: ignore[no-untyped-def]
    """Put both where they are at the onset, with a little noise; return the time [s] from the spawn to the crossing."""
    onset = tables.onsets[episode.driver_onset - 1]
    time = onset_time(onset)
    a, b = normal_pair(unit(first[2]), unit(first[3]))
    c, _ = normal_pair(unit(second[0]), unit(second[1]))
    d, e = normal_pair(unit(second[2]), unit(second[3]))
    episode.approach_pace = 1.0 + CAR_PACE * _within(a)
    speed = drive_then(onset, time)[0] * episode.approach_pace
    episode.cruise_throttle = max(calibration.LEAST_CAR, speed) / row.full_throttle_speed
    episode.approach_acceleration = 0.0
    sample = min(max(int(s / row.lane_step), 0), row.lane_count - 1)
    bend = (1.02 * speed / tables.turning_speed[episode.table, sample]) ** 2
    episode.lateral_comfort = max(episode.lateral_comfort, bend)
    put_car(episode, row, tables, s + row.lane_step * (unit(third[0]) - 0.5), speed)

    along, left = walk_then(onset, time)
    pace = math.sqrt(along * along + left * left)
    stands, factor = pace < STANDS, 1.0 + WALK_PACE * _within(b)
    if episode.kind != ADULT and not stands:
        factor = episode.walking_speed / pace
    turned = episode.vehicle_heading + DIRECTION * _within(c)
    episode.walk_cosine_then, episode.walk_sine_then = factor * math.cos(turned), factor * math.sin(turned)
    ux, uy = math.cos(episode.vehicle_heading), math.sin(episode.vehicle_heading)
    ahead, aside = onset[AHEAD] + PLACE * _within(d), onset[LEFT] + PLACE * _within(e)
    episode.pedestrian_x = episode.vehicle_x + ahead * ux - aside * uy
    episode.pedestrian_y = episode.vehicle_y + ahead * uy + aside * ux
    episode.start_delay = time + WAITS if stands else 0.0
    episode.walking_acceleration = 0.0
    if pace >= HESITATES:
        episode.walking_speed = factor * pace
    else:
        episode.walking_speed = max(episode.walking_speed, factor * pace)
    _walk_on(episode, row, tables, stands, math.cos(turned) * along - math.sin(turned) * left,
             math.sin(turned) * along + math.cos(turned) * left)  # fmt: skip
    return time + max(0.5, (episode.meeting_s - episode.route_s) / max(calibration.LEAST_CAR, speed))


@kernel
def _walk_on(episode, row, tables, stands, vx, vy):  # type: ignore[no-untyped-def]
    """Set the walker's line, from where it is at the onset along (vx, vy), and where that crosses the lane."""
    route = tables.walk, episode.table, row.walk_count, row.walk_step
    near = nearest(*route, episode.pedestrian_x, episode.pedestrian_y)
    near, aside = project(*route, episode.pedestrian_x, episode.pedestrian_y, near)
    _, _, rx, ry = line_at(*route, near)
    forward, left = rx * vx + ry * vy, rx * vy - ry * vx
    slope = 0.0
    if not stands:
        slope = min(STEEPEST, max(-STEEPEST, left / max(0.1, forward)))
    episode.walk_slope, episode.pedestrian_offset, episode.pedestrian_s = slope, 0.0, near
    episode.pedestrian_offset = aside - line_offset(episode, row, near)
    x, y, ux, uy = line_at(*route, row.conflict)
    offset = line_offset(episode, row, row.conflict)
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    episode.meeting_s = nearest(*lane, x - offset * uy, y + offset * ux)


@kernel
def _trace_back(episode, row, tables, period):  # type: ignore[no-untyped-def]
    """Trace both back from the onset to the spawn, tick by tick.

    Return whether the episode is critical at the onset, and not more than `_JUST_BEFORE` earlier, and the car touches
    no parked vehicle on the way.
    """
    onset = tables.onsets[episode.driver_onset - 1]
    time = onset_time(onset)
    ticks = int(math.ceil(time / period - 1e-6))
    right, way = True, 0.0
    for left in range(ticks + 1):
        now = (ticks - left) * period
        speed, curvature = drive_then(onset, now)
        speed *= episode.approach_pace
        episode.vehicle_speed, episode.vehicle_curvature = speed, curvature
        episode.pedestrian_vx, episode.pedestrian_vy = walks_then(episode, onset, now)
        critical = _curvttc(episode) < CRITICAL_TTC
        for k in range(tables.parked.shape[1]):
            box = tables.parked[episode.table, k]
            if touches_box(episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, box):
                right = False
        if left == 0:
            right = right and critical
        elif now < time - _JUST_BEFORE and critical:
            right = False
        if left == ticks:
            break
        before, _ = drive_then(onset, now - period)
        distance = 0.5 * (speed + before * episode.approach_pace) * period
        turn = distance * curvature
        chord = distance if abs(turn) < 1e-9 else distance * math.sin(0.5 * turn) / (0.5 * turn)
        direction = episode.vehicle_heading - 0.5 * turn
        episode.vehicle_x -= chord * math.cos(direction)
        episode.vehicle_y -= chord * math.sin(direction)
        episode.vehicle_heading -= turn
        episode.pedestrian_x -= episode.pedestrian_vx * period
        episode.pedestrian_y -= episode.pedestrian_vy * period
        way += distance
    episode.action_heading = episode.vehicle_heading
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    episode.route_s, _ = project(*lane, episode.vehicle_x, episode.vehicle_y, episode.route_s - way)
    route = tables.walk, episode.table, row.walk_count, row.walk_step
    episode.pedestrian_s, _ = project(*route, episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_s)
    return right


@kernel
def _curvttc(episode):  # type: ignore[no-untyped-def]
    car = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.vehicle_speed
    walker = episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy
    size = VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS, HORIZON
    return curvttc_pair(*car, episode.vehicle_curvature, *walker, *size)
