"""How an episode begins: a pure function of (seed, scenario, episode number) and the pedestrian's number.

A file of `spawns` draws the positions and motions of vehicle and pedestrians. Each kernel here does one step of a start
and is compiled only where an episode needs that step.
"""

import math

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.crowd import (
    FOLLOWER,
    GROUP,
    OPPOSITE,
    ROOM,
    crowded,
    how_many,
    role_of,
    share_vehicle,
    step_off,
    step_off_after,
    walk_along,
)
from vpsci_ros.world.drivers import REPLAY, walker
from vpsci_ros.world.kinds import draw_kind
from vpsci_ros.world.kinematics import move_pedestrian
from vpsci_ros.world.paths import nearest, project
from vpsci_ros.world.spawns import begin, join, put
from vpsci_ros.world.spawns.approach import step_towards
from vpsci_ros.world.state import NONE, RUNNING, STARTED

_TRIES = 16  # steps back until a pedestrian has room to begin


@kernel
def _reset(episode, table, row, number, pedestrian):  # type: ignore[no-untyped-def]
    """Make an EPISODE record that of a pedestrian in episode `number` of a scenario, at frame 0."""
    episode.pedestrian = pedestrian
    episode.kind = episode.role = episode.struck = 0
    episode.driver_onset = episode.walker_onset = 0
    episode.follow_delay = episode.reaction_delay = episode.clock = 0.0
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
def begin_all(state, slots, table_of, numbers, seeds, recording_of, tables, crowd, settings, drives, bits):  # type: ignore[no-untyped-def]
    """Start episode `numbers[k]` of scenario row `table_of[k]` and uint64 `seeds[k]` in row `slots[k]` of EPISODE[B].

    It has one pedestrian. uint16[B] `bits` gets 1 << STARTED in this row.

    :param drives: float64[n] [s], gets the time that the car needs to the crossing.
    """
    for k in range(slots.size):
        episode, row = state[slots[k]], tables.rows[table_of[k]]
        _reset(episode, table_of[k], row, numbers[k], 0)
        draw_kind(episode, seeds[k], crowd.kinds)
        drives[k] = begin(settings.spawn, episode, row, tables, seeds[k], settings.period)
        episode.pedestrians, episode.recording = 1, recording_of[k]
        bits[slots[k]] = 1 << STARTED


@kernel
def join_all(state, slots, seeds, tables, crowd, settings, drives, bits):  # type: ignore[no-untyped-def]
    """Add further pedestrians, in the rows after `slots[k]`, to the episodes that `begin_all` has started."""
    for k in range(slots.size):
        first = slots[k]
        count = how_many(state[first], seeds[k], crowd)
        for i in range(first + 1, first + count):
            _join(state, first, i, seeds[k], tables, crowd, settings.spawn, drives[k])
        for i in range(first, first + count):
            state[i].pedestrians, state[i].recording = count, state[first].recording
            bits[i] = 1 << STARTED


@kernel
def _join(state, first, i, seed, tables, crowd, which, drives):  # type: ignore[no-untyped-def]
    """Make row `i` of EPISODE[B] a further pedestrian of the episode that begins in row `first`."""
    leader, episode = state[first], state[i]
    _reset(episode, leader.table, tables.rows[leader.table], leader.episode, i - first)
    role = episode.role = role_of(episode, seed, crowd)
    if role == OPPOSITE:
        episode.table += tables.rows.size // 2
    row = tables.rows[episode.table]
    draw_kind(episode, seed, crowd.kinds)
    join(which, episode, leader, row, tables, seed, drives)
    s = episode.pedestrian_s
    if role == GROUP:
        s = walk_along(episode, leader, seed)
    elif role == FOLLOWER:
        s = step_off_after(episode, leader, seed, row.standing_room)
    if role in (GROUP, FOLLOWER):
        put(which, episode, row, tables, s)
    for _ in range(_TRIES):
        if not crowded(state, first, i):
            break
        s -= ROOM
        put(which, episode, row, tables, s)
    share_vehicle(leader, episode)


