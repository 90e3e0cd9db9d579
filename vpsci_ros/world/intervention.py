"""Changes between a driving system's command and the car, for tests of what a change would have done.

A protocol's robot holds the initial speed and the lane until the system brakes firmly; then the system drives. An
intervention changes one episode: the speed of the car at one frame, the firmness of its braking, or braking forced from
a frame on. Pedestrians, draws and the system are not changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter
from vpsci_ros.world.autopilot import pursuit_curvature
from vpsci_ros.world.kinematics import (
    MAX_ACCELERATION,
    MAX_DECELERATION,
    brake_for,
    steer_to,
    throttle_for,
)
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.state import RUNNING
from vpsci_ros.world.tick import Actions

BRAKING = 1.0  # [m/s2] from which a deceleration counts as braking, as in Euro NCAP's definition of T_AEB
NOT_FORCED = 50.0  # [m/s2] above any command: at this frame the system drives
_SAME = 1e-9  # [m/s] by which a speed that is held may differ from itself
_HEAD = 6  # numbers of an intervention before its accelerations


@dataclass(frozen=True)
class InterventionConfig:
    """Changes between the driving system and the car; none by default."""

    held_until: float = parameter(
        0.0,
        "the speed at which an episode begins is held and the lane kept until a command brakes this firmly, as a "
        "protocol's robots do; 0: the system drives from the beginning",
        unit="m/s2", low=0.0, high=MAX_DECELERATION,
    )  # fmt: skip
    interventions: list[float] = parameter(
        [],
        "set by `vpsci ads-why`; of each episode: scenario, number, frame, change of speed [m/s], by what its "
        "braking is firmer [m/s2], how many accelerations follow, and these, forced from the frame on [m/s2]",
    )


class Intervention(NamedTuple):
    """One episode's change.

    :ivar frame: frame of the episode.
    :ivar speed: added to the car's speed at the frame [m/s]; it does not fall below 0.
    :ivar firmer: added to each deceleration of at least `BRAKING` that the system commands [m/s2].
    :ivar forced: accelerations along the car from the frame on [m/s2]; the system may brake more firmly than these.
    """

    frame: int = 0
    speed: float = 0.0
    firmer: float = 0.0
    forced: tuple[float, ...] = ()


def as_parameter(interventions: dict[tuple[int, int], Intervention]) -> list[float]:
    """Return interventions by (scenario, episode number) as the parameter's list."""
    return [
        float(number)
        for key, each in interventions.items()
        for number in (*key, each.frame, each.speed, each.firmer, len(each.forced), *each.forced)
    ]


def from_parameter(numbers: Sequence[float]) -> dict[tuple[int, int], Intervention]:
    """Return the interventions of the parameter `interventions`.

    :raises InvalidInput: the list ends within one of them.
    """
    found: dict[tuple[int, int], Intervention] = {}
    at = 0
    while at < len(numbers):
        head = numbers[at : at + _HEAD]
        forced = tuple(numbers[at + _HEAD : at + _HEAD + int(head[-1])]) if len(head) == _HEAD else ()
        if len(head) < _HEAD or len(forced) < head[-1]:
            raise InvalidInput(
                f"interventions: the list ends within the one that begins at entry {at}; expected scenario, number, "
                "frame, speed, firmer, a number of accelerations, and so many of them"
            )
        found[int(head[0]), int(head[1])] = Intervention(int(head[2]), head[3], head[4], forced)
        at += _HEAD + len(forced)
    return found


class Interventions:
    """The changes of a run.

    :param lane_following: the world keeps the lane for systems that command accelerations.
    """

    def __init__(self, config: InterventionConfig, scenarios: Sequence[Scenario], *, lane_following: bool) -> None:
        self._held_until, self._lane_following = config.held_until, lane_following
        self._changes = from_parameter(config.interventions)
        self._lanes = {scenario.number: scenario.vehicle.path for scenario in scenarios}
        self._begun: dict[tuple[int, int], float] = {}  # [m/s] at which an episode began

    def applied(self, state: NDArray[np.void], actions: Actions) -> Actions:
        """Return the commands that reach the car at a tick, and set changed speeds in `state`, EPISODE[B].

        A missing command stays missing.
        """
        if not self._held_until and not self._changes:
            return actions
        form = "vehicle" if actions.vehicle is not None else "vehicle_control"
        given = getattr(actions, form)
        values = None if given is None else given.copy()
        for row in np.flatnonzero(state["status"] == RUNNING):
            key = int(state["scenario"][row]), int(state["episode"][row])
            change = self._changes.get(key)
            if change is not None and change.speed and state["frame"][row] == change.frame:
                state["vehicle_speed"][row] = max(0.0, state["vehicle_speed"][row] + change.speed)
            if values is not None:
                self._change(values[row], state[row], change or Intervention())
        return actions if values is None else replace(actions, **{form: values})

    def _change(self, command: NDArray[np.float64], episode: np.void, change: Intervention) -> None:
        """Change a command in place, (longitudinal, lateral) or (steer, throttle, brake)."""
        key = int(episode["scenario"]), int(episode["episode"])
        if episode["frame"] == 0:
            self._begun[key] = float(episode["vehicle_speed"])
        along = float(command[0]) if len(command) == 2 else _along(command)
        changed = along
        if change.firmer and along <= -BRAKING:
            changed = max(-MAX_DECELERATION, along - change.firmer)
        if 0 <= (place := int(episode["frame"]) - change.frame) < len(change.forced):
            changed = min(changed, change.forced[place])
        held = self._held_until and episode["vehicle_speed"] >= self._begun.get(key, np.inf) - _SAME
        if held and changed > -self._held_until:
            self._hold(command, episode)
        elif changed != along:
            command[-2:] = (changed, command[1]) if len(command) == 2 else (throttle_for(changed), brake_for(changed))

    def _hold(self, command: NDArray[np.float64], episode: np.void) -> None:
        """Keep speed and lane, as the world's lane keeping does."""
        lane, speed = self._lanes[int(episode["scenario"])], float(episode["vehicle_speed"])
        place = float(episode["vehicle_x"]), float(episode["vehicle_y"]), float(episode["vehicle_heading"])
        path = lane.points[None], 0, len(lane.points), lane.step
        keeping = pursuit_curvature(*path, float(episode["route_s"]), 0.0, *place, speed)
        if len(command) == 2:
            command[:] = 0.0, 0.0 if self._lane_following else keeping * speed * speed
        else:
            command[:] = steer_to(keeping), 0.0, 0.0


def _along(control: NDArray[np.float64]) -> float:
    """Return the acceleration [m/s2] of throttle and brake."""
    return float(control[1]) * MAX_ACCELERATION - float(control[2]) * MAX_DECELERATION
