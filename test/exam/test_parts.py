"""An exam of many episodes: driven in parts, by however many workers, in whatever order they end."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from vpsci_ros.documents import read_json
from vpsci_ros.exam import conduct
from vpsci_ros.exam import exam as exam_module
from vpsci_ros.exam.conduct import run_with_all, timed_runs
from vpsci_ros.exam.exam import ADS, Exam
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.result import Conduct, RunResult, label_of
from vpsci_ros.exam.view import stored_episodes
from vpsci_ros.runs.workers import Serial, ThisMachine

Small = Callable[..., Exam]
DIES_ONCE = """
import os, signal
from pathlib import Path
from vpsci_ros.nodes.example_driver import ExampleDriver

class Mine(ExampleDriver):
    def reset(self, begin):
        if (begin.scenario.number, begin.episode) == (1, 0) and not Path("died").exists():
            Path("died").touch()
            os.kill(os.getppid(), signal.SIGKILL)  # the worker, and this process with it
"""


def test_parts_workers_and_a_worker_that_dies_change_nothing_that_comes_out(
    driven: Path, small_exam: Small, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers are processes of their own, in which classes have theirs; `here` only spares this process one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "dies_once.py").write_text(DIES_ONCE)
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 3)
    exam, two = small_exam("dies_once:Mine"), ThisMachine(2)
    found = run_with_all(exam, tmp_path, ["walker"], workers=two, quiet=True)["walker"]
    assert (tmp_path / "died").exists()
    assert {path.name for path in (tmp_path / "runs" / "walker").iterdir()} == {"1", "2"}
    table = episode_table(found, [], driver="ads", pedestrian="walker").drop("time_lost")
    whole = pl.read_parquet(driven / "episodes.parquet").filter(pl.col("pedestrian") == "walker")
    assert table.equals(whole.drop("time_lost"))
    stored = stored_episodes(tmp_path, ADS, "walker")
    assert sorted(episode.name for episode in stored) == ["104:0", "104:1", "1:0", "1:1"]


class Backwards:
    """Four workers, of whom the last one to begin is the first one to finish."""

    size, spare = 4, 1

    def __init__(self, job: Callable[[], Callable[[conduct.Run], None]]) -> None:
        self._do, self._units = job(), list[conduct.Run]()

    def submit(self, unit: conduct.Run) -> None:
        self._units.append(unit)

    def collect(self) -> list[tuple[conduct.Run, None]]:
        unit = self._units.pop()
        return [(unit, self._do(unit))]

    def close(self) -> None:
        pass


@pytest.mark.parametrize("size", [1, 4])
def test_after_a_run_without_an_episode_none_counts_whoever_finished_first(
    size: int, small_exam: Small, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results: dict[str, RunResult] = {}

    def driven(part: Exam, name: str, *_: object, **__: object) -> None:
        lost = (name, part.part) == ("learned", 0)
        found = [] if lost else [SimpleNamespace(key=(1, part.part))]
        said = Conduct(2, refused=1, failure="it died" if lost else "")
        results[label_of(name, part.part)] = RunResult(found, said)  # type: ignore[arg-type]

    monkeypatch.setattr("vpsci_ros.runs.workers.Processes", lambda job, _: Backwards(job))
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 3)
    monkeypatch.setattr(conduct, "run_with", driven)
    monkeypatch.setattr(conduct, "read_result", lambda _, name, part: results[label_of(name, part)])
    site = ThisMachine(size)
    found = run_with_all(small_exam(), tmp_path, ["alone", "learned", "walker"], workers=site, quiet=True)
    assert {name: len(run.episodes) for name, run in found.items()} == {"alone": 2, "learned": 0}
    assert found["alone"].conduct == Conduct(4, refused=2)
    assert found["learned"].conduct == Conduct(4, refused=1, failure="it died")


def test_the_workers_of_the_empty_road_drive_the_pedestrians_too(
    small_exam: Small, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Timing comes between the two, and travels with each run: workers whose job had it would have to start anew."""
    started: list[Serial[conduct.Run, None]] = []

    def serial(job: Callable[[], Callable[[conduct.Run], None]], _: int) -> Serial[conduct.Run, None]:
        started.append(Serial(job))
        return started[-1]

    monkeypatch.setattr("vpsci_ros.runs.workers.Processes", serial)
    exam = small_exam(episode_time=30.0)
    own = dataclasses.replace(exam, config=dataclasses.replace(exam.config, timing="own"))
    runs, timing = timed_runs(own, tmp_path, workers=ThisMachine(2), quiet=True)
    assert len(started) == 1
    assert list(runs) == ["alone", "learned", "walker"]
    assert any(timed.head_start for timed in timing.values())
    stored = read_json(tmp_path / "runs" / "walker" / "1" / "result.json")
    assert stored["head_starts"] == [[timed.head_start, timed.straight] for timed in timing.values()]


def test_an_episode_has_the_same_recorded_person_in_whatever_part_it_is_driven(small_exam: Small, here: None) -> None:
    exam = small_exam(recorded="right_turns/dev")
    whole, part = exam.motion("recorded"), exam.only([(104, 0), (1, 1)]).motion("recorded")
    assert list(whole) == [(1, 0), (104, 0), (1, 1), (104, 1)]
    assert part.keys() == {(104, 0), (1, 1)}
    assert all(np.array_equal(motion, whole[key]) for key, motion in part.items())
