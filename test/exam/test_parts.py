"""An exam of many episodes: driven in parts, by however many workers, in whatever order they end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam import collect, conduct
from vpsci_ros.exam import exam as exam_module
from vpsci_ros.exam.conduct import run_with_all
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.prepare import prepare
from vpsci_ros.exam.report import Conduct
from vpsci_ros.exam.run import read_exam, run_exam
from vpsci_ros.resources import params_dir

EXAMPLE = "vpsci_ros.nodes.example_driver:ExampleDriver"
DIES_ONCE = """
import os, signal
from pathlib import Path
from vpsci_ros.nodes.example_driver import ExampleDriver

class Mine(ExampleDriver):
    def reset(self, begin):
        if (begin.scenario.number, begin.episode) == (104, 1) and not Path("died").exists():
            Path("died").touch()
            os.kill(os.getppid(), signal.SIGKILL)  # the worker, and this process with it
"""


def small(ads_class: str = EXAMPLE, **exam: Any) -> Exam:
    world = {"scenarios": [1, 104], "episodes": 3, "episode_time": 6.0}
    chosen = {"pedestrians": ["learned", "walker"], "baseline": False} | exam
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", world).changed("ads_test", chosen)
    return prepare(sections, ads_class=ads_class)


def report_of(folder: Path) -> dict[str, Any]:
    report: dict[str, Any] = json.loads((folder / "report.json").read_text())
    return {name: value for name, value in report.items() if name != "exam"}


def test_parts_workers_and_a_worker_that_dies_change_nothing_that_comes_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "dies_once.py").write_text(DIES_ONCE)
    one, two = tmp_path / "one", tmp_path / "two"
    assert run_exam(small(), one, quiet=True) == []
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 4)
    assert run_exam(small("dies_once:Mine"), two, workers=2, quiet=True) == []
    assert (tmp_path / "died").exists()
    assert {path.name for path in (two / "runs").iterdir()} == {
        "alone", "alone-2", "learned", "learned-2", "walker", "walker-2"
    }  # fmt: skip
    assert pl.read_parquet(two / "episodes.parquet").equals(pl.read_parquet(one / "episodes.parquet"))
    assert report_of(two) == report_of(one)
    shown = {source.key: sorted(each.episode.name for each in source.episodes) for source in read_exam(two, 9)}
    assert shown == {f"ads-{name}": ["104:0", "104:1", "104:2", "1:0", "1:1", "1:2"] for name in ("learned", "walker")}


class Backwards:
    """Four workers, of whom the last one to begin is the first one to finish."""

    size = 4

    def __init__(self, job: Callable[[], Callable[[conduct.Run], RunResult]]) -> None:
        self._do, self._units = job(), list[conduct.Run]()

    def submit(self, unit: conduct.Run) -> None:
        self._units.append(unit)

    def collect(self) -> list[tuple[conduct.Run, RunResult]]:
        unit = self._units.pop()
        return [(unit, self._do(unit))]

    def close(self) -> None:
        pass


@pytest.mark.parametrize("size", [1, 4])
def test_after_a_run_without_an_episode_none_counts_whoever_finished_first(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def driven(part: Exam, name: str, *_: object, **__: object) -> RunResult:
        lost = (name, part.part) == ("learned", 0)
        return RunResult([] if lost else [name], Conduct(2, refused=1, failure="it died" if lost else ""))  # type: ignore[list-item]

    if size > 1:
        monkeypatch.setattr(conduct, "local_workers", lambda job, _: Backwards(job))
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 3)
    monkeypatch.setattr(conduct, "run_with", driven)
    monkeypatch.setattr(collect, "sorted", lambda episodes, **_: list(episodes), raising=False)
    found = run_with_all(small(), tmp_path, ["alone", "learned", "walker"], workers=size, quiet=True)
    assert {name: len(run.episodes) for name, run in found.items()} == {"alone": 2, "learned": 0}
    assert found["alone"].conduct == Conduct(6, refused=2)
    assert found["learned"].conduct == Conduct(6, refused=1, failure="it died")


def test_in_parts_the_same_recorded_person_comes_in_the_same_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    exam = small(recorded="right_turns")
    whole = exam.motion("recorded")
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 4)
    parts = [part.motion("recorded") for part in exam.parts()]
    assert [len(part) for part in parts] == [4, 2]
    for part in parts:
        assert all(np.array_equal(motion, whole[key]) for key, motion in part.items())


def test_a_system_that_one_starts_oneself_has_one_worker() -> None:
    with pytest.raises(InvalidInput, match="--workers 2: a system that you start yourself"):
        prepare(load(params_dir() / "ads_test.yaml"), "external", workers=2)
