"""One tick of one episode after another: the compiled part of `World.advance`.

Each episode is computed by the same scalar code from its own records alone, one a pedestrian. So its bits do not depend
on the batch, on its slot or on the number of threads. No sum runs over episodes.
"""

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, contact_in_step
from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.crowd import share_action, share_motion, step_off
from vpsci_ros.world.drivers import EXTERNAL, POLICY, REPLAY, acceleration, controls, replay
from vpsci_ros.world.drivers.social_force import keep_apart
from vpsci_ros.world.handover import update
from vpsci_ros.world.kinematics import move_pedestrian, move_vehicle
from vpsci_ros.world.paths import project
from vpsci_ros.world.spawns import limit_of, release_of
from vpsci_ros.world.state import (
    COLLISION,
    ENDED,
    FINISHED,
    GOAL,
    NONE,
    PEDESTRIAN_ACTION_MISSING,
    RUNNING,
    SAFETY_MISSING,
    TIMEOUT,
    VEHICLE_ACTION_MISSING,
)

_REACH = 0.5 * (VEHICLE_LENGTH + VEHICLE_WIDTH) + PEDESTRIAN_RADIUS  # [m] between centres: further apart none touch
PLACES = 5  # of a pair: x, y [m] and heading [rad] of the vehicle, x, y [m] of the pedestrian


@inlined
def _awaited(driver, policy_frame):  # type: ignore[no-untyped-def]
    """Return whether an agent has to answer: an external one always, a policy at every policy frame."""
    return driver == EXTERNAL or (driver == POLICY and policy_frame)


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
    kind = update(episode, critical, answers.policy_frame[i], acts, release_of(settings, episode))
    if kind:
        events |= 1 << kind
    if acts:
        episode.step += 1
        episode.action_heading = episode.vehicle_heading
    if settings.vehicle_driver == POLICY and acts:
        episode.vehicle_held = len(answers.vehicle_action) > 0
        if episode.vehicle_held:
            episode.vehicle_long, episode.vehicle_lat = answers.vehicle_action[i, 0], answers.vehicle_action[i, 1]
    driven = len(answers.vehicle_action) > 0 or len(answers.vehicle_control) > 0
    if _awaited(settings.vehicle_driver, answers.policy_frame[i]) and not driven:
        events |= 1 << VEHICLE_ACTION_MISSING
    if settings.pedestrian_driver == POLICY and acts:
        since = (episode.step - 1) * settings.policy_ticks * settings.period
        episode.pedestrian_held = len(answers.pedestrian_action) > 0 and since >= episode.reaction_delay
        if episode.pedestrian_held:
            episode.pedestrian_long = answers.pedestrian_action[i, 0]
            episode.pedestrian_lat = answers.pedestrian_action[i, 1]
    if _awaited(settings.pedestrian_driver, answers.policy_frame[i]) and not len(answers.pedestrian_action):
        events |= 1 << PEDESTRIAN_ACTION_MISSING
    return events


@inlined
def note_places(episode, places):  # type: ignore[no-untyped-def]
    """Write where vehicle and pedestrian are into float64[PLACES]."""
    places[0], places[1], places[2] = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
    places[3], places[4] = episode.pedestrian_x, episode.pedestrian_y


@inlined
def _move(state, first, count, answers, tables, recordings, settings, pushes):  # type: ignore[no-untyped-def]
    """Move the vehicle and the pedestrians of the episode in rows `first` to `first + count`."""
    steer, throttle, brake = 0.0, 0.0, 0.0
    if settings.vehicle_driver != REPLAY:  # all of them see the others before anybody moves
        steer, throttle, brake = controls(state, first, count, answers, tables, settings)
    if count > 1:
        keep_apart(state, first, count, pushes)
        step_off(state, first, count, settings.period)
    for i in range(first, first + count):
        if settings.pedestrian_driver == REPLAY:
            replay.pedestrian(state[i], recordings, settings)
        else:
            ax, ay = acceleration(state[i], i, answers, tables, settings, pushes)
            move_pedestrian(state[i], ax, ay, settings)
    if settings.vehicle_driver == REPLAY:
        replay.vehicle(state[first], recordings, settings.period)
    else:
        move_vehicle(state[first], steer, throttle, brake, settings.period)


@inlined
def _locate_vehicle(episode, tables):  # type: ignore[no-untyped-def]
    """Update the vehicle's arc length along its lane, and note whether it has reached its goal."""
    row = tables.rows[episode.table]
    x, y = episode.vehicle_x, episode.vehicle_y
    episode.route_s, _ = project(tables.lane, episode.table, row.lane_count, row.lane_step, x, y, episode.route_s)
    if episode.route_s >= row.vehicle_goal:
        episode.vehicle_goal = 1


@kernel
def _touched(episode, before):  # type: ignore[no-untyped-def]
    """Return whether vehicle and pedestrian have touched since they were at the places `before`, float64[PLACES]."""
    after = (episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.pedestrian_x, episode.pedestrian_y)
    return contact_in_step(before, after, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS) <= 1.0


