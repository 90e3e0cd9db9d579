"""The spawn: a pure function of (seed, scenario, episode number) and the pedestrian's number.

The vehicle starts on its lane at a drawn place, speed and throttle. The pedestrian starts so that, at its own drawn
speed, it needs a drawn time to reach the lane: already on its way, or waiting at the start of its route for the rest of
the time. So slow and fast pedestrians meet the vehicle equally often.
"""

import math

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.config import VEHICLE_DRIVERS
from vpsci_ros.world.counter_rng import STREAM_SPAWN, draw, unit
from vpsci_ros.world.crowd import (
    FOLLOWER,
    GROUP,
    OPPOSITE,
    ROOM,
    crowded,
    draw_kind,
    how_many,
    role_of,
    share_vehicle,
    speed_of_kind,
    step_off_after,
    walk_along,
)
from vpsci_ros.world.human_spawn import join_people, put_walker, spawn_people
from vpsci_ros.world.paths import line_at, nearest, point_at
from vpsci_ros.world.right_turns import spawn_right_turn
from vpsci_ros.world.state import NONE, RUNNING, STARTED

REPLAY = VEHICLE_DRIVERS.index("replay")  # the same for both agents
_TRIES = 16  # steps back until a pedestrian has room to begin


@kernel
def _between(low: float, high: float, share: float) -> float:
    return low + share * (high - low)


@kernel
def _begin(episode, table, row, number, pedestrian):  # type: ignore[no-untyped-def]
    """Make an EPISODE record that of a pedestrian in episode `number` of a scenario, at frame 0."""
    episode.pedestrian = pedestrian
    episode.kind = episode.role = episode.struck = 0
    episode.driver_onset = episode.walker_onset = 0
    episode.follow_delay = episode.reaction_delay = 0.0
    episode.scenario, episode.episode, episode.table = row.number, number, table
    episode.status, episode.outcome = RUNNING, NONE
    episode.frame = episode.hold = episode.step = 0
    episode.controlled = episode.vehicle_held = episode.pedestrian_held = 0
    episode.vehicle_goal = episode.pedestrian_goal = 0
    episode.vehicle_long = episode.vehicle_lat = episode.pedestrian_long = episode.pedestrian_lat = 0.0
    episode.steer = episode.throttle = episode.brake = episode.vehicle_acceleration = 0.0
    episode.least_curvttc = math.inf
    episode.vehicle_path = episode.pedestrian_path = 0.0
    episode.pedestrian_ax = episode.pedestrian_ay = 0.0


@kernel
def spawn(state, first, table, number, seed, tables, crowd, human, turning, period):  # type: ignore[no-untyped-def]
    """Make the rows of EPISODE[B] from `first` on those of an episode of scenario `tables.rows[table]`, at frame 0.

    Return how many there are, one a pedestrian.
    """
    leader, row, drives = state[first], tables.rows[table], 0.0
    _begin(leader, table, row, number, 0)
    draw_kind(leader, seed, crowd.kinds)
    if turning:
        drives = spawn_right_turn(leader, row, tables, seed, period)
    elif human:
        drives = spawn_people(leader, row, tables, seed)
    else:
        _place_vehicle(leader, row, tables, seed)
        _place_pedestrian(leader, row, tables, seed)
    count = how_many(leader, seed, crowd)
    for i in range(first + 1, first + count):
        _join(state, first, i, seed, tables, crowd, human, drives, turning)
    for i in range(first, first + count):
        state[i].pedestrians = count
    return count


@kernel
def _join(state, first, i, seed, tables, crowd, human, drives, turning):  # type: ignore[no-untyped-def]
    """Make row `i` of EPISODE[B] a further pedestrian of the episode that begins in row `first`."""
    leader, episode = state[first], state[i]
    _begin(episode, leader.table, tables.rows[leader.table], leader.episode, i - first)
    role = episode.role = role_of(episode, seed, crowd)
    if role == OPPOSITE:
        episode.table += tables.rows.size // 2
    row = tables.rows[episode.table]
    draw_kind(episode, seed, crowd.kinds)
    if human:
        join_people(episode, leader, row, tables, seed, drives, turning)
    else:
        _place_pedestrian(episode, row, tables, seed)
    s = episode.pedestrian_s
    if role == GROUP:
        s = walk_along(episode, leader, seed)
    elif role == FOLLOWER:
        s = step_off_after(episode, leader, seed, row.standing_room)
    if role in (GROUP, FOLLOWER):
        _put(episode, row, tables, s, human)
    for _ in range(_TRIES):
        if not crowded(state, first, i):
            break
        s -= ROOM
        _put(episode, row, tables, s, human)
    share_vehicle(leader, episode)


