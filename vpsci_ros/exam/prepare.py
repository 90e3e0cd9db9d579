"""An exam before anything runs: its parameters are checked, and what identifies it is collected."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.episodes.sources import EXAM
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.class_process import files_of_class
from vpsci_ros.exam.config import EXTERNAL, ExamConfig, added_pedestrians
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.process import OWN, command_of, files_of
from vpsci_ros.policy.agent_types import AGENT_TYPES
from vpsci_ros.resources import near_misses_path
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.files import require_empty_folder, sha256, write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.safe_stop import ExternalConfig

_CHECKED_AGAIN = ("fail_if", "failure")  # parameters that may change when an exam is checked again


def prepare(sections: Sections, ads: str | None = None, ads_class: str | None = None, workers: int = 1) -> Exam:
    """Check everything that can be checked before anything runs.

    :param ads, ads_class: the driving system, instead of the one that the parameters name: a command, or MODULE:CLASS.
    :param workers: runs side by side.
    :raises InvalidInput: a parameter, the command, the class, weights or recordings are refused.
    """
    if ads is not None and ads_class is not None:
        raise InvalidInput("--ads and --ads-class exclude each other: a driving system is a program or a class")
    given: dict[str, Any] = {"ads": ads, "ads_class": ""} if ads is not None else {}
    given |= {"ads_class": ads_class} if ads_class else {}
    chosen = sections.changed("ads_test", given).changed("world_simulator", {"batch": 1})
    if "weights" not in chosen.values.get("pedestrian_policy", {}):
        chosen = chosen.changed("pedestrian_policy", {"weights": "people"})
    config = chosen.get(ExamConfig, "ads_test")
    run, world = chosen.get(RunConfig, "world_simulator"), chosen.get(WorldConfig, "world_simulator")
    exam = Exam(chosen, config, run, world)
    if config.ads_class:
        require_lock_step(exam)
    if config.ads_class or config.baseline:
        exam.engine.require_own("a class and the autopilot (ads_test.baseline) drive")
    if workers > 1 and config.examined == EXTERNAL:
        raise InvalidInput(f"--workers {workers}: a system that you start yourself (external) drives in one graph only")
    if config.examined.strip() == OWN and world.pedestrians > 1 and not config.perception:
        raise InvalidInput(
            f"ads_test.ads = {OWN}: /pedestrian/odometry holds the first pedestrian only, and "
            f"world_simulator.pedestrians = {world.pedestrians}; set ads_test.perception to true, which lists all"
        )
    if config.recorded:
        exam.engine.require_own("recorded people are replayed")
        read_near_misses(config.recorded)
    _ = exam.weights, exam.scenarios
    return dataclasses.replace(exam, files=driver_files(config))


def require_lock_step(exam: Exam) -> None:
    """Refuse real time for a system that is called at every tick, however long it takes.

    :raises InvalidInput: the world would not wait for it.
    """
    if exam.sections.get(ExternalConfig, "world_simulator").external_mode != "lock_step":
        raise InvalidInput(
            "world_simulator.external_mode = real_time: a system that drives without ROS is called at every tick, "
            "however long it takes; examine it as a program that speaks ROS, by --ads"
        )


def driver_files(config: ExamConfig) -> dict[str, str]:
    """Return the files of the driving system, each with its SHA-256.

    :raises InvalidInput: there is no such program or class.
    """
    if config.ads_class:
        return files_of_class(config.ads_class)
    if config.ads == EXTERNAL:
        return {}
    command_of(config.ads)
    return files_of(config.ads)


def identity_of(exam: Exam) -> dict[str, Any]:
    """Return what identifies an exam: runs of exams with equal ones can be reused."""
    examined = {name: value for name, value in dataclasses.asdict(exam.config).items() if name not in _CHECKED_AGAIN}
    nodes = ("world_simulator", "safety_monitor", "pedestrian_policy", *(["perception"] if exam.perception else []))
    whole = {"whole": list(exam.whole.run.only)} if exam.whole else {}  # of which it is a part
    return whole | {
        "ads": exam.config.examined,
        "seat": exam.seat is not None,
        "ads_files_sha256": dict(exam.files),
        "parameters": {name: dict(exam.sections.values.get(name, {})) for name in nodes} | {"ads_test": examined},
        "world": dataclasses.asdict(exam.world),
        "scenarios_sha256": {scenario.name: scenario.sha256 for scenario in exam.scenarios},
        "weights_sha256": sha256(exam.weights),
        "agents": {name: AGENT_TYPES.origin(name) for name in exam.config.opponents if name in added_pedestrians()},
        "recorded_sha256": sha256(near_misses_path(exam.config.recorded)) if exam.config.recorded else "",
        "software": software_versions(),
        "cpu": cpu_name(),
    }


def exam_of(identity: Mapping[str, Any], *, examined: bool = False) -> Exam:
    """Return the exam that an identity is of, so that its pedestrians are the same again.

    :param examined: with its driving system, too; otherwise with none.
    :raises InvalidInput: its parameters are refused.
    """
    sections = Sections(identity["parameters"])
    ads = None if examined else EXTERNAL
    exam = prepare(sections, ads)
    if "whole" not in identity:
        return exam
    everything = sections.changed("world_simulator", {"only": identity["whole"]})
    return dataclasses.replace(exam, whole=prepare(everything, EXTERNAL))


def take_folder(folder: Path, identity: dict[str, Any], name: str = EXAM) -> None:
    """Begin this exam in the folder, or go on with it there.

    :param name: of the file that says what it is.
    :raises InvalidInput: it holds something else.
    """
    path = folder / name
    if not path.is_file():
        require_empty_folder(folder)
        write_json(path, identity)
        return
    stored = read_json(path)
    require_form(stored, dict, f"{path}: not what an exam writes; choose another output folder")
    require_same(folder, stored, identity, "holds an exam")
