"""The spawn of section 3.2 of the paper.

The vehicle starts on its lane at a drawn place, speed and throttle. The pedestrian starts so that, at its own drawn
speed, it needs a drawn time to reach the lane: already on its way, or waiting at the start of its route for the rest of
the time. So slow and fast pedestrians meet the vehicle equally often.
"""

import math

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_SPAWN, draw, unit
from vpsci_ros.world.kinds import speed_of_kind
from vpsci_ros.world.paths import line_at, point_at


@kernel
def begin(episode, row, tables, seed, _period):  # type: ignore[no-untyped-def]
    """Draw vehicle and pedestrian and place both at the spawn; return 0, an unused time."""
    _place_vehicle(episode, row, tables, seed)
    _place_walker(episode, row, tables, seed)
    return 0.0


@kernel
def join(episode, _leader, row, tables, seed, _drives):  # type: ignore[no-untyped-def]
    """Draw a further pedestrian, which meets the car as the first one does."""
    _place_walker(episode, row, tables, seed)


@kernel
def _between(low: float, high: float, share: float) -> float:
    return low + share * (high - low)


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
def _place_walker(episode, row, tables, seed):  # type: ignore[no-untyped-def]
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
    put(episode, row, tables, s)


@kernel
def put(episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Put the pedestrian beside its route at arc length `s` [m], walking unless it still waits."""
    x, y, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, s)
    pace, offset = 0.0 if episode.start_delay > 0.0 else episode.walking_speed, episode.pedestrian_offset
    episode.pedestrian_s = s
    episode.pedestrian_x, episode.pedestrian_y = x - offset * uy, y + offset * ux
    episode.pedestrian_vx, episode.pedestrian_vy = pace * ux, pace * uy
