"""Episodes that a driving system drives through the loop, many side by side, without ROS.

They come out one whole episode after the other, in the order in which they were requested, as a graph of nodes drives
them. A driver that raises, or answers with something that is no command, loses that episode and no other: which ones
are lost does not depend on how many run side by side.
"""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.exam.cockpit import Answer, Answers, Scene
from vpsci_ros.world import ENDED, IDLE, RUNNING
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.parked import parked_from
from vpsci_ros.world.perception import PerceptionConfig, blank, perceive
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Step, Tick

SIDE_BY_SIDE = 256  # episodes, at most
PATIENCE = 60.0  # [s] for an answer
_SHOWN = 10  # tracebacks in the log


class InProcess:
    """A driving system at the wheel of every car of a loop.

    :param loop: whose world leaves the vehicle to an external driver.
    :param answers: of the driving system, a seat for each car.
    :param perception: errors of what is published of pedestrians; None: the drivers have their odometry.
    :param log: where the traceback of a driver that raises is written.
    :ivar commands: that were good.
    :ivar refused: answers that were no commands.
    :ivar lost: episode -> when and why it was lost, in words.
    """

    def __init__(self, loop: Loop, answers: Answers, perception: PerceptionConfig | None, log: Path) -> None:
        self._loop, self._ask, self._perception, self._log = loop, answers, perception, log
        self._period, self._most = loop.world.config.tick, loop.world.config.pedestrians
        self._parked = parked_from(loop.world.scenarios)
        self._memory = blank(len(loop.world.state), perception, self._period) if perception else None
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
        waiting = [
            (rows, key)
            for rows, key in self._present(tick.state)
            if tick.state["status"][rows.start] == RUNNING and key not in self.lost
        ]
        scenes = [self._scene(tick, assessment, rows, key, objects) for rows, key in waiting]
        given: dict[int, Answer] = {}
        for (rows, key), scene, answer in zip(waiting, scenes, self._ask(scenes), strict=True):
            if found := self._command(key, scene.time, answer):
                given[rows.start] = found
        if not self._form:
            return NO_ACTIONS
        values = np.zeros((len(tick.state), 3 if self._form == "vehicle_control" else 2))
        for first, command in given.items():
            values[first : first + self._most] = command.values
        return Actions(**{self._form: values})

    def _scene(
        self, tick: Tick, assessment: Assessment, rows: slice, key: Key, objects: NDArray[np.void] | None
    ) -> Scene:
        state = tick.state[rows]
        frame = int(state["frame"][0])
        seed = int(np.random.SeedSequence([self._loop.world.seed, *key]).generate_state(1)[0]) if frame == 0 else 0
        return Scene(
            seat=rows.start // self._most,
            begins=(*key, seed) if frame == 0 else None,
            time=frame * self._period,
            state=state,
            curvttc=assessment.curvttc[rows],
            distance=assessment.distance[rows],
            objects=None if objects is None else objects[rows],
        )

    def _command(self, key: Key, time: float, answer: Answer) -> Answer | None:
        """Count an answer and return it; None, and the episode is lost, where it is no command."""
        self._form = self._form or answer.form
        if answer.form and answer.form == self._form:
            self.commands += 1
            return answer
        other = f"act returned {tuple(answer.values)}, a command of another form than its first one"
        error = other if answer.form else answer.error
        self.refused += answer.refused or bool(answer.form)
        self.lost[key] = f"at {time:.2f} s {error}"
        if len(self.lost) <= _SHOWN:
            with self._log.open("a", encoding="utf-8", errors="backslashreplace") as log:
                print(f"{key[0]}:{key[1]} at {time:.2f} s: {error}\n{answer.trace}", file=log)
        return None


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
