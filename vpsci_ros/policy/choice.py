"""The choice of a recorded reaction for an agent, by a roll-out of each candidate.

A reaction is drawn among those of the `NEAREST` most similar situations, evenly among the ones by which the two do not
touch within 3 s. If all these lead to contact, the nearest situation of the whole bank without contact is taken; if
there is none, the nearest by which the two do not touch where both react harder than recorded (`HARDER`); else the one
of the `NEAREST` with the latest contact. A reaction is chosen again when it ends, and as soon as its rest leads to
contact.

A reaction is what was done beyond the acceleration at the situation: to each recorded step is added by how much the
agent's own acceleration differs from the recorded one, fading by `FADES` a step. Where the own one is not known, the
reaction is the recorded one. A roll-out finds whether the two touch, or come nearer than `MARGIN`: both move by the
world's own kinematics, and keep their velocities for `BEYOND` steps where the recording ends sooner.

Driver and pedestrian draw by the same numbers and see the same, so they choose two halves of one reaction. If the other
agent deviates from the chosen reaction by more than `LEFT` (a driving system, a walker who does not look), it is
unpredicted: from then on it is assumed to keep its velocity, and only the own half is chosen. The world's limit of jerk
makes agents deviate, too.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from vpsci_ros.policy.bank import ACTIONS, FEATURES, SLOWEST, Reactions, features_of
from vpsci_ros.policy.draws import Keys
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_REACTION, philox, unit
from vpsci_ros.world.kinematics import brake_for, drive, steer_to, throttle_for, walk
from vpsci_ros.world.observation import STEP, from_heading_frame

NEAREST = 64  # situations of which one is chosen; a power of two, and fewer where a bank has fewer
WIDEST = 3.0  # the largest ratio of the vehicle's speed to the recorded one that counts, and 1 over the least
FADES = 0.95, 0.95, 0.7, 0.7  # by which a step multiplies what is added to the recorded steps, see `ACTIONS`
FADED = np.array(FADES) ** np.arange(100)[:, None]  # float64[100, 4], after so many steps; then hardly anything is left
AHEAD = 30  # steps that a roll-out looks ahead
BEYOND = 20  # steps for which both keep their velocities after a reaction
MARGIN = 0.1  # [m] between the footprints: a roll-out looks each 0.1 s, and contacts happen in between
HARDER = 1.0, 2.0, 3.0  # by which recorded actions are multiplied, in turn, until one of the whole bank avoids contact
LEFT = 0.05  # [m] by which the other agent may deviate from the chosen reaction
CLOSE = (
    math.hypot(0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH) + PEDESTRIAN_RADIUS + MARGIN + 0.01
)  # [m] none nearer beyond

NOBODY, CAR, WALKER = 0, 1, 2  # the unpredicted agent, which keeps its velocity

CHOSEN = np.dtype(  # a chosen reaction
    [
        ("begin", "i8"), ("at", "i8"), ("end", "i8"),  # steps of the bank: first, next, one past the last
        ("mirror", "f8"),  # 1; -1: left and right are exchanged
        ("hard", "f8"),  # by which recorded actions are multiplied
        ("bend", "f8"),  # by which curvatures are multiplied besides
        ("more", "f8", ACTIONS),  # own acceleration less the recorded one, which fades
        ("expected", "f8", 2),  # [m/s] velocity of the other one at the next step: forward and left; a vehicle's speed
        ("apart", "f8"),  # [m] by which the other agent has deviated since the hand-over
        ("situation", "i8"),  # number of the situation, counted from 1; 0: none yet
    ]
)  # fmt: skip


class Room(NamedTuple):
    """Working memory of `act`."""

    own: NDArray[np.float64]  # [8] features
    gaps: NDArray[np.float64]  # [M] squared distances of features
    near: NDArray[np.int64]  # [n] the nearest situations, the nearest first
    trial: NDArray[np.void]  # CHOSEN[1]
    done: NDArray[np.float64]  # [4] see `ACTIONS`


@kernel
def _done(chosen, steps, at, out):  # type: ignore[no-untyped-def]
    """Write the actions of both agents at step `at` of the bank to float64[4], see `ACTIONS`."""
    age = min(at - chosen.begin, len(FADED) - 1)
    for k in range(ACTIONS):
        recorded = steps[at, k] * chosen.hard * (chosen.mirror if k % 2 else 1.0)  # the odd ones point left
        if k == 1:
            recorded *= chosen.bend
        out[k] = recorded + chosen.more[k] * FADED[age, k]


@kernel
def _free_steps(situation, who, steps, done):  # type: ignore[no-untyped-def]
    """Return after how many steps the two touch by the rest of the chosen reaction; `AHEAD`: not within these."""
    chosen, keeps_lane, unpredicted = who
    x, y, heading, speed = 0.0, 0.0, 0.0, situation[0]  # in the vehicle's heading frame of the situation
    arc = 0.0 if math.isnan(situation[2]) else steer_to(situation[2] / max(speed, SLOWEST))
    px, py, vx, vy = situation[3], situation[4], situation[5], situation[6]
    for k in range(min(AHEAD, chosen.end + BEYOND - chosen.at)):
        done[:] = 0.0
        if chosen.at + k < chosen.end:
            _done(chosen, steps, chosen.at + k, done)
        if unpredicted == CAR:
            done[0] = done[1] = 0.0
        elif unpredicted == WALKER:
            done[2] = done[3] = 0.0
        ax, ay = from_heading_frame(heading, done[2], done[3])
        pedals = throttle_for(done[0]), brake_for(done[0])
        along = arc if abs(heading) < 0.5 * math.pi else 0.0  # the arc of the start, by 90 degrees, as in CurvTTC
        steer = along if keeps_lane else steer_to(done[1])
        x, y, heading, speed, _ = drive(x, y, heading, speed, steer, *pedals, STEP)
        px, py, vx, vy = walk(px, py, vx, vy, ax, ay, 1.0, math.inf, STEP)
        if (px - x) * (px - x) + (py - y) * (py - y) > CLOSE * CLOSE:
            continue  # most steps: a clearance costs a sine and a cosine
        if clearance_pair(x, y, heading, px, py, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS) <= MARGIN:
            return k
    return AHEAD


@kernel
def _take(situation, side, reactions, picked, hard, chosen):  # type: ignore[no-untyped-def]
    """Make `chosen` the reaction of situation `picked`, `hard` times, with the pedestrian on `side`."""
    chosen.begin = chosen.at = reactions.begin[picked]
    chosen.end, chosen.mirror = reactions.end[picked], side * reactions.side[picked]
    chosen.situation, chosen.hard = picked + 1, hard
    speed = max(situation[0], SLOWEST)
    wide = min(max(speed / max(reactions.features[0, picked] * reactions.scale[0], SLOWEST), 1.0 / WIDEST), WIDEST)
    chosen.bend = 1.0 / (wide * wide)  # the recorded sideways acceleration, not the recorded bend
    chosen.more[0], chosen.more[1] = situation[1], situation[2] / speed
    chosen.more[2], chosen.more[3] = situation[7], situation[8]
    for k in range(ACTIONS):
        recorded = reactions.before[picked, k] * (chosen.mirror if k % 2 else 1.0)
        if k == 1:
            recorded *= chosen.bend
        chosen.more[k] -= recorded
        if math.isnan(chosen.more[k]):
            chosen.more[k] = 0.0


@kernel
def _nearest(own, features, far, gaps, near):  # type: ignore[no-untyped-def]
    """Write the columns of features, float64[8, M], nearest to `own` to int64[n]; of equally near ones the first.

    :param far: float64[M], squared distances to add.
    """
    for m in range(gaps.size):
        gaps[m] = far[m]
    for k in range(FEATURES):  # feature by feature: rows of [8, M] lie together in memory
        for m in range(gaps.size):
            gap = own[k] - features[k, m]
            gaps[m] += gap * gap
    for m in range(gaps.size):
        place = min(m, near.size)
        if place == near.size:
            if gaps[m] >= gaps[near[place - 1]]:
                continue
            place -= 1
        while place > 0 and gaps[m] < gaps[near[place - 1]]:
            near[place] = near[place - 1]
            place -= 1
        near[place] = m


@kernel
def _choose(situation, key, reactions, who, free, room):  # type: ignore[no-untyped-def]
    """Make `chosen` a reaction without contact for more than `free` steps, if there is one.

    The nearest are tried in an order that the key draws, up to the first by which the two do not touch at all.
    """
    chosen, keeps_lane, unpredicted = who
    side = features_of(situation, room.own)
    for k in range(FEATURES):
        room.own[k] /= reactions.scale[k]
    _nearest(room.own, reactions.features, reactions.far, room.gaps, room.near)
    stream = uint64(STREAM_REACTION) + (key[4] << uint64(8))
    drawn = philox(key[0], key[1], uint64(0), stream, key[2], key[3])
    count = room.near.size
    # an odd stride meets each of a power of two once
    first, stride = int(unit(drawn[0]) * count), 2 * int(unit(drawn[1]) * (count // 2)) + 1
    trial, steps, picked, hard = room.trial[0], reactions.steps, -1, 1.0
    for c in range(count):
        m = room.near[(first + c * stride) % count]
        _take(situation, side, reactions, m, 1.0, trial)
        without = _free_steps(situation, (trial, keeps_lane, unpredicted), steps, room.done)
        if without > free:
            free, picked = without, m
            if free == AHEAD:
                break
    for harder in HARDER:
        if free == AHEAD:
            break
        least = math.inf
        for m in range(room.gaps.size):
            if room.gaps[m] < least:
                _take(situation, side, reactions, m, harder, trial)
                if _free_steps(situation, (trial, keeps_lane, unpredicted), steps, room.done) == AHEAD:
                    free, least, picked, hard = AHEAD, room.gaps[m], m, harder
    if picked >= 0:
        _take(situation, side, reactions, picked, hard, chosen)


@kernel
def _watch(situation, agent, chosen):  # type: ignore[no-untyped-def]
    """Add up by how much the other agent deviates from the chosen reaction."""
    if agent == 0:
        forward, left = situation[5] - chosen.expected[0], situation[6] - chosen.expected[1]
        chosen.apart += STEP * math.sqrt(forward * forward + left * left)
    else:
        chosen.apart += STEP * abs(situation[0] - chosen.expected[0])


@kernel
def _expect(situation, agent, done, chosen):  # type: ignore[no-untyped-def]
    """Carry the velocity expected of the other one on by a step, in which both do `done`, float64[4]."""
    if agent == 0:
        forward, left = chosen.expected[0] + STEP * done[2], chosen.expected[1] + STEP * done[3]
        turned = 0.0 if math.isnan(situation[2]) else STEP * situation[2]  # the heading frame turns with the vehicle
        chosen.expected[0], chosen.expected[1] = forward + turned * left, left - turned * forward
    else:
        chosen.expected[0] = max(0.0, chosen.expected[0] + STEP * done[0])


@kernel
def _act(situation, key, reset, actor, reactions, chosen, room, out):  # type: ignore[no-untyped-def]
    """Write an agent's accelerations (forward, left) [m/s2] at this step to float64[2]."""
    agent, keeps_lane = actor
    if reset:
        chosen.apart, chosen.begin, chosen.at, chosen.end = 0.0, -1, 0, 0
    else:
        _watch(situation, agent, chosen)
    unpredicted = NOBODY
    if chosen.apart > LEFT:
        unpredicted = WALKER if agent == 0 else CAR
    free = -1
    if chosen.at < chosen.end:
        free = _free_steps(situation, (chosen, keeps_lane, unpredicted), reactions.steps, room.done)
    if free < AHEAD:
        begin, at = chosen.begin, chosen.at
        _choose(situation, key, reactions, (chosen, keeps_lane, unpredicted), free, room)
        if chosen.begin != begin or chosen.at != at:
            other = (situation[5], situation[6]) if agent == 0 else (situation[0], 0.0)
            chosen.expected[0], chosen.expected[1] = other
    _done(chosen, reactions.steps, chosen.at, room.done)
    chosen.at += 1
    _expect(situation, agent, room.done, chosen)
    fast = max(situation[0], SLOWEST)
    out[0] = room.done[2 * agent]
    out[1] = room.done[2 * agent + 1] * (fast * fast if agent == 0 else 1.0)