@kernel
def _give_head_start(state, first, count, tables, settings, ticks, straight):  # type: ignore[no-untyped-def]
    """Put the pedestrians in `count` rows of EPISODE[B] from `first` on where they are `ticks` later than drawn.

    They have walked as walkers do, and then straight on for `straight` [s]. With negative `ticks` they come from where
    their velocity brings them to the drawn place in time.
    """
    for tick in range(max(0, ticks)):
        step_off(state, first, count, settings.period)
        for i in range(first, first + count):
            ax, ay, smooth = walker.pedestrian(state[i], i, None, tables, settings)
            if smooth:
                ax, ay = step_towards(state[i], ax, ay, settings.period)
            state[i].clock = (tick + 1) * settings.period
            move_pedestrian(state[i], ax, ay, settings)
            _project(state[i], tables)
    if ticks < 0:
        for i in range(first, first + count):
            state[i].clock = ticks * settings.period
            state[i].pedestrian_x += state[i].clock * state[i].pedestrian_vx
            state[i].pedestrian_y += state[i].clock * state[i].pedestrian_vy
            _project(state[i], tables)
    for i in range(first, first + count):
        state[i].pedestrian_x += straight * state[i].pedestrian_vx
        state[i].pedestrian_y += straight * state[i].pedestrian_vy
        _project(state[i], tables)
        state[i].pedestrian_path = 0.0
        for _ in range(_TRIES if i > first else 0):
            pace = math.hypot(state[i].pedestrian_vx, state[i].pedestrian_vy)
            if pace == 0.0 or not crowded(state, first, i):
                break
            state[i].pedestrian_x -= ROOM * state[i].pedestrian_vx / pace
            state[i].pedestrian_y -= ROOM * state[i].pedestrian_vy / pace
            _project(state[i], tables)


@kernel
def _project(episode, tables):  # type: ignore[no-untyped-def]
    row = tables.rows[episode.table]
    route = tables.walk, episode.table, row.walk_count, row.walk_step
    place = episode.pedestrian_x, episode.pedestrian_y
    episode.pedestrian_s, _ = project(*route, *place, episode.pedestrian_s)


@kernel
def give_head_starts(state, slots, ahead, tables, settings):  # type: ignore[no-untyped-def]
    """Move the pedestrians of started episodes on by `ahead`, float64[n, 2] [s], see `_give_head_start`."""
    for k in range(slots.size):
        first, ticks = slots[k], round(ahead[k, 0] / settings.period)
        if ahead[k, 0] != 0.0 or ahead[k, 1] != 0.0:
            _give_head_start(state, first, state[first].pedestrians, tables, settings, ticks, ahead[k, 1])


@kernel
def place_recorded(state, slots, tables, recordings, settings):  # type: ignore[no-untyped-def]
    """Put the agents of started episodes whose driver is replay where their recordings begin."""
    for first in slots:
        episode = state[first]
        row, recording = tables.rows[episode.table], episode.recording
        if settings.vehicle_driver == REPLAY:
            x, y, heading, speed, curvature = recordings.vehicle[recording, 0]
            episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading = x, y, heading
            episode.vehicle_speed, episode.vehicle_curvature = speed, curvature
            episode.route_s = nearest(tables.lane, episode.table, row.lane_count, row.lane_step, x, y)
            for i in range(first + 1, first + episode.pedestrians):
                share_vehicle(episode, state[i])
        if settings.pedestrian_driver == REPLAY:
            x, y, vx, vy = recordings.pedestrian[recording, 0]
            episode.pedestrian_x, episode.pedestrian_y = x, y
            episode.pedestrian_vx, episode.pedestrian_vy = vx, vy
            episode.pedestrian_s = nearest(tables.walk, episode.table, row.walk_count, row.walk_step, x, y)