@kernel
def _put(episode, row, tables, s, human):  # type: ignore[no-untyped-def]
    if human:
        put_walker(episode, row, tables, s, 0.0)
    else:
        _put_on_route(episode, row, tables, s)


@kernel
def _place_vehicle(episode, row, tables, seed):  # type: ignore[no-untyped-def]
    bits = draw(episode, seed, STREAM_SPAWN, 0)
    s = _between(row.lowest_s, row.highest_s, unit(bits[0]))
    throttle = _between(row.lowest_throttle, row.highest_throttle, unit(bits[1]))
    share = _between(row.lowest_initial, row.highest_initial, unit(bits[2]))
    lane = tables.lane, episode.table, row.lane_count, row.lane_step
    x, y = point_at(*lane, s)
    behind_x, behind_y = point_at(*lane, s - 0.5 * row.lane_step)
    ahead_x, ahead_y = point_at(*lane, s + 0.5 * row.lane_step)
    sample = min(max(int(s / row.lane_step), 0), row.lane_count - 1)
    speed = share * throttle * row.full_throttle_speed
    episode.route_s, episode.cruise_throttle = s, throttle
    episode.vehicle_x, episode.vehicle_y = x, y
    episode.vehicle_heading = episode.action_heading = math.atan2(ahead_y - behind_y, ahead_x - behind_x)
    episode.vehicle_speed = min(speed, tables.lane_speed[episode.table, sample])
    episode.vehicle_curvature = 0.0


@kernel
def _place_pedestrian(episode, row, tables, seed):  # type: ignore[no-untyped-def]
    bits, standing = draw(episode, seed, STREAM_SPAWN, 1), unit(draw(episode, seed, STREAM_SPAWN, 0)[3])
    speed = speed_of_kind(episode, seed, _between(row.lowest_speed, row.highest_speed, unit(bits[0])))
    arrival = _between(row.lowest_arrival, row.highest_arrival, unit(bits[1]))
    offset = _between(row.lowest_offset, row.highest_offset, unit(bits[2]))
    s = row.conflict - speed * arrival
    delay = 0.0
    if s < standing * row.standing_room:
        s = standing * row.standing_room
        delay = arrival - (row.conflict - s) / speed
    episode.pedestrian_offset, episode.walking_speed, episode.start_delay = offset, speed, max(delay, 0.0)
    _put_on_route(episode, row, tables, s)


@kernel
def _put_on_route(episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Put the pedestrian beside its route at arc length `s` [m], walking unless it still waits."""
    x, y, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, s)
    pace, offset = 0.0 if episode.start_delay > 0.0 else episode.walking_speed, episode.pedestrian_offset
    episode.pedestrian_s = s
    episode.pedestrian_x, episode.pedestrian_y = x - offset * uy, y + offset * ux
    episode.pedestrian_vx, episode.pedestrian_vy = pace * ux, pace * uy


@kernel
def spawn_all(state, slots, table_of, numbers, seeds, tables, recordings, recording_of, settings, crowd, bits):  # type: ignore[no-untyped-def]
    """Start episode `numbers[k]` of scenario row `table_of[k]` and uint64 `seeds[k]` in the rows from `slots[k]` on.

    uint16[B] `bits` gets 1 << STARTED in each row that an episode takes.
    """
    for k in range(slots.size):
        first = slots[k]
        episode = state[first]
        drawn = settings.human, settings.turning, settings.period
        count = spawn(state, first, table_of[k], numbers[k], seeds[k], tables, crowd, *drawn)
        for i in range(first, first + count):
            state[i].recording = recording_of[k]
            bits[i] = 1 << STARTED
        row = tables.rows[table_of[k]]
        if settings.vehicle_driver == REPLAY:
            x, y, heading, speed, curvature = recordings.vehicle[recording_of[k], 0]
            episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading = x, y, heading
            episode.vehicle_speed, episode.vehicle_curvature = speed, curvature
            episode.route_s = nearest(tables.lane, episode.table, row.lane_count, row.lane_step, x, y)
            for i in range(first + 1, first + count):
                share_vehicle(episode, state[i])
        if settings.pedestrian_driver == REPLAY:
            x, y, vx, vy = recordings.pedestrian[recording_of[k], 0]
            episode.pedestrian_x, episode.pedestrian_y = x, y
            episode.pedestrian_vx, episode.pedestrian_vy = vx, vy
            episode.pedestrian_s = nearest(tables.walk, episode.table, row.walk_count, row.walk_step, x, y)
