"""Where an episode begins: a pure function of (seed, scenario, episode number).

The vehicle starts on its lane at a drawn place, speed and throttle. The pedestrian starts so that, at its own drawn
speed, it needs a drawn time to reach the lane: on its way across the road already, or, where that would lie behind the
start of its route, waiting there for the rest of the time. So slow and fast pedestrians meet the vehicle alike often.
"""

import math

from numba import uint64

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.config import VEHICLE_DRIVERS
from vpsci_ros.world.counter_rng import STREAM_SPAWN, philox, unit
from vpsci_ros.world.human_spawn import spawn_people
from vpsci_ros.world.paths import nearest, point_at
from vpsci_ros.world.state import NONE, RUNNING

REPLAY = VEHICLE_DRIVERS.index("replay")  # the same for both agents


@kernel
def _between(low: float, high: float, share: float) -> float:
    return low + share * (high - low)


@kernel
def spawn(episode, table, number, seed, tables, human):  # type: ignore[no-untyped-def]
    """Make an EPISODE record that of episode `number` of scenario `tables.rows[table]`, at its frame 0."""
    row = tables.rows[table]
    scenario = uint64(row.number)
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
    if human:
        spawn_people(episode, table, row, tables, seed)
        return
    first = philox(uint64(seed), scenario, uint64(0), uint64(STREAM_SPAWN), uint64(number), uint64(0))
    second = philox(uint64(seed), scenario, uint64(1), uint64(STREAM_SPAWN), uint64(number), uint64(0))
    _place_vehicle(episode, table, row, tables, first)
    _place_pedestrian(episode, table, row, tables, second, unit(first[3]))


@kernel
def _place_vehicle(episode, table, row, tables, bits):  # type: ignore[no-untyped-def]
    s = _between(row.lowest_s, row.highest_s, unit(bits[0]))
    throttle = _between(row.lowest_throttle, row.highest_throttle, unit(bits[1]))
    share = _between(row.lowest_initial, row.highest_initial, unit(bits[2]))
    x, y = point_at(tables.lane, table, row.lane_count, row.lane_step, s)
    behind_x, behind_y = point_at(tables.lane, table, row.lane_count, row.lane_step, s - 0.5 * row.lane_step)
    ahead_x, ahead_y = point_at(tables.lane, table, row.lane_count, row.lane_step, s + 0.5 * row.lane_step)
    sample = min(max(int(s / row.lane_step), 0), row.lane_count - 1)
    speed = share * throttle * row.full_throttle_speed
    episode.route_s, episode.cruise_throttle = s, throttle
    episode.vehicle_x, episode.vehicle_y = x, y
    episode.vehicle_heading = episode.action_heading = math.atan2(ahead_y - behind_y, ahead_x - behind_x)
    episode.vehicle_speed = min(speed, tables.lane_speed[table, sample])
    episode.vehicle_curvature = 0.0


@kernel
def _place_pedestrian(episode, table, row, tables, bits, standing):  # type: ignore[no-untyped-def]
    speed = _between(row.lowest_speed, row.highest_speed, unit(bits[0]))
    arrival = _between(row.lowest_arrival, row.highest_arrival, unit(bits[1]))
    offset = _between(row.lowest_offset, row.highest_offset, unit(bits[2]))
    s = row.conflict - speed * arrival
    delay = 0.0
    if s < standing * row.standing_room:
        s = standing * row.standing_room
        delay = arrival - (row.conflict - s) / speed
    x, y = point_at(tables.walk, table, row.walk_count, row.walk_step, s)
    ahead_x, ahead_y = point_at(tables.walk, table, row.walk_count, row.walk_step, s + row.walk_step)
    ux, uy = (ahead_x - x) / row.walk_step, (ahead_y - y) / row.walk_step
    pace = speed if delay <= 0.0 else 0.0
    episode.pedestrian_s, episode.pedestrian_offset = s, offset
    episode.walking_speed, episode.start_delay = speed, max(delay, 0.0)
    episode.pedestrian_x, episode.pedestrian_y = x - offset * uy, y + offset * ux
    episode.pedestrian_vx, episode.pedestrian_vy = pace * ux, pace * uy


@kernel
def spawn_all(state, slots, table_of, numbers, seeds, tables, recordings, recording_of, settings):  # type: ignore[no-untyped-def]
    """Start episode `numbers[k]` of scenario row `table_of[k]` and uint64 `seeds[k]` in slot `slots[k]`."""
    for k in range(slots.size):
        episode = state[slots[k]]
        spawn(episode, table_of[k], numbers[k], seeds[k], tables, settings.human)
        episode.recording = recording_of[k]
        row = tables.rows[table_of[k]]
        if settings.vehicle_driver == REPLAY:
            x, y, heading, speed, curvature = recordings.vehicle[recording_of[k], 0]
            episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading = x, y, heading
            episode.vehicle_speed, episode.vehicle_curvature = speed, curvature
            episode.route_s = nearest(tables.lane, table_of[k], row.lane_count, row.lane_step, x, y)
        if settings.pedestrian_driver == REPLAY:
            x, y, vx, vy = recordings.pedestrian[recording_of[k], 0]
            episode.pedestrian_x, episode.pedestrian_y = x, y
            episode.pedestrian_vx, episode.pedestrian_vy = vx, vy
            episode.pedestrian_s = nearest(tables.walk, table_of[k], row.walk_count, row.walk_step, x, y)
