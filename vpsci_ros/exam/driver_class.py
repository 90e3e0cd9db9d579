"""A driving system as a Python class: finding it, its observations, and its commands.

It is written without this package and without ROS: `reset(begin)` before each episode, `act(observation)` at each tick
of it. One object drives one episode at a time, and many objects drive side by side, so that an episode comes out the
same whatever the others do, as long as objects share nothing that changes.
"""

import importlib
import math
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import printable, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.external_driver import LARGEST_ACCELERATION
from vpsci_ros.wire.layout import PlanarMotion, motion_of
from vpsci_ros.world import IDLE, Scenario
from vpsci_ros.world.perception import SEEN
from vpsci_ros.world.tables import Tables, tables_from

_SHOWN = 300  # characters of an error in a report
_TRACED = 10_000  # characters of a traceback in a log


class Begin(NamedTuple):
    """The argument of `reset`: the episode that begins.

    :ivar scenario: where; `scenario.vehicle.path` is the lane's centre line.
    :ivar episode: its number within the scenario.
    :ivar seed: of the driver's own random numbers, if it has any: one for each episode, the same in every exam.
    """

    scenario: Scenario
    episode: int
    seed: int


@dataclass(frozen=True)
class Observation:
    """The argument of `act`: the values of one tick, bit-identical to those on the ROS topics.

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
        """Return this tick as the observation of `RightTurnEnv`, float32[21], see `vpsci_ros.envs.task`."""
        from vpsci_ros.envs.task import observe

        nearest = self._curvttc.argmin()
        shown: NDArray[np.float32] = observe(self._state, self._curvttc, self._tables)[nearest]
        return shown


class Driver(Protocol):
    """Interface of a driving system; its constructor takes no argument."""

    def reset(self, begin: Begin) -> None:
        """Prepare for the episode `begin`."""

    def act(self, observation: Observation) -> Any:
        """Return the command at this tick, see `command_of_answer`."""


_FORMS = {
    "vehicle": ("longitudinal", "lateral"),
    "vehicle_control": ("steer", "throttle", "brake"),
}
_RANGES = {
    "vehicle": ((-LARGEST_ACCELERATION, LARGEST_ACCELERATION),) * 2,
    "vehicle_control": ((-1.0, 1.0), (0.0, 1.0), (0.0, 1.0)),
}


def command_of_answer(answer: Any) -> tuple[str, tuple[float, ...]]:
    """Return the command in an answer of `act`: ("vehicle", two numbers) or ("vehicle_control", three numbers).

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
    """Return the number or the row of numbers of an answer; () for anything else, such as texts or truth values."""
    if isinstance(answer, list | tuple) and any(isinstance(value, bool | np.bool_) for value in answer):
        return ()
    try:
        array = np.asarray(answer)
    except (TypeError, ValueError):  # lists of different lengths
        return ()
    if array.ndim > 1 or array.dtype.kind not in "iuf":
        return ()
    return tuple(array.astype(np.float64).ravel().tolist())


def as_odometry(record: np.void, agent: str) -> PlanarMotion:
    """Return the motion of the `agent` in an EPISODE record, bit-identical to the values on its odometry topic."""
    motion = motion_of(record, agent)
    return motion._replace(yaw=2.0 * math.atan2(*motion.quaternion))


def as_object(seen: np.void) -> PlanarMotion:
    """Return the motion of an OBJECT record, with the float32 values of its point in `/perception/objects`."""
    x, y, vx, vy = (float(np.float32(seen[name])) for name in ("x", "y", "vx", "vy"))
    return PlanarMotion(x, y, math.atan2(vy, vx), math.hypot(vx, vy), 0.0)


