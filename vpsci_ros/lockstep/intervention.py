"""Changes to a driving system's commands, to test their effect on an episode.

An intervention changes one episode: the speed of the car at one frame, the firmness of its braking, braking forced
from a frame on, or its speed held until it brakes firmly, as a protocol's robot does. Pedestrians, draws and the system
are not changed.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.kinematics import (
    MAX_ACCELERATION,
    MAX_DECELERATION,
    brake_for,
    throttle_for,
)
from vpsci_ros.world.state import RUNNING
from vpsci_ros.world.tick import Actions

BRAKING = 1.0  # [m/s2] from which a deceleration counts as braking, as in Euro NCAP's definition of T_AEB
_SAME = 1e-9  # [m/s] by which a speed that is held may differ from itself
NOT_FORCED = 50.0  # [m/s2] above any command: at this frame the system drives
RELEASED = 3.0  # [m/s2] AEB has activated when it brakes so firmly (the same definition): robots let go then
_HEAD = 7  # numbers of an intervention before its accelerations


class Intervention(NamedTuple):
    """The changes of one episode: of the car's speed and of the driving system's commands.

    :ivar frame: frame of the episode at which `speed` is added and `forced` begins.
    :ivar speed: added to the car's speed at `frame` [m/s]; the sum is at least 0.
    :ivar firmer: added to each deceleration of at least `BRAKING` that the system commands [m/s2].
    :ivar forced: accelerations along the car from the frame on [m/s2]; the system may brake more firmly than these.
    :ivar held: speed that the car keeps until the system brakes with `RELEASED` [m/s]; 0: none. The system steers.
    """

    frame: int = 0
    speed: float = 0.0
    firmer: float = 0.0
    forced: tuple[float, ...] = ()
    held: float = 0.0


def as_parameter(interventions: dict[tuple[int, int], Intervention]) -> list[float]:
    """Return interventions by (scenario, episode number) as the list of the parameter `interventions`."""
    return [
        float(number)
        for key, each in interventions.items()
        for number in (*key, each.frame, each.speed, each.firmer, each.held, len(each.forced), *each.forced)
    ]


def from_parameter(numbers: Sequence[float]) -> dict[tuple[int, int], Intervention]:
    """Return the interventions of the parameter `interventions`.

    :raises InvalidInput: the list ends within an intervention.
    """
    found: dict[tuple[int, int], Intervention] = {}
    at = 0
    while at < len(numbers):
        head = numbers[at : at + _HEAD]
        forced = tuple(numbers[at + _HEAD : at + _HEAD + int(head[-1])]) if len(head) == _HEAD else ()
        if len(head) < _HEAD or len(forced) < head[-1]:
            raise InvalidInput(
                f"interventions: the list ends within the one that begins at entry {at}; expected scenario, number, "
                "frame, speed, firmer, held, a number of accelerations, and so many of them"
            )
        found[int(head[0]), int(head[1])] = Intervention(int(head[2]), head[3], head[4], forced, head[5])
        at += _HEAD + len(forced)
    return found


class Interventions:
    """The changes of a run; `numbers` is the parameter `interventions`, with the errors of `from_parameter`."""

    def __init__(self, numbers: Sequence[float]) -> None:
        self._changes = from_parameter(numbers)

    def applied(self, state: NDArray[np.void], actions: Actions) -> Actions:
        """Return the changed commands of a tick, and set changed speeds in `state`, EPISODE[B].

        A missing command stays missing.
        """
        if not self._changes:
            return actions
        form = "vehicle" if actions.vehicle is not None else "vehicle_control"
        given = getattr(actions, form)
        values = None if given is None else given.copy()
        for row in np.flatnonzero(state["status"] == RUNNING):
            key = int(state["scenario"][row]), int(state["episode"][row])
            if (change := self._changes.get(key)) is None:
                continue
            if change.speed and state["frame"][row] == change.frame:
                state["vehicle_speed"][row] = max(0.0, state["vehicle_speed"][row] + change.speed)
            if values is not None:
                _change(values[row], state[row], change)
        return actions if values is None else replace(actions, **{form: values})


def _change(command: NDArray[np.float64], episode: np.void, change: Intervention) -> None:
    """Change a command in place, (longitudinal, lateral) [m/s2] or (steer, throttle, brake)."""
    along = float(command[0]) if len(command) == 2 else _along(command)
    changed = along
    if change.firmer and along <= -BRAKING:
        changed = max(-MAX_DECELERATION, along - change.firmer)
    if 0 <= (place := int(episode["frame"]) - change.frame) < len(change.forced):
        changed = min(changed, change.forced[place])
    if change.held and changed > -RELEASED and episode["vehicle_speed"] >= change.held - _SAME:
        changed = 0.0
    if changed != along:
        command[-2:] = (changed, command[1]) if len(command) == 2 else (throttle_for(changed), brake_for(changed))


def _along(control: NDArray[np.float64]) -> float:
    """Return the acceleration [m/s2] of throttle and brake."""
    return float(control[1]) * MAX_ACCELERATION - float(control[2]) * MAX_DECELERATION
