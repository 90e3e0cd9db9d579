"""Episodes of a driving system that is a Python class, many side by side in this process, without ROS.

They come out one whole episode after the other, in the order in which they were requested, as a graph of nodes drives
them. A class that raises, or answers with something that is no command, loses that episode and no other: which ones
are lost does not depend on how many run side by side.
"""

import itertools
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.driver_class import Begin, Driver, Observation, as_object, as_odometry, command_of_answer
from vpsci_ros.exam.patience import NoAnswer, within
from vpsci_ros.world import ENDED, IDLE, RUNNING
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.parked import parked_from
from vpsci_ros.world.perception import SEEN, PerceptionConfig, blank, perceive
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Step, Tick

SIDE_BY_SIDE = 256  # episodes, at most
PATIENCE = 60.0  # [s] for an answer
_HANGS = 3  # episodes lost for want of an answer, after which others have less time
_SHORT = 1.0  # [s] that they have
_SHOWN = 10  # tracebacks in the log


class InProcess:
    """Drivers of one class at the wheel of every car of a loop.

    :param make: the class.
    :param loop: whose world leaves the vehicle to an external driver.
    :param perception: errors of what is published of pedestrians; None: the drivers have their odometry.
    :param log: where the traceback of a driver that raises is written.
    :param patience: for an answer [s]: who takes longer loses the episode; after three, 1 s at most; 0: no limit.
    :ivar commands: that were good.
    :ivar refused: answers that were no commands.
    :ivar lost: episode -> when and why it was lost, in words.
    :raises InvalidInput: the class cannot be made.
    """

    def __init__(
        self,
        make: Callable[[], Driver],
        loop: Loop,
        perception: PerceptionConfig | None,
        log: Path,
        patience: float = PATIENCE,
    ) -> None:
        self._loop, self._perception, self._log, self._patience = loop, perception, log, patience
        self._hung = 0
        self._period, self._most = loop.world.config.tick, loop.world.config.pedestrians
        rows = len(loop.world.state)
        try:
            self._drivers = [make() for _ in range(rows // self._most)]
        except Exception as error:
            raise InvalidInput(
                f"{getattr(make, '__name__', make)}() cannot be made: {type(error).__name__}: {error}; the class of a "
                "driving system takes no argument"
            ) from error
        self._scenarios = {scenario.number: scenario for scenario in loop.world.scenarios}
        self._tables, self._parked = tables_from(loop.world.scenarios), parked_from(loop.world.scenarios)
        self._memory = blank(rows, perception, self._period) if perception else None
        self._form = ""  # of commands, that of the first one
        self.commands = self.refused = 0
        self.lost: dict[Key, str] = {}

    def episodes(self, wanted: list[Key], report: Callable[[int], None]) -> Iterator[Step]:
        """Yield the ticks of one episode after the other; of a lost one, those before it was lost.

        :param wanted: the episodes of the world's queue, in its order.
        :param report: called now and then with how many have ended.
        """
        number = itertools.count()
        ticks: dict[Key, list[Step]] = {}
        ended: set[Key] = set()
        steps = self._steps()
        for key in wanted:
            while key not in ended:
                step = next(steps)
                for rows, episode in self._present(step.tick.state):
                    if episode not in self.lost:
                        ticks.setdefault(episode, []).append(_part(step, rows))
                    if step.tick.state["status"][rows.start] == ENDED:
                        ended.add(episode)
                report(len(ended))
            for each in ticks.pop(key, ()):
                yield each._replace(tick=each.tick._replace(number=next(number)))

    def failure(self) -> str:
        """Return why not all episodes were driven to their end; empty where they were."""
        if not self.lost:
            return ""
        (scenario, episode), why = next(iter(sorted(self.lost.items())))
        others = f" and {len(self.lost) - 1} more" if len(self.lost) > 1 else ""
        return f"the ADS did not drive {scenario}:{episode}{others} to the end: {why} (log: {self._log})"

    def _steps(self) -> Iterator[Step]:
        while not self._loop.world.done:
            tick, assessment = self._loop.world.now, self._loop.assessment
            yield self._loop.step(self._answers(tick, assessment))

    def _present(self, state: NDArray[np.void]) -> Iterator[tuple[slice, Key]]:
        """Yield rows and key of each episode that runs or has just ended in EPISODE[B]."""
        first = state[:: self._most]
        for slot in np.flatnonzero(first["status"] != IDLE):
            rows = slice(int(slot) * self._most, (int(slot) + 1) * self._most)
            yield rows, (int(first["scenario"][slot]), int(first["episode"][slot]))

    def _answers(self, tick: Tick, assessment: Assessment) -> Actions:
        """Return what all drivers do at a tick."""
        objects = None
        if self._memory is not None and self._perception is not None:
            self._memory, objects = perceive(
                self._memory, tick.state, self._perception, self._period, self._parked, self._most
            )
        given: dict[int, tuple[float, ...]] = {}
        for rows, key in self._present(tick.state):
            if tick.state["status"][rows.start] != RUNNING or key in self.lost:
                continue
            driver, seen = self._drivers[rows.start // self._most], None if objects is None else objects[rows]
            observed = self._observation(tick.state[rows], assessment, rows, seen)
            begin = self._begin(key) if tick.state["frame"][rows.start] == 0 else None
            try:
                with within(self._patience if self._hung < _HANGS else min(self._patience, _SHORT)):
                    if begin is not None:
                        driver.reset(begin)
                    answer = driver.act(observed)
                given[rows.start] = self._command(answer)
            except (Exception, SystemExit, NoAnswer) as error:  # noqa: BLE001  # whatever a stranger's class raises
                self._hung += isinstance(error, NoAnswer)
                self._lose(key, observed.time, error)
        if not self._form:
            return NO_ACTIONS
        values = np.zeros((len(tick.state), 3 if self._form == "vehicle_control" else 2))
        for first, command in given.items():
            values[first : first + self._most] = command
        return Actions(**{self._form: values})

    def _begin(self, key: Key) -> Begin:
        seed = np.random.SeedSequence([self._loop.world.seed, *key]).generate_state(1)
        return Begin(self._scenarios[key[0]], key[1], int(seed[0]))

    def _observation(
        self, state: NDArray[np.void], assessment: Assessment, rows: slice, seen: NDArray[np.void] | None
    ) -> Observation:
        present = state[state["status"] != IDLE]
        people = [as_odometry(record, "pedestrian") for record in present]
        if seen is not None:
            people = [as_object(record) for record in seen[seen["status"] == SEEN]]
        curvttc, distance = assessment.curvttc[rows], assessment.distance[rows]
        return Observation(
            time=float(state["frame"][0]) * self._period,
            vehicle=as_odometry(state[0], "vehicle"),
            pedestrians=tuple(people),
            curvttc=float(curvttc.min()),
            distance=float(distance.min()),
            _state=state,
            _curvttc=curvttc,
            _tables=self._tables,
        )

    def _command(self, answer: Any) -> tuple[float, ...]:
        try:
            form, values = command_of_answer(answer)
            self._form = self._form or form
            if form != self._form:
                raise InvalidInput(f"act returned {answer!r}, a command of another form than its first one")
        except InvalidInput:
            self.refused += 1
            raise
        self.commands += 1
        return values

    def _lose(self, key: Key, time: float, error: BaseException) -> None:
        """Give an episode up, for a driver that raised or answered with no command."""
        said = str(error) if isinstance(error, InvalidInput | NoAnswer) else f"{type(error).__name__}: {error}"
        self.lost[key] = f"at {time:.2f} s {said}"
        if len(self.lost) <= _SHOWN:
            with self._log.open("a", encoding="utf-8") as log:
                print(f"{key[0]}:{key[1]} at {time:.2f} s", file=log)
                traceback.print_exception(error, file=log)


def _part(step: Step, rows: slice) -> Step:
    """Return the rows of one episode of a step."""
    tick, assessed = step.tick, step.assessment
    actions = NO_ACTIONS
    if step.actions.pedestrian is not None and tick.policy_frame[rows].any():
        actions = Actions(pedestrian=step.actions.pedestrian[rows])
    arrays = {name: getattr(assessed, name)[rows] for name in ("curvttc", "distance", "critical", "acting")}
    return Step(
        tick=tick._replace(state=tick.state[rows], policy_frame=tick.policy_frame[rows]),
        assessment=assessed._replace(**arrays),
        actions=actions,
        events=step.events[:0],
    )
