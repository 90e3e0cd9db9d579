"""The choice of a recorded reaction for an agent, and the least evasion where it leads to contact.

A reaction is drawn among those of the `NEAREST` most similar situations, evenly among the ones by which the two stay
`MARGIN` apart for 3 s. A drawn pedestrian keeps its half of the reaction, and up to `OTHERS` further drivers are tried
with it, since drivers yield; then the next pedestrian is. If all come nearer, those with the latest contact are taken.
A reaction is chosen again when it ends, and after `AGAIN` steps if its rest comes nearer than `MARGIN`.

Driver and pedestrian draw by the same numbers and see the same, so they choose two halves of one reaction. If the other
agent deviates from the chosen reaction by more than `LEFT` (a driving system, a walker who does not look), it is
unpredicted. Then an agent chooses again after each `AGAIN` steps, by what the other one does now, and
looks ahead for `LOOKS` steps. Where the two would come near, an agent evades (`vpsci_ros.policy.reaction`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from vpsci_ros.policy.bank import FEATURES, SLOWEST, Reactions, features_of
from vpsci_ros.policy.draws import Keys
from vpsci_ros.policy.forecast import ACTIONS, forecast
from vpsci_ros.policy.reaction import CAR, CHOSEN, NOBODY, WALKER, done_after, evasion, near_after
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_REACTION, philox, unit
from vpsci_ros.world.observation import STEP

NEAREST = 64  # situations of which one is chosen; a power of two, and fewer where a bank has fewer
OTHERS = 8  # drivers that are tried with a pedestrian besides its own
WIDEST = 3.0  # the largest ratio of the vehicle's speed to the recorded one that counts, and 1 over the least
AHEAD = 30  # steps that a roll-out looks ahead
LOOKS = 20, 15  # steps that driver and pedestrian look ahead where the other one is unpredicted
LEFT = 0.2  # [m] by which the other agent may deviate from the chosen reaction
AGAIN = 8  # steps after which a reaction may be chosen again


class Room(NamedTuple):
    """Working memory of `act`."""

    own: NDArray[np.float64]  # [8] features
    gaps: NDArray[np.float64]  # [M] squared distances of features
    near: NDArray[np.int64]  # [n] the nearest situations, the nearest first
    hidden: NDArray[np.float64]  # [2, H] of the forecast
    done: NDArray[np.float64]  # [4] see `ACTIONS`


@kernel
def _take(situation, side, reactions, picked, half, chosen):  # type: ignore[no-untyped-def]
    """Make one half of `chosen`, 0 the driver's or 1 the pedestrian's, that of situation `picked`, on `side`."""
    chosen.begin[half], chosen.end[half] = reactions.begin[picked], reactions.end[picked]
    chosen.mirror[half], chosen.situation[half] = side * reactions.side[picked], picked + 1
    speed = max(situation[0], SLOWEST)
    if half == 0:
        wide = speed / max(reactions.features[0, picked] * reactions.scale[0], SLOWEST)
        wide = min(max(wide, 1.0 / WIDEST), WIDEST)
        chosen.bend = 1.0 / (wide * wide)  # the recorded sideways acceleration, not the recorded bend
        chosen.more[0], chosen.more[1] = situation[1], situation[2] / speed
    else:
        chosen.more[2], chosen.more[3] = situation[7], situation[8]
    for k in range(2 * half, 2 * half + 2):
        recorded = reactions.before[picked, k] * (chosen.mirror[half] if k % 2 else 1.0)
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
def _choose(situation, key, reactions, who, room):  # type: ignore[no-untyped-def]
    """Make `chosen` a drawn reaction; where nobody is unpredicted, one without contact if there is one."""
    chosen, _, unpredicted = who
    side = features_of(situation, room.own)
    for k in range(FEATURES):
        room.own[k] /= reactions.scale[k]
    _nearest(room.own, reactions.features, reactions.far, room.gaps, room.near)
    if reactions.means.shape[1]:
        forecast(reactions.networks, 0, situation, room.hidden, chosen.mean)
    stream = uint64(STREAM_REACTION) + (key[4] << uint64(8))
    drawn = philox(key[0], key[1], uint64(0), stream, key[2], key[3])
    count = room.near.size
    # an odd stride meets each of a power of two once
    first, stride = int(unit(drawn[0]) * count), 2 * int(unit(drawn[1]) * (count // 2)) + 1
    look, latest, best_driver, best_walker = (AHEAD if unpredicted == NOBODY else 0), -1, 0, 0
    chosen.age = 0
    for walker in range(count):
        _take(situation, side, reactions, room.near[(first + walker * stride) % count], 1, chosen)
        for driver in range(walker, walker + 1 + min(OTHERS, count - 1)):
            _take(situation, side, reactions, room.near[(first + driver * stride) % count], 0, chosen)
            after = near_after(situation, who, (0.0, 0.0, 0.0), look, reactions, room.done)
            if after == look:
                return
            if after > latest:
                latest, best_driver, best_walker = after, driver, walker
    _take(situation, side, reactions, room.near[(first + best_driver * stride) % count], 0, chosen)
    _take(situation, side, reactions, room.near[(first + best_walker * stride) % count], 1, chosen)


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
        chosen.apart, chosen.age = 0.0, 0
        chosen.begin[:] = chosen.end[:] = 0
    else:
        _watch(situation, agent, chosen)
    unpredicted = NOBODY
    if chosen.apart > LEFT:
        unpredicted = WALKER if agent == 0 else CAR
    who, push = (chosen, keeps_lane, unpredicted), (0.0, 0.0, 0.0)
    look = AHEAD if unpredicted == NOBODY else LOOKS[agent]
    ended = chosen.age >= min(chosen.end[0] - chosen.begin[0], chosen.end[1] - chosen.begin[1])
    near = ended or near_after(situation, who, push, look, reactions, room.done) < look
    if ended or (chosen.age >= AGAIN and (near or unpredicted != NOBODY)):
        _choose(situation, key, reactions, who, room)
        other = (situation[5], situation[6]) if agent == 0 else (situation[0], 0.0)
        chosen.expected[0], chosen.expected[1] = other
    if near or chosen.age == 0:
        if unpredicted != NOBODY:
            push = evasion(situation, who, agent, push, look, reactions, room.done)
        else:
            push = evasion(situation, who, 0, push, look, reactions, room.done)
            push = evasion(situation, who, 1, push, look, reactions, room.done)
    done_after(chosen, reactions, chosen.age, room.done)
    slows = push[1] * situation[5] + push[2] * situation[6]
    part = min(1.0, -slows / (STEP * (push[1] * push[1] + push[2] * push[2]))) if slows < 0.0 else 1.0  # to a stand
    room.done[0] += push[0]
    room.done[2], room.done[3] = room.done[2] + part * push[1], room.done[3] + part * push[2]
    chosen.age += 1
    _expect(situation, agent, room.done, chosen)
    out[0], out[1] = room.done[2 * agent], room.done[2 * agent + 1]
    if agent == 0:
        out[1] *= max(situation[0], SLOWEST) ** 2


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
            np.empty(FEATURES), np.empty(len(reactions.side)), np.zeros(count, np.int64),
            np.empty((2, reactions.networks.entry_bias.shape[1])), np.empty(ACTIONS),
        )  # fmt: skip

    def step(
        self, situations: NDArray[np.float64], keys: Keys, reset: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Return accelerations in the vehicle's heading frame [m/s2], float64[B, 2]; 0 where not active; see `act`."""
        out = np.zeros((len(active), 2))
        act(situations, keys, reset, active, self._actor, self._reactions, self.slots, self._room, out)
        return out
