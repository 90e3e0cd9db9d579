"""The choice of a recorded reaction for an agent, by a roll-out of each candidate.

A reaction is drawn among those of the `NEAREST` most similar moments, evenly among the ones by which the two do not
touch within 3 s. That is found by a roll-out: both move by the world's own kinematics as the recorded pair did,
adjusted for how the moments differ, and keep their velocities for `BEYOND` steps where the recording ends sooner. A
vehicle of another speed is lent accelerations in proportion to its speed, and the same sideways acceleration. If all of
these touch, the nearest moment of the bank is taken by which they do not; if there is none, the one that touches
last. A reaction is chosen again when it ends, and as soon as the rest of it would touch.

Driver and pedestrian draw by the same numbers and see the same, so they are lent two halves of one reaction. If the
other one leaves what was lent by `LEFT`, it is a stranger (a driving system, a walker who does not look): from then on
it is assumed to keep its velocity, and only the own half is chosen. The world's limit of jerk makes strangers of two
lent halves, too: in one of seven encounters they come apart. Forgiving it was no more like people, and walkers who do
not look were hit in 7.9% for 5.5%.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from vpsci_ros.policy.bank import ACTIONS, FEATURES, SECOND, SECONDS, SLOWEST, Reactions, features_of
from vpsci_ros.policy.draws import Keys
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_REACTION, philox, unit
from vpsci_ros.world.kinematics import brake_for, drive, steer_to, throttle_for, walk
from vpsci_ros.world.observation import STEP, from_heading_frame

NEAREST = 64  # moments of which one is chosen; a power of two, and fewer where a bank has fewer
FURTHEST = 1.0  # standard deviations: the largest difference of a feature that is adjusted for
FASTER = 1.5  # the largest ratio of the vehicle's speed to the recorded one that counts, and 1 over the least
AHEAD = 30  # steps that a roll-out looks ahead
BEYOND = 20  # steps for which both keep their velocities after a reaction
LEFT = 0.05  # [m] that the other one may leave what was lent by
CLOSE = math.hypot(0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH) + PEDESTRIAN_RADIUS + 0.01  # [m] no contact beyond it

BOTH, CAR_KEEPS, WALKER_KEEPS = 0, 1, 2  # who does not do what was lent, but keeps its velocity

LENT = np.dtype(
    [
        ("begin", "i8"), ("at", "i8"), ("end", "i8"),  # steps of the bank: first, next, one past the last
        ("mirror", "f8"),  # 1; -1: left and right are exchanged
        ("factor", "f8", ACTIONS),  # by which the steps are multiplied, for the vehicle's speed
        ("adjust", "f8", (SECONDS, ACTIONS)),  # what is added to the steps of each second
        ("expected", "f8", 2),  # [m/s] velocity of the other one at the next step: forward and left; a vehicle's speed
        ("apart", "f8"),  # [m] by which the other one has left what was lent since the hand-over
        ("moment", "i8"),  # number of the moment, counted from 1; 0: none yet
    ]
)  # fmt: skip


class Room(NamedTuple):
    """Working memory of `lend`."""

    own: NDArray[np.float64]  # [8] features
    gaps: NDArray[np.float64]  # [M] squared distances of features
    near: NDArray[np.int64]  # [n] the nearest moments, the nearest first
    trial: NDArray[np.void]  # LENT[1]
    done: NDArray[np.float64]  # [4] see `ACTIONS`


@kernel
def _done(lent, steps, at, out):  # type: ignore[no-untyped-def]
    """Write what both do at step `at` of the bank, adjusted, to float64[4]."""
    second = (at - lent.begin) // SECOND
    for k in range(ACTIONS):
        out[k] = steps[at, k] * lent.factor[k] * (lent.mirror if k % 2 else 1.0)  # the odd ones point left
        if second < SECONDS:
            out[k] += lent.adjust[second, k]


@kernel
def _free_steps(moment, who, steps, done):  # type: ignore[no-untyped-def]
    """Return after how many steps the two touch if what is lent goes on; `AHEAD`: not within these."""
    lent, keeps_lane, stranger = who
    x, y, heading, speed = 0.0, 0.0, 0.0, moment[0]  # in the vehicle's heading frame of the moment
    arc = steer_to(moment[2] / max(speed, SLOWEST))
    px, py, vx, vy = moment[3], moment[4], moment[5], moment[6]
    for k in range(min(AHEAD, lent.end + BEYOND - lent.at)):
        done[:] = 0.0
        if lent.at + k < lent.end:
            _done(lent, steps, lent.at + k, done)
        if stranger == CAR_KEEPS:
            done[0] = done[1] = 0.0
        elif stranger == WALKER_KEEPS:
            done[2] = done[3] = 0.0
        ax, ay = from_heading_frame(heading, done[2], done[3])
        pedals = throttle_for(done[0]), brake_for(done[0])
        along = arc if abs(heading) < 0.5 * math.pi else 0.0  # the arc of the start, by 90 degrees, as in CurvTTC
        steer = along if keeps_lane else steer_to(done[1])
        x, y, heading, speed, _ = drive(x, y, heading, speed, steer, *pedals, STEP)
        px, py, vx, vy = walk(px, py, vx, vy, ax, ay, 1.0, math.inf, STEP)
        if (px - x) * (px - x) + (py - y) * (py - y) > CLOSE * CLOSE:
            continue  # most steps: a clearance costs a sine and a cosine
        if clearance_pair(x, y, heading, px, py, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS) <= 0.0:
            return k
    return AHEAD


@kernel
def _take(own, side, reactions, picked, lent):  # type: ignore[no-untyped-def]
    """Make `lent` the reaction of moment `picked`, adjusted to the features `own`, float64[8]."""
    lent.begin = lent.at = reactions.begin[picked]
    lent.end, lent.mirror = reactions.end[picked], side * reactions.side[picked]
    lent.moment = picked + 1
    lent.adjust[:] = 0.0
    speed = max(own[0] * reactions.scale[0], SLOWEST)
    ratio = speed / max(reactions.features[0, picked] * reactions.scale[0], SLOWEST)
    ratio = min(max(ratio, 1.0 / FASTER), FASTER)
    lent.factor[:] = 1.0
    lent.factor[0], lent.factor[1] = ratio, 1.0 / (ratio * ratio)
    for k in range(FEATURES):
        gap = min(max(own[k] - reactions.features[k, picked], -FURTHEST), FURTHEST)
        for second in range(SECONDS):
            for a in range(ACTIONS):
                lent.adjust[second, a] += gap * reactions.slope[k, second, a] * (side if a % 2 else 1.0)
    for second in range(SECONDS):
        lent.adjust[second, 0] *= speed
        lent.adjust[second, 1] /= speed * speed


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
def _choose(moment, key, reactions, who, free, room):  # type: ignore[no-untyped-def]
    """Make `lent` a reaction that stays free for longer than `free` steps, if there is one.

    The nearest are tried in an order that the key draws, up to the first by which the two do not touch at all.
    """
    lent, keeps_lane, stranger = who
    side = features_of(moment, room.own)
    for k in range(FEATURES):
        room.own[k] /= reactions.scale[k]
    _nearest(room.own, reactions.features, reactions.far, room.gaps, room.near)
    stream = uint64(STREAM_REACTION) + (key[4] << uint64(8))
    drawn = philox(key[0], key[1], uint64(0), stream, key[2], key[3])
    count = room.near.size
    # an odd stride meets each of a power of two once
    first, stride = int(unit(drawn[0]) * count), 2 * int(unit(drawn[1]) * (count // 2)) + 1
    picked = -1
    for c in range(count):
        trial = room.near[(first + c * stride) % count]
        _take(room.own, side, reactions, trial, room.trial[0])
        steps = _free_steps(moment, (room.trial[0], keeps_lane, stranger), reactions.steps, room.done)
        if steps > free:
            free, picked = steps, trial
            if free == AHEAD:
                break
    if free < AHEAD:  # none of the nearest: the nearest of all that does not touch, if there is one
        least = math.inf
        for m in range(room.gaps.size):
            if room.gaps[m] < least:
                _take(room.own, side, reactions, m, room.trial[0])
                if _free_steps(moment, (room.trial[0], keeps_lane, stranger), reactions.steps, room.done) == AHEAD:
                    least, picked = room.gaps[m], m
    if picked >= 0:
        _take(room.own, side, reactions, picked, lent)


@kernel
def _watch(moment, agent, lent):  # type: ignore[no-untyped-def]
    """Add up by how much the other one has left what was lent."""
    if agent == 0:
        forward, left = moment[5] - lent.expected[0], moment[6] - lent.expected[1]
        lent.apart += STEP * math.sqrt(forward * forward + left * left)
    else:
        lent.apart += STEP * abs(moment[0] - lent.expected[0])


@kernel
def _expect(moment, agent, done, lent):  # type: ignore[no-untyped-def]
    """Carry the velocity expected of the other one on by a step, in which both do `done`, float64[4]."""
    if agent == 0:
        forward, left = lent.expected[0] + STEP * done[2], lent.expected[1] + STEP * done[3]
        turned = STEP * moment[2]  # the heading frame turns with the vehicle
        lent.expected[0], lent.expected[1] = forward + turned * left, left - turned * forward
    else:
        lent.expected[0] = max(0.0, lent.expected[0] + STEP * done[0])


@kernel
def _lend(moment, key, reset, actor, reactions, lent, room, out):  # type: ignore[no-untyped-def]
    """Write what an agent does at this step to float64[2]."""
    agent, keeps_lane = actor
    if reset:
        lent.apart, lent.at, lent.end = 0.0, 0, 0
    else:
        _watch(moment, agent, lent)
    stranger = BOTH
    if lent.apart > LEFT:
        stranger = WALKER_KEEPS if agent == 0 else CAR_KEEPS
    free = -1
    if lent.at < lent.end:
        free = _free_steps(moment, (lent, keeps_lane, stranger), reactions.steps, room.done)
    if free < AHEAD:
        begin, at = lent.begin, lent.at
        _choose(moment, key, reactions, (lent, keeps_lane, stranger), free, room)
        if lent.begin != begin or lent.at != at:
            lent.expected[0], lent.expected[1] = (moment[5], moment[6]) if agent == 0 else (moment[0], 0.0)
    _done(lent, reactions.steps, lent.at, room.done)
    lent.at += 1
    _expect(moment, agent, room.done, lent)
    fast = max(moment[0], SLOWEST)
    out[0] = room.done[2 * agent]
    out[1] = room.done[2 * agent + 1] * (fast * fast if agent == 0 else 1.0)


@kernel
def lend(moments, keys, reset, active, actor, reactions, slots, room, out):  # type: ignore[no-untyped-def]
    """Write an agent's action at this step in each slot to float64[B, 2]; inactive rows do not change.

    :param moments: float64[B, 7], see `bank.moments_of`; keys: uint64[B, 5], see `draws.keys`.
    :param reset: bool[B], the agent is handed over with this step; active: bool[B].
    :param actor: 0 the vehicle or 1 the pedestrian, and whether the vehicle keeps to a lane; slots: LENT[B].
    """
    for i in range(active.size):
        if active[i]:
            _lend(moments[i], keys[i], reset[i], actor, reactions, slots[i], room, out[i])


class Lender:
    """Chooses and replays reactions for one agent (0 vehicle, 1 pedestrian) in each of `capacity` slots.

    :param keeps_lane: the vehicle follows a road and not what is lent to it sideways.
    :ivar slots: LENT[B], what is lent.
    """

    def __init__(self, reactions: Reactions, agent: int, capacity: int, keeps_lane: bool) -> None:
        count = 2 ** int(math.log2(min(NEAREST, len(reactions.side))))
        self._reactions, self._actor, self.slots = reactions, (agent, keeps_lane), np.zeros(capacity, LENT)
        self._room = Room(
            np.empty(FEATURES), np.empty(len(reactions.side)), np.zeros(count, np.int64), np.zeros(1, LENT),
            np.empty(ACTIONS),
        )  # fmt: skip

    def step(
        self, moments: NDArray[np.float64], keys: Keys, reset: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return accelerations in the vehicle's heading frame [m/s2], float64[B, 2]; 0 where not active; see `lend`."""
        out = np.zeros((len(active), 2))
        lend(moments, keys, reset, active, self._actor, self._reactions, self.slots, self._room, out)
        return out
