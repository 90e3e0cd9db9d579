"""A run of an exam without ROS, with a Python class, an object in this process or the autopilot as driving system.

A driver that raises, or answers with something that is no command, loses that episode and no other: which ones are lost
does not depend on how many run side by side.
"""

import contextlib
import dataclasses
import itertools
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.data.dataset import write_episodes
from vpsci_ros.data.episode import Key
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.exam.class_process import class_process
from vpsci_ros.exam.driver_class import Answer, Answers, Cockpit, Scene
from vpsci_ros.exam.exam import SIDE_BY_SIDE, Exam
from vpsci_ros.exam.exam_config import BASELINE, title_of
from vpsci_ros.exam.process import log_name
from vpsci_ros.exam.result import Conduct, RunResult, block_of_ticks, write_result
from vpsci_ros.lockstep.intervention import Interventions
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.record import RUN_RECORD, write_record
from vpsci_ros.world import ENDED, IDLE, RUNNING, Recorded, World
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.parked import parked_from
from vpsci_ros.world.perception import PerceptionConfig, blank, perceive
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Step, Tick

_SHOWN = 10  # tracebacks in the log
_SIDE_BY_SIDE = 64  # episodes of the autopilot


def loop_with(exam: Exam, pedestrian: str, vehicle: str, episodes: list[Key], batch: int) -> Loop:
    """Return the simulation loop of these episodes with one pedestrian, in this process.

    :param vehicle: the world's `vehicle_driver`.
    :param batch: episodes side by side, at most.
    """
    config = exam.with_pedestrian(pedestrian, vehicle)
    recorded = None
    if config.pedestrian_driver == "replay":
        motion = exam.motion(pedestrian)
        recorded = Recorded({key: (np.zeros((len(rows), 5)), rows) for key, rows in motion.items()})
    agents = {}
    if config.pedestrian_driver == "policy":
        agents["pedestrian"] = agent = make_agent("pedestrian", exam.policy(pedestrian))
        if isinstance(agent, PolicyAgent):
            agent.load(load_policy(exam.weights), version=1)
    world = World(config, exam.scenarios, episodes, min(batch, len(episodes)), exam.run.seed, recorded)
    interventions = Interventions(exam.simulator.interventions) if vehicle == "external" else None
    return Loop(world, agents, interventions=interventions)


def autopilot_run(exam: Exam, pedestrian: str, to: Path | None = None) -> RunResult:
    """Run the rule-based autopilot with one pedestrian, many episodes side by side, and return the result.

    :param to: file into which its episodes are written.
    """
    steps = loop_with(exam, pedestrian, "autopilot", exam.episodes, _SIDE_BY_SIDE)
    block = block_of_ticks(steps, exam.scenarios)
    if to is not None:
        write_episodes(to, block, exam.world.tick, exam.scenarios)
    return RunResult(list(block.episodes(exam.world.tick, exam.scenarios, BASELINE)))


def run_in_process(exam: Exam, name: str, run: Path, log: Path, *, quiet: bool) -> None:
    """Run the driving system with one pedestrian without ROS, and write result and record into `run`.

    With `ads_test.bags` it writes a bag, too, and drives one episode after the other.
    """
    begun, config = time.monotonic(), exam.config
    run.mkdir(exist_ok=True)
    log.unlink(missing_ok=True)
    compile_kernels()
    loop = loop_with(exam, name, "external", exam.episodes, 1 if exam.driver or config.bags else SIDE_BY_SIDE)
    world = loop.world.config
    with contextlib.ExitStack() as stack:
        bars = stack.enter_context(Bars(quiet=quiet))
        drivers = stack.enter_context(_drivers(exam, log))
        cars = {key: car for car, key in enumerate(exam.episodes)}
        driven = DrivenLoop(loop, drivers(len(cars)), exam.perception, log, cars)
        ticks = driven.ticks(lambda done: bars.bar(title_of(name), done, len(exam.episodes)))
        if config.bags:
            made_by = {"made_by": "vpsci ads-test", "ads": config.examined}
            seen = list(ticks)
            write_ticks(_recorded(seen, driven.lost), world, run / "bag", made_by, scenarios=exam.scenarios)
            ticks = iter(seen)
        block = block_of_ticks(ticks, exam.scenarios).without(driven.lost)
        failure = driven.failure() or _kept_state(exam, name, block, drivers, log)
    said = f"{title_of(name)}: {failure}" if failure else ""
    conduct = Conduct(len(exam.episodes), driven.refused, failure=said)
    write_result(run, exam, block, conduct)
    write_record(
        run / RUN_RECORD,
        begun=begun,
        error=failure,
        results=dataclasses.asdict(conduct),
        inputs={exam.weights.name: sha256(exam.weights)} if "pedestrian" in loop.agents else {},
    )


