"""A driving system that is a Python class: how it is found, what it gets at each tick, and what it may answer.

It is written without this package and without ROS: `reset(begin)` before each episode, `act(observation)` at each tick
of it. One object drives one episode at a time, and many objects drive side by side, so that an episode comes out the
same whatever the others do, as long as objects share nothing that changes.
"""

import importlib
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.layout import PlanarMotion, motion_of
from vpsci_ros.world import Scenario
from vpsci_ros.world.safe_stop import LARGEST_ACCELERATION
from vpsci_ros.world.tables import Tables


class Begin(NamedTuple):
    """What `reset` gets: the episode that begins.

    :ivar scenario: where; `scenario.vehicle.path` is the lane's centre line.
    :ivar episode: its number within the scenario.
    :ivar seed: of the driver's own random numbers, if it has any: one for each episode, the same in every exam.
    """

    scenario: Scenario
    episode: int
    seed: int


@dataclass(frozen=True)
class Observation:
    """What `act` gets: one tick as the topics have it, to the bit.

    :ivar time: since the episode began [s].
    :ivar vehicle: of `/vehicle/odometry`: x, y [m], yaw [rad], speed [m/s], yaw_rate [rad/s].
    :ivar pedestrians: of `/pedestrians/odometry`, or with perception of `/perception/objects`, likewise.
    :ivar curvttc, distance: of `/safety/state` [s], [m]; of several pedestrians the least.
    """

    time: float
    vehicle: PlanarMotion
    pedestrians: tuple[PlanarMotion, ...]
    curvttc: float
    distance: float
    _state: NDArray[np.void]  # EPISODE[P]
    _curvttc: NDArray[np.float64]  # [P]
    _tables: Tables

    def of_environment(self) -> NDArray[np.float32]:
        """Return what the Gymnasium environment shows, float32[21], see `vpsci_ros.envs.driving`; needs gymnasium."""
        from vpsci_ros.envs.driving import observe

        nearest = self._curvttc.argmin()
        shown: NDArray[np.float32] = observe(self._state, self._curvttc, self._tables)[nearest]
        return shown


class Driver(Protocol):
    """The driving system: the class needs no argument to be made."""

    def reset(self, begin: Begin) -> None:
        """Begin an episode."""

    def act(self, observation: Observation) -> Any:
        """Return what to do at this tick, see `command_of_answer`."""


_FORMS = {
    "vehicle": ("longitudinal", "lateral"),
    "vehicle_control": ("steer", "throttle", "brake"),
}
_RANGES = {
    "vehicle": ((-LARGEST_ACCELERATION, LARGEST_ACCELERATION),) * 2,
    "vehicle_control": ((-1.0, 1.0), (0.0, 1.0), (0.0, 1.0)),
}


def command_of_answer(answer: Any) -> tuple[str, tuple[float, ...]]:
    """Return what an answer commands: "vehicle" with two numbers, or "vehicle_control" with three.

    :param answer: acceleration along the car [m/s2]; or along it and to its left; or steer, throttle and brake.
    :raises InvalidInput: something else, or out of the range of the topic with the same command.
    """
    values = _numbers(answer)
    values = (*values, 0.0) if len(values) == 1 else values
    for name, form in _FORMS.items():
        inside = (low <= value <= high for value, (low, high) in zip(values, _RANGES[name], strict=False))
        if len(values) == len(form) and all(inside):
            return name, values
    raise InvalidInput(
        f"act returned {shown(answer)}; expected an acceleration along the car [m/s2], or one along it and one to its "
        f"left, finite and at most {LARGEST_ACCELERATION:g}, or steer -1..1, throttle 0..1 and brake 0..1"
    )


def _numbers(answer: Any) -> tuple[float, ...]:
    """Return the numbers of an answer; none where it holds anything else, such as texts or truth values."""
    if isinstance(answer, list | tuple) and any(isinstance(value, bool | np.bool_) for value in answer):
        return ()
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError):  # lists of different lengths
        return ()
    return tuple(array.astype(np.float64).ravel().tolist()) if array.dtype.kind in "iuf" else ()


def as_odometry(record: np.void, agent: str) -> PlanarMotion:
    """Return "vehicle" or "pedestrian" of an EPISODE record as who reads its odometry has it, to the bit."""
    motion = motion_of(record, agent)
    return motion._replace(yaw=2.0 * math.atan2(*motion.quaternion))


def as_object(seen: np.void) -> PlanarMotion:
    """Return one of `/perception/objects`, an OBJECT record, as who reads the float32 of its point has it."""
    x, y, vx, vy = (float(np.float32(seen[name])) for name in ("x", "y", "vx", "vy"))
    return PlanarMotion(x, y, math.atan2(vy, vx), math.hypot(vx, vy), 0.0)


def find_driver(text: str) -> type[Driver]:
    """Return the class that MODULE:CLASS names; a module may lie in the working directory.

    :raises InvalidInput: another form, no such module or class, one that cannot be imported, or no driver.
    """
    where = f"--ads-class {text!r}"
    module, _, name = text.partition(":")
    if not module or not name.isidentifier():
        raise InvalidInput(f"{where}: expected MODULE:CLASS, such as my_driver:MyDriver")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise InvalidInput(f"{where}: {module} cannot be imported: {error}") from error
        raise InvalidInput(
            f"{where}: no module {error.name!r}; install it, or run the command in the folder in which it is"
        ) from None
    except SystemExit as error:
        raise InvalidInput(
            f"{where}: {module} ends the program while it is imported (SystemExit: {error}); put its main under "
            "if __name__ == '__main__'"
        ) from error
    except BaseException as error:
        raise InvalidInput(f"{where}: {module} cannot be imported: {type(error).__name__}: {error}") from error
    driver = getattr(found, name, None)
    if not isinstance(driver, type):
        own = [key for key, value in vars(found).items() if isinstance(value, type) and value.__module__ == module]
        raise InvalidInput(f"{where}: {module} has no class {name!r}; it has {', '.join(own) or 'none'}")
    if missing := [method for method in ("reset", "act") if not callable(getattr(driver, method, None))]:
        raise InvalidInput(f"{where}: it has no {' and no '.join(missing)}; define reset(begin) and act(observation)")
    return driver