@inlined
def _locate_pedestrian(episode, before, tables):  # type: ignore[no-untyped-def]
    """Count the frame, update the pedestrian's arc length, and note goal reached and contact since the frame before."""
    row = tables.rows[episode.table]
    episode.frame += 1
    route, x, y = (
        (tables.walk, episode.table, row.walk_count, row.walk_step),
        episode.pedestrian_x,
        episode.pedestrian_y,
    )
    episode.pedestrian_s, _ = project(*route, x, y, episode.pedestrian_s)
    if episode.pedestrian_s >= row.pedestrian_goal:
        episode.pedestrian_goal = 1
    dx, dy = x - episode.vehicle_x, y - episode.vehicle_y
    reach = _REACH + abs(dx - before[3] + before[0]) + abs(dy - before[4] + before[1])
    if dx * dx + dy * dy < reach * reach and _touched(episode, before):  # the test costs two sines and cosines
        episode.struck = 1
        episode.least_curvttc = 0.0


@inlined
def _arrive(state, first, count, before, tables, settings):  # type: ignore[no-untyped-def]
    """Locate all agents at the new frame; return the outcome of the episode, NONE while it runs."""
    leader = state[first]
    _locate_vehicle(leader, tables)
    struck, arrived = 0, leader.vehicle_goal
    for i in range(first, first + count):
        if i > first:
            share_motion(leader, state[i])
        _locate_pedestrian(state[i], before[i], tables)
        struck |= state[i].struck
        arrived &= state[i].pedestrian_goal
    if struck:
        return COLLISION
    if arrived:
        return GOAL
    return TIMEOUT if leader.frame >= limit_of(settings, leader) else NONE


@kernel
def decide(state, answers, settings, events):  # type: ignore[no-untyped-def]
    """Hand-over and bookkeeping at this tick for EPISODE[B]; events uint16[B] gets bits 1 << kind."""
    for i in range(state.size):
        events[i] = _decide(state[i], i, answers, settings) if state[i].status == RUNNING else 0
    if settings.pedestrians > 1 and settings.vehicle_driver == POLICY:
        for first in range(0, state.size, settings.pedestrians):
            share_action(state, first, state[first].pedestrians, answers)


@inlined
def _finish(state, first, count, before, tables, settings, events):  # type: ignore[no-untyped-def]
    """Locate all agents of a running episode at the new frame, and end it if it is over."""
    outcome = _arrive(state, first, count, before, tables, settings)
    if outcome != NONE:
        for i in range(first, first + count):
            state[i].outcome, state[i].status = outcome, ENDED
            events[i] = 1 << FINISHED


@inlined
def _advance(state, first, count, answers, tables, recordings, settings, pushes, before, events):  # type: ignore[no-untyped-def]
    """Move a running episode in rows `first` to `first + count` to the next tick, and end it if it is over."""
    for i in range(first, first + count):
        note_places(state[i], before[i])
    _move(state, first, count, answers, tables, recordings, settings, pushes)
    _finish(state, first, count, before, tables, settings, events)


@kernel
def move_one(state, answers, tables, recordings, settings, pushes, before, events):  # type: ignore[no-untyped-def]
    """Move EPISODE[B] of one pedestrian each by a tick, end those that are over; events uint16[B] gets 1 << kind.

    `move_one` does the same as `move_several`, without the loops over rows. Runs with one pedestrian an episode do not
    compile `move_several`.

    :param before: float64[B, PLACES], scratch memory, as `pushes` is.
    """
    for i in range(state.size):
        events[i] = 0
        if state[i].status == RUNNING:
            _advance(state, i, 1, answers, tables, recordings, settings, pushes, before, events)


@kernel
def move_several(state, answers, tables, recordings, settings, pushes, before, events):  # type: ignore[no-untyped-def]
    """Move EPISODE[B], `settings.pedestrians` rows an episode, by a tick, and end those that are over.

    :param pushes: float64[B, 2], `before`: float64[B, PLACES], scratch memory; events: uint16[B], gets 1 << kind.
    """
    for i in range(state.size):
        events[i] = 0
    for first in range(0, state.size, settings.pedestrians):
        if state[first].status == RUNNING:
            count = state[first].pedestrians
            _advance(state, first, count, answers, tables, recordings, settings, pushes, before, events)


@kernel
def arrive(state, before, tables, settings, events):  # type: ignore[no-untyped-def]
    """Locate the agents of running EPISODE[B], one pedestrian each, on their paths, and end those that are over.

    Another engine has set the positions that `move_one` sets otherwise; events uint16[B] gets 1 << kind.

    :param before: float64[B, PLACES], where they were at the frame before, see `note_places`.
    """
    events[:] = 0
    for i in range(state.size):
        if state[i].status == RUNNING:
            _finish(state, i, 1, before, tables, settings, events)
