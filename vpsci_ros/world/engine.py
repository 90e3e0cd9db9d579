"""One tick of one slot after another: what `World.advance` does, compiled.

Each slot is computed by the same scalar code from its own record alone, in whichever thread, so an episode's bits do
not depend on the batch, on the slot's place in it or on the number of threads. No sum runs over slots.
"""

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.drivers import (
    EXTERNAL,
    POLICY,
    REPLAY,
    controls,
    impulse,
    move_pedestrian,
    move_vehicle,
    replay_pedestrian,
    replay_vehicle,
)
from vpsci_ros.world.handover import update
from vpsci_ros.world.paths import project
from vpsci_ros.world.state import (
    COLLISION,
    ENDED,
    FINISHED,
    GOAL,
    PEDESTRIAN_ACTION_MISSING,
    RUNNING,
    SAFETY_MISSING,
    TIMEOUT,
    VEHICLE_ACTION_MISSING,
)


@inlined
def _decide(episode, i, answers, settings):  # type: ignore[no-untyped-def]
    """Bookkeeping and hand-over of a running record at its tick; return the events as bits 1 << kind."""
    events = 0
    critical = 0
    if len(answers.curvttc):
        episode.least_curvttc = min(episode.least_curvttc, answers.curvttc[i])
        critical = answers.critical[i]
    else:
        events |= 1 << SAFETY_MISSING
    acts = answers.acts[i]
    kind = update(episode, critical, answers.policy_frame[i], acts, settings.release_ticks)
    if kind:
        events |= 1 << kind
    if acts:
        episode.step += 1
        episode.action_heading = episode.vehicle_heading
    if settings.vehicle_driver == POLICY and acts:
        episode.vehicle_held = len(answers.vehicle_action) > 0
        if episode.vehicle_held:
            episode.vehicle_long, episode.vehicle_lat = answers.vehicle_action[i, 0], answers.vehicle_action[i, 1]
        else:
            events |= 1 << VEHICLE_ACTION_MISSING
    if settings.vehicle_driver == EXTERNAL and not len(answers.vehicle_action) and not len(answers.vehicle_control):
        events |= 1 << VEHICLE_ACTION_MISSING
    if settings.pedestrian_driver == POLICY and acts:
        episode.pedestrian_held = len(answers.pedestrian_action) > 0
        if episode.pedestrian_held:
            episode.pedestrian_long = answers.pedestrian_action[i, 0]
            episode.pedestrian_lat = answers.pedestrian_action[i, 1]
        else:
            events |= 1 << PEDESTRIAN_ACTION_MISSING
    if settings.pedestrian_driver == EXTERNAL and not len(answers.pedestrian_action):
        events |= 1 << PEDESTRIAN_ACTION_MISSING
    return events


@inlined
def _move(episode, i, answers, tables, recordings, settings):  # type: ignore[no-untyped-def]
    ax, ay, gain = 0.0, 0.0, 1.0
    if settings.pedestrian_driver != REPLAY:
        ax, ay, gain = impulse(episode, i, answers, tables, settings)  # sees the vehicle before it moves
    if settings.vehicle_driver == REPLAY:
        replay_vehicle(episode, recordings, settings.period)
    else:
        steer, throttle, brake = controls(episode, i, answers, tables, settings)
        move_vehicle(episode, steer, throttle, brake, settings.period)
    if settings.pedestrian_driver == REPLAY:
        replay_pedestrian(episode, recordings, settings)
    else:
        move_pedestrian(episode, ax, ay, gain, settings)


@inlined
def _arrive(episode, tables, settings):  # type: ignore[no-untyped-def]
    """Locate both agents at the new frame and end the episode there if it is over; return the events as bits."""
    episode.frame += 1
    row = tables.rows[episode.table]
    x, y = episode.vehicle_x, episode.vehicle_y
    episode.route_s, _ = project(tables.lane, episode.table, row.lane_count, row.lane_step, x, y, episode.route_s)
    episode.pedestrian_s, _ = project(
        tables.walk,
        episode.table,
        row.walk_count,
        row.walk_step,
        episode.pedestrian_x,
        episode.pedestrian_y,
        episode.pedestrian_s,
    )
    if episode.route_s >= row.vehicle_goal:
        episode.vehicle_goal = 1
    if episode.pedestrian_s >= row.pedestrian_goal:
        episode.pedestrian_goal = 1
    free = clearance_pair(
        x,
        y,
        episode.vehicle_heading,
        episode.pedestrian_x,
        episode.pedestrian_y,
        VEHICLE_LENGTH,
        VEHICLE_WIDTH,
        PEDESTRIAN_RADIUS,
    )
    if free <= 0.0:
        episode.outcome = COLLISION
        episode.least_curvttc = 0.0
    elif episode.vehicle_goal and episode.pedestrian_goal:
        episode.outcome = GOAL
    elif episode.frame >= settings.episode_ticks:
        episode.outcome = TIMEOUT
    else:
        return 0
    episode.status = ENDED
    return 1 << FINISHED


@kernel
def decide(state, answers, settings, events):  # type: ignore[no-untyped-def]
    """Hand-over and bookkeeping at this tick for EPISODE[B]; events uint16[B] gets bits 1 << kind."""
    for i in range(state.size):
        events[i] = _decide(state[i], i, answers, settings) if state[i].status == RUNNING else 0


@kernel
def move(state, answers, tables, recordings, settings, events):  # type: ignore[no-untyped-def]
    """Move EPISODE[B] to the next tick and end what is over; events uint16[B] gets bits 1 << kind."""
    for i in range(state.size):
        events[i] = 0
        if state[i].status == RUNNING:
            _move(state[i], i, answers, tables, recordings, settings)
            events[i] = _arrive(state[i], tables, settings)
