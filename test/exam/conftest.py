"""What tests of exams share: one exam that was driven, and drivers in this process."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest
from class_in_process import class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import Exam, prepare
from vpsci_ros.resources import params_dir

Forked = Callable[[], AbstractContextManager[None]]
EXAMPLE = "vpsci_ros.nodes.example_driver:ExampleDriver"


def small(ads_class: str = EXAMPLE, *, bags: bool = False, recorded: str = "", **world: Any) -> Exam:
    """Return an exam of four episodes with the default pedestrian and the walker, without the baseline."""
    short = {"scenarios": [1, 104], "episodes": 2, "episode_time": 3.0} | world
    chosen = {
        "pedestrians": ["learned", "walker"],
        "baseline": False,
        "allow_standing": True,
        "timing": "autopilot",
        "bags": bags,
        "recorded": recorded,
    }
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", short).changed("ads_test", chosen)
    return prepare(sections, ads_class=ads_class)


@pytest.fixture(scope="session")
def small_exam() -> Callable[..., Exam]:
    """Return the function `small`."""
    return small


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory, forked_classes: Forked) -> Path:
    """Folder of the small exam of the example, whose class had a process of its own; not to be changed."""
    folder = tmp_path_factory.mktemp("driven") / "exam"
    with forked_classes():
        assert run_exam(small(), folder, ["ticks_unanswered > 0"], quiet=True) == []
    return folder


@pytest.fixture
def here() -> Iterator[None]:
    """Have exams call classes in this process."""
    with class_in_process():
        yield
