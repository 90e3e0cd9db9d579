"""Changes to a driving system's commands, to test their effect on an episode.

An intervention changes one episode: the speed of the car at one frame, the firmness of its braking, braking forced
from a frame on, or its speed held until it brakes firmly, as a protocol's robot does. Pedestrians, draws and the system
are not changed. An exam gives them, with the head starts of its pedestrians, to a world in another process by a file.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import write_json
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION, brake_for, throttle_for
from vpsci_ros.world.state import RUNNING
from vpsci_ros.world.tick import Actions

BRAKING = 1.0  # [m/s2] from which a deceleration counts as braking, as in Euro NCAP's definition of T_AEB
_SAME = 1e-9  # [m/s] by which a speed that is held may differ from itself
NOT_FORCED = 50.0  # [m/s2] above any command: at this frame the system drives
RELEASED = 3.0  # [m/s2] AEB has activated when it brakes so firmly (the same definition): robots let go then

Key = tuple[int, int]  # scenario, episode number
HeadStarts = Mapping[Key, tuple[float, float]]
"""(scenario, episode) -> head start of the pedestrians, and for how long they have walked straight on since [s]."""


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


def write_changes(path: Path, head_starts: HeadStarts, interventions: Mapping[Key, Intervention]) -> None:
    """Write head starts and interventions as the file that the parameter `episode_changes` names."""
    starts = [[*key, *times] for key, times in head_starts.items()]
    write_json(path, {"head_starts": starts, "interventions": rows_of(interventions)})


def rows_of(interventions: Mapping[Key, Intervention]) -> list[list[Any]]:
    """Return interventions as JSON values: scenario, episode number, and the fields of each."""
    return [[*key, *each[:3], list(each.forced), each.held] for key, each in interventions.items()]


def read_changes(path: str | Path) -> tuple[HeadStarts, dict[Key, Intervention]]:
    """Return the head starts and interventions in a file of `write_changes`.

    :raises InvalidInput: it cannot be read, or is another file.
    """
    where = f"episode_changes = {path}: expected head starts and interventions as an exam writes them"
    stored = read_json(path)
    require_form(stored, {"head_starts": [list], "interventions": [list]}, where)
    try:
        starts = {(int(s), int(e)): (float(ahead), float(straight)) for s, e, ahead, straight in stored["head_starts"]}
        changes = {
            (int(s), int(e)): Intervention(int(frame), float(speed), float(firmer), tuple(map(float, a)), float(held))
            for s, e, frame, speed, firmer, a, held in stored["interventions"]
        }
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{where}, got another list ({error})") from None
    return starts, changes


def intervened(interventions: Mapping[Key, Intervention], state: NDArray[np.void], actions: Actions) -> Actions:
    """Return the changed commands of a tick, and set changed speeds in `state`, EPISODE[B].

    A missing command stays missing.
    """
    form = "vehicle" if actions.vehicle is not None else "vehicle_control"
    given = getattr(actions, form)
    values = None if given is None else given.copy()
    for row in np.flatnonzero(state["status"] == RUNNING):
        key = int(state["scenario"][row]), int(state["episode"][row])
        if (change := interventions.get(key)) is None:
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