@kernel
def act(situations, keys, reset, active, actor, reactions, slots, room, out):  # type: ignore[no-untyped-def]
    """Write an agent's accelerations at this step to float64[B, 2] [m/s2], a row a slot; inactive rows do not change.

    :param situations: float64[B, 9], see `bank.situations_of`; keys: uint64[B, 5], see `draws.keys`.
    :param reset: bool[B], the agent is handed over with this step; active: bool[B].
    :param actor: 0 the vehicle or 1 the pedestrian, and whether the vehicle keeps to a lane; slots: CHOSEN[B].
    """
    for i in range(active.size):
        if active[i]:
            _act(situations[i], keys[i], reset[i], actor, reactions, slots[i], room, out[i])


class ReactionReplay:
    """Chooses and replays reactions for one agent (0 vehicle, 1 pedestrian) in each of `capacity` slots.

    :param keeps_lane: the vehicle follows a road, not the reaction's sideways motion.
    :ivar slots: CHOSEN[B], the chosen reactions.
    """

    def __init__(self, reactions: Reactions, agent: int, capacity: int, keeps_lane: bool) -> None:
        count = 2 ** int(math.log2(min(NEAREST, len(reactions.side))))
        self._reactions, self._actor, self.slots = reactions, (agent, keeps_lane), np.zeros(capacity, CHOSEN)
        self._room = Room(
            np.empty(FEATURES), np.empty(len(reactions.side)), np.zeros(count, np.int64), np.zeros(1, CHOSEN),
            np.empty(ACTIONS),
        )  # fmt: skip

    def step(
        self, situations: NDArray[np.float64], keys: Keys, reset: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return accelerations in the vehicle's heading frame [m/s2], float64[B, 2]; 0 where not active; see `act`."""
        out = np.zeros((len(active), 2))
        act(situations, keys, reset, active, self._actor, self._reactions, self.slots, self._room, out)
        return out
