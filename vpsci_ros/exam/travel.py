"""An exam on another machine: the user's files that go with it, and the check that the same system drives there."""

import contextlib
import dataclasses
import importlib.util
import shlex
from collections.abc import Iterable
from pathlib import Path

import vpsci_ros
from vpsci_ros.exam.exam import Exam, driver_files
from vpsci_ros.exam.process import code_of_class
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.workers import Place

_PACKAGE = Path(vpsci_ros.__file__).resolve().parent


def files_to_take(exam: Exam) -> list[Path]:
    """Return the user's files that a run reads: the system's in the working directory, and those that its nodes read.

    :raises InvalidInput: the class is not there any more.
    """
    config, here = exam.config, Path.cwd()
    words = [Path(word).absolute() for word in shlex.split(config.ads)]
    code = code_of_class(config.ads_class) if config.ads_class else [path for path in words if path.is_file()]
    named = [path.absolute() for path in (exam.weights, *map(Path, exam.run.scenario_files))]
    return [
        *(path for path in code if path.is_relative_to(here)),
        *(path for path in named if not path.resolve().is_relative_to(_PACKAGE)),
    ]


def arrived(exam: Exam, place: Place) -> Exam:
    """Return the exam for a worker's place: there, its nodes read the copies of the user's files.

    :raises InvalidInput: the files of the driving system differ there, or its program is missing.
    """
    if not place.remote:
        return exam
    config, roads = exam.config, [place.path(path) for path in exam.run.scenario_files]
    weights = {"weights": place.path(exam.policy(LEARNED).weights)}
    sections = exam.sections.changed("pedestrian_policy", weights)
    sections = sections.changed("world_simulator", {"scenario_files": roads} if roads else {})
    there = _class_files(config.ads_class, exam.files) if config.ads_class else driver_files(config)
    advice = "the driving system has to be the same there"
    require_same("this worker", {"files": there}, {"files": dict(exam.files)}, "has a driving system", advice)
    return dataclasses.replace(exam, sections=sections)


def _class_files(text: str, names: Iterable[str]) -> dict[str, str]:
    """Return name -> SHA-256 of the files of the class MODULE:CLASS that are there, see `files_of_class`."""
    files = {name: Path(name) for name in names}
    with contextlib.suppress(ImportError):  # it is not there
        found = importlib.util.find_spec(text.partition(":")[0])
        if found and found.origin and (path := Path(found.origin)).name in files:
            files[path.name] = path
    return {name: sha256(path) for name, path in files.items() if path.is_file()}
