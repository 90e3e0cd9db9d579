"""Who drives: the messages between exam and driving system, the check of its answers, and the loop in which it drives.

A driver is written without this package and without ROS: `reset(begin)` before each episode, `act(observation)` at each
tick of it. The exam sends a `Scene` for each car, and gets an `Answer` to each; in between is an object in this process
(`Cockpit`), a class in its own process (`exam.process`), or a program behind a socket. Many drivers drive side by side.
A driver that raises, or answers with something that is no command, loses that episode and no other.
"""

import math
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.documents import printable, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.external_driver import LARGEST_ACCELERATION, RANGES, form_of
from vpsci_ros.wire.layout import PlanarMotion, motion_of
from vpsci_ros.world import ENDED, IDLE, RUNNING, Scenario
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.parked import parked_from
from vpsci_ros.world.perception import SEEN, PerceptionConfig, blank, perceive
from vpsci_ros.world.tables import Tables, tables_from
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Step, Tick

_SHOWN = 300  # characters of an error in a report
_TRACED = 10_000  # characters of a traceback in a log
_LOGGED = 10  # tracebacks in a log


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
    _tables: Tables | None = None  # of the driver's process, which has them once for all ticks

    def of_environment(self) -> NDArray[np.float32]:
        """Return this tick as the observation of `RightTurnEnv`, float32[21], see `vpsci_ros.envs.task`."""
        from vpsci_ros.envs.task import observe

        if self._tables is None:
            raise InvalidInput("of_environment: expected an exam's observation, got one without the scenarios' tables")
        nearest = self._curvttc.argmin()
        shown: NDArray[np.float32] = observe(self._state, self._curvttc, self._tables)[nearest]
        return shown


class Driver(Protocol):
    """Interface of a driving system; its constructor takes no argument."""

    def reset(self, begin: Begin) -> None:
        """Prepare for the episode `begin`."""

    def act(self, observation: Observation) -> Any:
        """Return the command at this tick, see `command_of_answer`."""


def command_of_answer(answer: Any) -> tuple[str, tuple[float, ...]]:
    """Return the command in an answer of `act`: ("vehicle", two numbers) or ("vehicle_control", three numbers).

    :param answer: acceleration along the car [m/s2]; or along it and to its left; or steer, throttle and brake.
    :raises InvalidInput: something else, or out of the range of the topic with the same command.
    """
    values = _numbers(answer)
    values = (*values, 0.0) if len(values) == 1 else values
    if form := form_of(values):
        return form, values
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


class Scene(NamedTuple):
    """One tick of one episode, which the driver of the episode's car answers.

    :ivar car: number of the car, and of its driver.
    :ivar seed: of `Begin`, at the first tick of the episode; else None.
    """

    car: int
    key: Key
    seed: int | None
    observation: Observation


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
        case [form, list(command), _, _, _] if form in RANGES:
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
            if scene.seed is not None:
                scenario, episode = scene.key
                driver.reset(Begin(self._scenarios[scenario], episode, scene.seed))
            answer = driver.act(replace(scene.observation, _tables=self._tables))
            returned = True
            return Answer(*command_of_answer(answer))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001  # the driving system's class may raise anything
            trace = "".join(traceback.format_exception(error))[-_TRACED:]
            return Answer(error=said(error), trace=trace, refused=returned)


def said(error: BaseException) -> str:
    """Return the message of an error in the driving system's code, in one printable line."""
    try:
        text = str(error) if isinstance(error, InvalidInput) else f"{type(error).__name__}: {error}"
    except BaseException:  # noqa: BLE001  # its text comes from the driving system's code, too
        text = type(error).__name__
    return printable(" ".join(text.split()))[:_SHOWN]


