"""Drivers at the wheel of many cars: what each one gets at a tick, and the command that it answers with.

A class is seated so in a process of its own (`class_process`), a person in this one.
"""

import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import printable
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.driver_class import Begin, Driver, Observation, as_object, as_odometry, command_of_answer
from vpsci_ros.exam.patience import NoAnswer, within
from vpsci_ros.world import IDLE, Scenario
from vpsci_ros.world.perception import SEEN
from vpsci_ros.world.tables import tables_from

_HANGS = 3  # episodes lost for want of an answer, after which others have less time
_SHORT = 1.0  # [s] that they have
_SHOWN = 300  # characters of an error in a report
_TRACED = 10_000  # characters of a traceback in a log


class Scene(NamedTuple):
    """One episode at one tick.

    :ivar seat: number of its driver.
    :ivar begins: number of the scenario, number of the episode and seed, at its first tick; else None.
    :ivar time: since it began [s].
    :ivar state: EPISODE[P].
    :ivar curvttc, distance: float64[P] [s], [m].
    :ivar objects: OBJECT[P] of `/perception/objects`; None: the driver has odometry.
    """

    seat: int
    begins: tuple[int, int, int] | None
    time: float
    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]
    objects: NDArray[np.void] | None


class Answer(NamedTuple):
    """The answer to a scene.

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


Answers = Callable[[Sequence[Scene]], Iterable[Answer]]
"""Called with the scenes of a tick, gives an answer to each in their order."""


class Cockpit:
    """Drivers of one class, one for each seat.

    :param make: the class.
    :param patience: for an answer [s]; after three episodes without one, 1 s at most; 0: no limit.
    :raises InvalidInput: the class cannot be made.
    """

    def __init__(self, make: Callable[[], Driver], scenarios: Sequence[Scenario], seats: int, patience: float) -> None:
        try:
            self._drivers = [make() for _ in range(seats)]
        except (Exception, SystemExit) as error:
            raise InvalidInput(
                f"{getattr(make, '__name__', make)}() cannot be made: {said(error)}; the class of a driving system "
                "takes no argument"
            ) from error
        self._scenarios = {scenario.number: scenario for scenario in scenarios}
        self._tables = tables_from(scenarios)
        self._patience, self._hung = patience, 0

    def answers(self, scenes: Iterable[Scene]) -> Iterator[Answer]:
        """Yield the answer to each scene; an error of the driver, whatever it is, is an answer."""
        return map(self._answer, scenes)

    def _answer(self, scene: Scene) -> Answer:
        driver, returned = self._drivers[scene.seat], False
        try:
            with within(self._patience if self._hung < _HANGS else min(self._patience, _SHORT)):
                if scene.begins is not None:
                    number, episode, seed = scene.begins
                    driver.reset(Begin(self._scenarios[number], episode, seed))
                answer = driver.act(self._observation(scene))
                returned = True
                return Answer(*command_of_answer(answer))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001  # whatever a stranger's class raises
            self._hung += isinstance(error, NoAnswer)
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
    """Return what an error of a stranger's code says, in one printable line."""
    own = isinstance(error, InvalidInput | NoAnswer)
    try:
        text = str(error) if own else f"{type(error).__name__}: {error}"
    except BaseException:  # noqa: BLE001  # its text is the stranger's code, too
        text = type(error).__name__
    return printable(" ".join(text.split()))[:_SHOWN]
