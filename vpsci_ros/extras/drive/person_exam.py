"""The exam of a person: each episode is driven in the page and stored as a run; a report follows at the end.

The output folder is that of an exam (`vpsci_ros.exam.conduct`), with replays/ beside it. The same command goes on
after the episodes that are driven.
"""

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.drivers import Driver
from vpsci_ros.exam.exam import EXTERNAL, PERSON, Exam, identity_of, prepare, sealed, take_folder, title_of
from vpsci_ros.exam.result import RunResult, label_of, read_result
from vpsci_ros.exam.run import autopilot_run, is_done, loop_with, run_with
from vpsci_ros.extras.drive.drive_page import Page
from vpsci_ros.extras.drive.person import Person
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.view.view_page import Source, shown, write_view
from vpsci_ros.world.tick import Actions

RELOADED = 3.0  # [s] in which a page that was closed may come back, as when it is loaded again


def prepare_person(sections: Sections) -> tuple[Exam, float]:
    """Return the exam of a person, and the ratio of simulated to wall time (1.0: real time).

    :raises InvalidInput: see `prepare`, or its time does not go.
    """
    exam = prepare(sections, ads=EXTERNAL)
    factor = sections.get(SimulatorConfig, "world_simulator").real_time_factor
    if factor <= 0.0:
        raise InvalidInput("world_simulator.real_time_factor = 0: a person drives in real time; set it to 1.0")
    config = dataclasses.replace(exam.config, ads=PERSON, bags=True)
    return dataclasses.replace(exam, config=config), factor


def run_drive(exam: Exam, factor: float, folder: Path, page: Page) -> list[str]:
    """Run the exam with a person at the page, show the results, and write the files of an exam.

    :param exam: of `prepare_person`, with its factor.
    :returns: why not all episodes were driven; empty: they were.
    :raises InvalidInput: `folder` holds something else.
    """
    period = exam.world.tick

    @contextlib.contextmanager
    def at_the_page(*_: object) -> Iterator[Callable[[], Driver]]:
        yield lambda: Person(page, period, factor)

    exam = sealed(dataclasses.replace(exam, driver=at_the_page))
    take_folder(folder, identity_of(exam))
    _compile(exam)
    runs = [(name, part) for name in exam.opponents for part in exam.parts()]
    driven = 0
    for number, (name, part) in enumerate(runs, 1):
        if is_done(part, folder, name):
            driven += 1  # before, by an earlier command
            continue
        result = _drive(part, name, folder, page, f"episode {number} of {len(runs)}")
        if not result.episodes:
            break
        driven += 1
        _show(part, name, folder, page, result, more=number < len(runs))
    page.finished = True  # nobody is to be waited for while the report is made
    failures = run_exam(exam, folder, quiet=True) if driven else ["nothing was driven"]
    page.send("end", driven=driven, text=f"Bags, tables and the report are in {folder}.")
    return failures


def _drive(part: Exam, name: str, folder: Path, page: Page, which: str) -> RunResult:
    """Return what one episode came to; begun again when its page was closed, empty when the person has finished."""
    (key,) = part.episodes
    scenario = next(each for each in part.scenarios if each.number == key[0])
    while True:
        page.begin(f"{key[0]}:{key[1]}", scenario, which)
        run_with(part, name, folder)
        result = read_result(folder, name, part.part)
        if result.episodes or page.finished:
            return result
        print(f"{which}: {result.conduct.failure}; it begins again", file=sys.stderr)


def _show(part: Exam, name: str, folder: Path, page: Page, result: RunResult, *, more: bool) -> None:
    """Show how an episode ended, with a page in which it plays beside the autopilot's."""
    (episode,) = result.episodes
    replay = folder / "replays" / f"{label_of(name, part.part)}.html"
    replay.parent.mkdir(exist_ok=True)
    both = {"you": [shown(episode)], "autopilot": [shown(each) for each in autopilot_run(part, name).episodes]}
    sources = [Source(key, f"{key}, {title_of(name)}", episode.period, own, 1) for key, own in both.items()]
    write_view(replay, sources, f"Episode {episode.name}, {title_of(name)}")
    collided = episode.outcome == "collision"
    page.send(
        "result",
        outcome=episode.outcome,
        least=episode.least_curvttc,
        yielded=both["you"][0].yielded,
        impact=float(episode.speed[-1]) if collided else 0.0,
        replay=f"replays/{replay.name}#b=autopilot",
        more=more,
    )


def _compile(exam: Exam) -> None:
    """Compile the kernels that an episode runs, so that the person does not wait when the first one begins."""
    for name in exam.opponents:
        loop = loop_with(exam, name, "external", exam.episodes[:1], 1)
        still = Actions(vehicle_control=np.tile([0.0, 0.2, 0.0], (len(loop.world.state), 1)))
        for _ in loop.ticks(lambda *_, still=still: still):
            pass
