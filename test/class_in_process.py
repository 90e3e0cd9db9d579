"""Classes of driving systems in the process of a test: for tests that are not about a class's own process."""

import contextlib
import inspect
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from vpsci_ros.exam.drivers import Answers, Cockpit
from vpsci_ros.exam.process import find_driver
from vpsci_ros.runs.files import sha256
from vpsci_ros.world import Scenario

CARELESS = """
class Careless:
    def reset(self, begin):
        pass

    def act(self, observation):
        return 2.0 * (5.0 - observation.vehicle.speed)
"""  # a module's text; it drives at 5 m/s, whoever is in its way


class WithoutProcess:
    """What `vpsci_ros.exam.process` yields, without a process."""

    answers: Answers

    def __init__(self, text: str) -> None:
        self._driver = find_driver(text)

    def make_drivers(self, scenarios: Sequence[Scenario], cars: int, spawn: str) -> None:
        self.answers = Cockpit(self._driver, scenarios, cars, spawn).answers


@contextlib.contextmanager
def class_in_process() -> Iterator[None]:
    """Have exams call a class in this process while the `with` block lasts."""

    @contextlib.contextmanager
    def without_process(text: str, *_: Any) -> Iterator[WithoutProcess]:
        yield WithoutProcess(text)

    def files(text: str) -> dict[str, str]:
        path = Path(inspect.getfile(find_driver(text)))
        return {path.name: sha256(path)}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vpsci_ros.exam.run.class_process", without_process)
        patch.setattr("vpsci_ros.exam.exam.files_of_class", files)
        yield