def find_driver(text: str) -> type[Driver]:
    """Return the class that MODULE:CLASS names; MODULE is installed or lies in the working directory.

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


class Scene(NamedTuple):
    """One tick of one episode, which the driver of the episode's car answers.

    :ivar car: number of the car, and of its driver.
    :ivar begins: number of the scenario, number of the episode and seed, at its first tick; else None.
    :ivar time: since it began [s].
    :ivar state: EPISODE[P].
    :ivar curvttc, distance: float64[P] [s], [m].
    :ivar objects: OBJECT[P] of `/perception/objects`; None: the driver has odometry.
    """

    car: int
    begins: tuple[int, int, int] | None
    time: float
    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]
    objects: NDArray[np.void] | None


class Answer(NamedTuple):
    """A driver's answer to a scene: a command, or the reason why there is none.

    :ivar form, values: of the command, see `command_of_answer`; without one the form is empty.
    :ivar error: why there is no command.
    :ivar trace: its traceback.
    :ivar refused: something was returned that is no command.
    """

    form: str = ""
    values: Sequence[float] = ()
    error: str = ""
    trace: str = ""
    refused: bool = False


def received_answer(values: Any) -> Answer:
    """Return the `Answer` that another process sent as JSON; a command that `act` may not return is refused.

    :raises InvalidInput: it is no answer.
    """
    match values:
        case ["", _, str(error), str(trace), bool(refused)] if error:
            return Answer(error=printable(error)[:_SHOWN], trace=trace[-_TRACED:], refused=refused)
        case [form, list(command), _, _, _] if form in [*_FORMS]:
            try:
                found, numbers = command_of_answer(command)
            except InvalidInput as problem:
                return Answer(error=said(problem), refused=True)
            if found == form:
                return Answer(form, numbers)
    raise InvalidInput(f"its process sent {shown(values)[:_SHOWN]}, which is no answer")


Answers = Callable[[Sequence[Scene]], Iterable[Answer]]
"""Called with the scenes of a tick, gives an answer to each in their order."""


class Cockpit:
    """Drivers of one class, one for each car.

    :param make: the class.
    :param spawn: `WorldConfig.spawn`, which places the goals that the drivers observe.
    :raises InvalidInput: the class cannot be made.
    """

    def __init__(self, make: Callable[[], Driver], scenarios: Sequence[Scenario], cars: int, spawn: str) -> None:
        try:
            self._drivers = [make() for _ in range(cars)]
        except (Exception, SystemExit) as error:
            hint = "; the class of a driving system takes no argument" if isinstance(error, TypeError) else ""
            raise InvalidInput(f"{getattr(make, '__name__', make)}() cannot be made: {said(error)}{hint}") from error
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        self._tables = tables_from(scenarios, spawn)

    def answers(self, scenes: Iterable[Scene]) -> Iterator[Answer]:
        """Yield the answer to each scene; any error of the driver is returned as an answer."""
        return map(self._answer, scenes)

    def _answer(self, scene: Scene) -> Answer:
        driver, returned = self._drivers[scene.car], False
        try:
            if scene.begins is not None:
                number, episode, seed = scene.begins
                driver.reset(Begin(self._scenarios[number], episode, seed))
            answer = driver.act(self._observation(scene))
            returned = True
            return Answer(*command_of_answer(answer))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001  # the driving system's class may raise anything
            trace = "".join(traceback.format_exception(error))[-_TRACED:]
            return Answer(error=said(error), trace=trace, refused=returned)

    def _observation(self, scene: Scene) -> Observation:
        present = scene.state[scene.state["status"] != IDLE]
        people = [as_odometry(record, "pedestrian") for record in present]
        if scene.objects is not None:
            people = [as_object(record) for record in scene.objects[scene.objects["status"] == SEEN]]
        return Observation(
            time=scene.time,
            vehicle=as_odometry(scene.state[0], "vehicle"),
            pedestrians=tuple(people),
            curvttc=float(scene.curvttc.min()),
            distance=float(scene.distance.min()),
            _state=scene.state,
            _curvttc=scene.curvttc,
            _tables=self._tables,
        )


def said(error: BaseException) -> str:
    """Return the message of an error in the driving system's code, in one printable line."""
    try:
        text = str(error) if isinstance(error, InvalidInput) else f"{type(error).__name__}: {error}"
    except BaseException:  # noqa: BLE001  # its text comes from the driving system's code, too
        text = type(error).__name__
    return printable(" ".join(text.split()))[:_SHOWN]
