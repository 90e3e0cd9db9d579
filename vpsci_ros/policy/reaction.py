"""A chosen reaction: the actions of both agents at each step, a roll-out of its rest, and the least evasion.

A reaction is what was done beyond the mean of both agents. The mean is the own acceleration at the situation, which
fades by `FADES` a step; with a forecast (`vpsci_ros.policy.forecast`) it is half of that and half of the forecast. A
step is the recorded one plus the own mean less the recorded situation's. A roll-out finds when the two come near: both
move by the world's own kinematics, and keep their velocities for `BEYOND` steps where the recording ends sooner. An
unpredicted vehicle's acceleration goes on and fades on the arc it is on; an unpredicted pedestrian keeps its velocity.

Where the two would come nearer than `MARGIN`, an agent adds the least acceleration of `EVASIONS` that prevents it: a
driver brakes or accelerates, a pedestrian goes faster, slower, or aside from the vehicle. Of two agents of one reaction
the driver evades, and the pedestrian only where that is not enough: if both did, each would undo what the other does.
"""

import math

import numpy as np

from vpsci_ros.policy.bank import SLOWEST
from vpsci_ros.policy.forecast import ACTIONS, STEPS
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.kinematics import brake_for, drive, steer_to, throttle_for, walk
from vpsci_ros.world.observation import STEP, from_heading_frame

FADES = 0.95, 0.95, 0.7, 0.7  # by which a step multiplies what is added to the recorded steps, see `ACTIONS`
FADED = np.array(FADES) ** np.arange(100)[:, None]  # float64[100, 4], after so many steps; then hardly anything is left
BEYOND = 20  # steps for which both keep their velocities after a reaction
MARGIN = 0.2  # [m] between the footprints
FORECAST = 0.5  # the forecast's share of the mean
EVASIONS = 0.5, 1.0, 2.0, 3.0, 4.0  # [m/s2] of a pedestrian, and of a driver who accelerates; one brakes twice as hard
CLOSE = (
    math.hypot(0.5 * VEHICLE_LENGTH, 0.5 * VEHICLE_WIDTH) + PEDESTRIAN_RADIUS + MARGIN + 0.01
)  # [m] none nearer beyond

_STANDS = 0.2  # [m/s] a slower pedestrian goes aside only
NOBODY, CAR, WALKER = 0, 1, 2  # the unpredicted agent

CHOSEN = np.dtype(  # a chosen reaction: the halves of a driver and a pedestrian
    [
        ("age", "i8"),  # steps since the choice
        ("begin", "i8", 2), ("end", "i8", 2),  # steps of the bank: first, and one past the last
        ("mirror", "f8", 2),  # 1; -1: left and right are exchanged
        ("bend", "f8"),  # by which curvatures are multiplied besides
        ("more", "f8", ACTIONS),  # own acceleration less the recorded one, which fades
        ("mean", "f4", (STEPS, ACTIONS)),  # own forecast
        ("expected", "f8", 2),  # [m/s] velocity of the other one at the next step: forward and left; a vehicle's speed
        ("apart", "f8"),  # [m] by which the other agent has deviated since the hand-over
        ("situation", "i8", 2),  # numbers of the situations, counted from 1; 0: none yet
    ]
)  # fmt: skip


@kernel
def done_after(chosen, reactions, age, out):  # type: ignore[no-untyped-def]
    """Write the actions of both agents `age` steps after the choice to float64[4], see `ACTIONS`."""
    learned = FORECAST if 0 <= age < reactions.means.shape[1] else 0.0
    fading = 1.0 - FORECAST if reactions.means.shape[1] else 1.0
    for k in range(ACTIONS):
        half, out[k] = k // 2, 0.0
        at = chosen.begin[half] + age
        if at < chosen.end[half]:
            sign = chosen.mirror[half] if k % 2 else 1.0  # the odd ones point left
            if k == 1:
                sign *= chosen.bend
            recorded = reactions.steps[at, k]
            if learned > 0.0:
                recorded -= learned * reactions.means[chosen.situation[half] - 1, age, k]
                out[k] = learned * chosen.mean[age, k]
            out[k] += sign * recorded + fading * chosen.more[k] * FADED[min(age, len(FADED) - 1), k]


@kernel
def near_after(situation, who, push, look, reactions, done):  # type: ignore[no-untyped-def]
    """Return after how many steps the two come nearer than `MARGIN` by the rest of the reaction; `look`: not within it.

    :param push: accelerations that are added: the vehicle's forward, the pedestrian's forward and left [m/s2]. A
        pedestrian that they slow down stands at last.
    """
    chosen, keeps_lane, unpredicted = who
    x, y, heading, speed = 0.0, 0.0, 0.0, situation[0]  # in the vehicle's heading frame of the situation
    arc = 0.0 if math.isnan(situation[2]) else steer_to(situation[2] / max(speed, SLOWEST))
    px, py, vx, vy = situation[3], situation[4], situation[5], situation[6]
    slows, fades = push[1] * vx + push[2] * vy < 0.0, 0.0 if math.isnan(situation[1]) else situation[1]
    last = max(chosen.end[0] - chosen.begin[0], chosen.end[1] - chosen.begin[1]) - chosen.age + BEYOND
    for k in range(min(look, last)):
        done_after(chosen, reactions, chosen.age + k, done)
        if unpredicted == CAR:
            done[0], done[1] = fades, 0.0
            fades *= FADES[0]
        elif unpredicted == WALKER:
            done[2] = done[3] = 0.0
        ax, ay = from_heading_frame(heading, done[2], done[3])
        if not slows or push[1] * vx + push[2] * vy < 0.0:
            ax, ay = ax + push[1], ay + push[2]
        pedals = throttle_for(done[0] + push[0]), brake_for(done[0] + push[0])
        along = arc if abs(heading) < 0.5 * math.pi else 0.0  # the arc of the start, by 90 degrees, as in CurvTTC
        steer = along if keeps_lane or unpredicted == CAR else steer_to(done[1])
        x, y, heading, speed, _ = drive(x, y, heading, speed, steer, *pedals, STEP)
        px, py, vx, vy = walk(px, py, vx, vy, ax, ay, 1.0, math.inf, STEP)
        if (px - x) * (px - x) + (py - y) * (py - y) > CLOSE * CLOSE:
            continue  # most steps: a clearance costs a sine and a cosine
        if clearance_pair(x, y, heading, px, py, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS) <= MARGIN:
            return k
    return look


@kernel
def evasion(situation, who, agent, push, look, reactions, done):  # type: ignore[no-untyped-def]
    """Return `push`, see `near_after`, with the least acceleration of one agent that keeps the two apart.

    Where none does, the one that does so for longest is added; of equals, none.
    """
    latest, best = near_after(situation, who, push, look, reactions, done), push
    aside = 1.0 if situation[4] >= 0.0 else -1.0
    speed = math.sqrt(situation[5] * situation[5] + situation[6] * situation[6])
    forward, left = (situation[5] / speed, situation[6] / speed) if speed > _STANDS else (0.0, aside)
    for strength in EVASIONS:
        for way in range(2 + agent):
            if latest == look:
                return best
            if agent == 0:
                trial = ((strength if way else -2.0 * strength), push[1], push[2])
            elif way == 2:
                trial = (push[0], 0.0, strength * aside)
            else:
                along = -strength if way else strength
                trial = (push[0], along * forward, along * left)
            after = near_after(situation, who, trial, look, reactions, done)
            if after > latest:
                latest, best = after, trial
    return best
