"""The walker: follows its route at its speed and does not react to the vehicle.

With the spawns `right_turns` and `human` it walks along a line of its own; an episode of `right_turns` follows the
recorded pedestrian until the onset.
"""

import math

from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.paths import line_at
from vpsci_ros.world.spawns import as_recorded
from vpsci_ros.world.spawns.approach import line_offset, onset_time, walker_speed, walks_then

WALK_ACCELERATION = 2.5  # [m/s2] with which the walker changes its velocity
WALK_LOOK_AHEAD = 2.0  # [m]


@inlined
def clock(episode, settings):  # type: ignore[no-untyped-def]
    """Return the time [s] by which the pedestrian's motion is drawn: since the spawn, unless its head start was set."""
    return episode.frame * settings.period + episode.clock


@inlined
def early(episode, settings):  # type: ignore[no-untyped-def]
    """Whether the drawn motion of the pedestrian is still to begin: it keeps its velocity until then."""
    return clock(episode, settings) < -0.5 * settings.period


@inlined
def waits(episode, settings):  # type: ignore[no-untyped-def]
    """Whether the pedestrian still waits at the kerb."""
    return clock(episode, settings) < episode.start_delay


@inlined
def pace(episode, settings):  # type: ignore[no-untyped-def]
    """Return the speed [m/s] at which the pedestrian walks now, if it neither waits nor stands at its goal."""
    if as_recorded(settings.spawn, episode):
        return walker_speed(episode, clock(episode, settings))
    return episode.walking_speed


@inlined
def wanted(episode, speed, tables, settings):  # type: ignore[no-untyped-def]
    """Return the velocity (vx, vy) [m/s] with which a walker follows its route at `speed` [m/s]; 0 where it stands."""
    row, offset = tables.rows[episode.table], episode.pedestrian_offset
    if as_recorded(settings.spawn, episode):
        offset = line_offset(episode, row, episode.pedestrian_s + WALK_LOOK_AHEAD)
    route = tables.walk, episode.table, row.walk_count, row.walk_step
    speed = 0.0 if waits(episode, settings) or (episode.pedestrian_goal and not settings.walk_on) else speed
    return walk_velocity(*route, episode.pedestrian_s, offset, episode.pedestrian_x, episode.pedestrian_y, speed)


@inlined
def pedestrian(episode, _i, _answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] that the walker intends, and whether the limit of its jerk applies."""
    vx, vy = episode.pedestrian_vx, episode.pedestrian_vy
    if early(episode, settings):
        return 0.0, 0.0, False
    then = (episode.frame + 1) * settings.period + episode.clock
    if episode.walker_onset:
        onset = tables.onsets[episode.walker_onset - 1]
        if then < onset_time(onset) + 0.5 * settings.period:
            next_vx, next_vy = walks_then(episode, onset, then)
            return (next_vx - vx) / settings.period, (next_vy - vy) / settings.period, False
    wanted_x, wanted_y = wanted(episode, pace(episode, settings), tables, settings)
    recorded = as_recorded(settings.spawn, episode)
    most = episode.stride if recorded else WALK_ACCELERATION
    ax, ay = walk_acceleration(wanted_x - vx, wanted_y - vy, most, settings.period)
    return ax, ay, recorded


@kernel
def walk_velocity(points, row, count, step, s, offset, x, y, speed):  # type: ignore[no-untyped-def]
    """Velocity (east, north) [m/s] of a walker at (x, y) that walks `offset` [m] to the left of its route."""
    here_x, here_y, ux, uy = line_at(points, row, count, step, s + WALK_LOOK_AHEAD)
    dx, dy = here_x - offset * uy - x, here_y + offset * ux - y
    distance = math.sqrt(dx * dx + dy * dy)
    return speed * dx / distance, speed * dy / distance


@kernel
def walk_acceleration(change_x: float, change_y: float, most: float, period: float) -> tuple[float, float]:
    """Acceleration (ax, ay) [m/s2] that changes the velocity by this [m/s] in a tick, of `most` [m/s2] at most."""
    change = math.sqrt(change_x * change_x + change_y * change_y)
    scale = 1.0 / period if change <= most * period else most / change
    return change_x * scale, change_y * scale