@contextlib.contextmanager
def _drivers(exam: Exam, log: Path) -> Iterator[Callable[[int], Answers]]:
    """Yield a function that makes drivers for so many cars, and returns the function that has them answer."""
    patience, spawn = exam.patience, exam.world.spawn
    with contextlib.ExitStack() as stack:
        if exam.driver is not None:
            make = stack.enter_context(exam.driver(log, patience))
            yield lambda cars: Cockpit(make, exam.scenarios, cars, spawn).answers
            return
        process = stack.enter_context(class_process(exam.config.ads_class, log, patience))

        def made(cars: int) -> Answers:
            process.make_drivers(exam.scenarios, cars, spawn)
            return process.answers

        yield made


def _kept_state(exam: Exam, name: str, block: EpisodeBlock, drivers: Callable[[int], Answers], log: Path) -> str:
    """Return, in words, that the system keeps state from one episode to the next; "" if it is not seen to.

    With the first pedestrian half of the episodes are driven again: in reverse order, and by drivers of which each
    drives several. They have to come out the same to the bit.
    """
    if not exam.config.check_state or name != exam.config.opponents[0] or len(block) < 2:
        return ""
    keys = block.keys[:: -2 if len(block) > 2 else -1]
    cars = 1 if exam.driver else len(keys) // 2
    again = DrivenLoop(loop_with(exam, name, "external", keys, cars), drivers(cars), exam.perception, log)
    found = block_of_ticks(again.ticks(lambda _: None), exam.scenarios).without(again.lost).motions()
    before = block.motions()
    other = [f"{key[0]}:{key[1]}" for key in sorted(keys) if found.get(key) != before[key]]
    if not other:
        return ""
    return (
        f"the ADS keeps state from one episode to the next, or draws random numbers of its own: {len(other)} of "
        f"{len(keys)} episodes, such as {other[0]}, came out differently when it drove them again after others; "
        "reset has to clear all state (ads_test.check_state)"
    )


def _recorded(steps: Iterable[Step], lost: Collection[Key]) -> Iterator[Step]:
    """Yield the ticks of one episode after another for a bag, numbered anew, without those that were lost."""
    number = itertools.count()
    for step in steps:
        first = step.tick.state[0]
        if first["status"] != IDLE and (int(first["scenario"]), int(first["episode"])) not in lost:
            actions = step.actions.pedestrian if step.tick.policy_frame.any() else None
            yield step._replace(tick=step.tick._replace(number=next(number)), actions=Actions(pedestrian=actions))


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
            if self._take(key, scene.time, answer):
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
        state = tick.state[rows]
        frame = int(state["frame"][0])
        seed = int(np.random.SeedSequence([self._loop.world.seed, *key]).generate_state(1)[0]) if frame == 0 else 0
        return Scene(
            car=self._cars[key] if self._cars else rows.start // self._most,
            begins=(*key, seed) if frame == 0 else None,
            time=frame * self._period,
            state=state,
            curvttc=assessment.curvttc[rows],
            distance=assessment.distance[rows],
            objects=None if objects is None else objects[rows],
        )

    def _take(self, key: Key, time: float, answer: Answer) -> bool:
        """Return whether an answer is a command of the first one's form; if not, the episode is lost."""
        self._form = self._form or answer.form
        if answer.form and answer.form == self._form:
            return True
        other = f"act returned {tuple(answer.values)}, a command of another form than its first one"
        error = other if answer.form else answer.error
        self.refused += answer.refused or bool(answer.form)
        self.lost[key] = f"at {time:.2f} s {error}"
        if len(self.lost) <= _SHOWN:
            with self._log.open("a", encoding="utf-8", errors="backslashreplace") as log:
                print(f"{key[0]}:{key[1]} at {time:.2f} s: {error}\n{answer.trace}", file=log)
        return False