class DrivenLoop:
    """A simulation loop in which a driving system drives every car.

    :param loop: whose world leaves the vehicle to an external driver.
    :param answers: of the driving system, for each car.
    :param perception: errors of what is published of pedestrians; None: the drivers have their odometry.
    :param log: where the traceback of a driver that raises is written.
    :param cars: the car of each episode; None: one car in each slot, which drives several episodes in turn.
    :ivar refused: number of answers that were no commands.
    :ivar lost: episode -> when and why it was lost, in words.
    """

    def __init__(
        self,
        loop: Loop,
        answers: Answers,
        perception: PerceptionConfig | None,
        log: Path,
        cars: Mapping[Key, int] | None = None,
    ) -> None:
        self._loop, self._ask, self._perception, self._log, self._cars = loop, answers, perception, log, cars
        self._period, self._most = loop.world.config.tick, loop.world.config.pedestrians
        self._parked = parked_from(loop.world.scenarios)
        self._memory = blank(len(loop.world.state), perception, self._period) if perception else None
        self._form = ""  # of commands, that of the first one
        self.refused = 0
        self.lost: dict[Key, str] = {}

    def ticks(self, report: Callable[[int], None]) -> Iterator[Step]:
        """Simulate, and yield every tick of the loop.

        :param report: called with how many episodes have ended.
        """
        ended = 0
        for step in self._loop.ticks(self._answers):
            ended += int(np.count_nonzero(step.tick.state["status"][:: self._most] == ENDED))
            report(ended)
            yield step

    def failure(self) -> str:
        """Return the reason for which episodes are unfinished; "" if all were driven to their end."""
        if not self.lost:
            return ""
        (scenario, episode), why = next(iter(sorted(self.lost.items())))
        others = f" and {len(self.lost) - 1} more" if len(self.lost) > 1 else ""
        return f"the ADS did not drive {scenario}:{episode}{others} to the end: {why} (log: {log_name(self._log)})"

    def _driven(self, state: NDArray[np.void]) -> Iterator[tuple[slice, Key]]:
        """Yield rows and key of each running episode in EPISODE[B] that is not lost."""
        first = state[:: self._most]
        for slot in np.flatnonzero(first["status"] == RUNNING).tolist():
            key = int(first["scenario"][slot]), int(first["episode"][slot])
            if key not in self.lost:
                yield slice(slot * self._most, (slot + 1) * self._most), key

    def _answers(self, tick: Tick, assessment: Assessment) -> Actions:
        """Return what all drivers do at a tick."""
        objects = None
        if self._memory is not None and self._perception is not None:
            self._memory, objects = perceive(
                self._memory, tick.state, self._perception, self._period, self._parked, self._most
            )
        driven = list(self._driven(tick.state))
        scenes = [self._scene(tick, assessment, rows, key, objects) for rows, key in driven]
        commands: list[tuple[slice, Sequence[float]]] = []
        for (rows, key), scene, answer in zip(driven, scenes, self._ask(scenes), strict=True):
            if self._take(key, scene.observation.time, answer):
                commands.append((rows, answer.values))
        if not self._form:
            return NO_ACTIONS
        values = np.zeros((len(tick.state), 3 if self._form == "vehicle_control" else 2))
        for rows, command in commands:
            values[rows] = command
        return Actions(**{self._form: values})

    def _scene(
        self, tick: Tick, assessment: Assessment, rows: slice, key: Key, objects: NDArray[np.void] | None
    ) -> Scene:
        state, curvttc = tick.state[rows], assessment.curvttc[rows]
        frame = int(state["frame"][0])
        seed = None if frame else int(np.random.SeedSequence([self._loop.world.seed, *key]).generate_state(1)[0])
        people = [as_odometry(record, "pedestrian") for record in state[state["status"] != IDLE]]
        if objects is not None:
            seen = objects[rows]
            people = [as_object(record) for record in seen[seen["status"] == SEEN]]
        observation = Observation(
            time=frame * self._period,
            vehicle=as_odometry(state[0], "vehicle"),
            pedestrians=tuple(people),
            curvttc=float(curvttc.min()),
            distance=float(assessment.distance[rows].min()),
            _state=state,
            _curvttc=curvttc,
        )
        car = self._cars[key] if self._cars else rows.start // self._most
        return Scene(car, key, seed, observation)

    def _take(self, key: Key, time: float, answer: Answer) -> bool:
        """Return whether an answer is a command of the first one's form; if not, the episode is lost."""
        self._form = self._form or answer.form
        if answer.form and answer.form == self._form:
            return True
        other = f"act returned {tuple(answer.values)}, a command of another form than its first one"
        error = other if answer.form else answer.error
        self.refused += answer.refused or bool(answer.form)
        self.lost[key] = f"at {time:.2f} s {error}"
        if len(self.lost) <= _LOGGED:
            with self._log.open("a", encoding="utf-8", errors="backslashreplace") as log:
                print(f"{key[0]}:{key[1]} at {time:.2f} s: {error}\n{answer.trace}", file=log)
        return False


def log_name(log: Path) -> str:
    """Return a log's name as results have it, within the exam's folder: logs/ads_walker.log."""
    return f"{log.parent.name}/{log.name}"
