"""Parameter files: the parameters that each stage reads; any other parameter is refused."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.documents import parse_yaml
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ExamConfig
from vpsci_ros.generate.job import DatasetConfig
from vpsci_ros.nodes.node_config import LEARNER, SECTIONS, section_classes
from vpsci_ros.parameters import EVERY_NODE, check_sections, read_parameter_file, refuse_unknown, table
from vpsci_ros.resources import params_path
from vpsci_ros.runs.run_config import Sections

SIMULATION = (
    "graph", "world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "perception", "recorder",
)  # fmt: skip
EXAM_SETS = ("graph.nodes", "world_simulator.batch", "world_simulator.episode_changes", "world_simulator.recorded_bag",
             "world_simulator.vehicle_driver", "world_simulator.pedestrian_driver")  # fmt: skip


class Stage(NamedTuple):
    """A stage and the parameters that it reads: learning, generation, or the exam.

    :ivar sections: section -> configuration classes read from it.
    :ivar sets: parameters that the stage itself sets, whatever the file says.
    """

    name: str
    sections: Mapping[str, tuple[type, ...]]
    sets: Sequence[str] = ()

    def reads(self, section: str) -> set[str]:
        """Return the names of the parameters that this stage reads from a section; for `/**`, from all sections."""
        parts = self.sections.values() if section == EVERY_NODE else [self.sections.get(section, ())]
        return {row.name for kinds in parts for kind in kinds for row in table(kind)}


def _sections(*names: str) -> dict[str, tuple[type, ...]]:
    return {name: SECTIONS[name] for name in names}


STAGES = {
    "pretrain": Stage(
        "stage 1 (learner.stage: pretrain)", _sections("graph", "recorder") | {"learner": LEARNER["pretrain"]}
    ),
    "refine": Stage("stage 2 (learner.stage: refine)", _sections(*SIMULATION) | {"learner": LEARNER["refine"]}),
    "generate": Stage("stage 3", _sections(*SIMULATION) | {"dataset": (DatasetConfig,)}),
    "exam": Stage("the exam", _sections(*SIMULATION) | {"ads_test": (ExamConfig,)}, sets=EXAM_SETS),
}
ELSEWHERE = (*STAGES.values(), Stage("the node replayer by itself", _sections("replayer")))


def load(path: str | Path, settings: Sequence[str] = ()) -> Sections:
    """Return the sections of a parameter file; its content selects the stage.

    :param path: of a file, or the name of one of the package's ("stage3_generate").
    :param settings: overrides, `section.parameter=value` with YAML values.
    :raises InvalidInput: see `read_parameter_file` and `check_sections`; a setting has another form; or the stage does
        not read a parameter. The message names all of these, each with the stages that read it.
    """
    sections = read_parameter_file(params_path(path))
    for text in settings:
        section, name, value = _assignment(text)
        sections[section] = sections.get(section, {}) | {name: value}
    stage = stage_of(sections)
    refused = [text for section, values in sections.items() for text in _unread(stage, section, values)]
    if refused:
        raise InvalidInput(f"{path}: {'; '.join(refused)}")
    return Sections(check_sections(sections, stage.sections, path))


def stage_of(sections: Mapping[str, Mapping[str, Any]]) -> Stage:
    """Return the stage that reads these sections of a parameter file.

    :raises InvalidInput: learner.stage is not a stage.
    """
    if "ads_test" in sections:
        return STAGES["exam"]
    if "learner" not in sections:
        return STAGES["generate"]
    kinds = section_classes("learner", sections["learner"])
    return STAGES["pretrain" if kinds == LEARNER["pretrain"] else "refine"]


def _unread(stage: Stage, section: str, values: Mapping[str, Any]) -> list[str]:
    """Return a text for each parameter of a section that only other stages read, or that this stage sets itself."""
    texts = []
    known = stage.reads(section)
    for name in values:
        full = f"{section}.{name}"
        readers = [other.name for other in ELSEWHERE if name in other.reads(section)]
        if full in stage.sets:
            texts.append(f"{full}: {stage.name} sets it itself")
        elif name not in known and readers:
            texts.append(f"{full}: nothing reads it in {stage.name}, but in {' and '.join(readers)}")
    return texts


def _assignment(text: str) -> tuple[str, str, Any]:
    target, found, value = text.partition("=")
    section, dot, name = target.partition(".")
    if not found or not dot:
        raise InvalidInput(f"--set {text}: expected NODE.PARAMETER=VALUE")
    rows = {row.name: row for stage in ELSEWHERE for kind in stage.sections.get(section, ()) for row in table(kind)}
    where = f"--set {text}"
    refuse_unknown({section: None}, {name: None for stage in ELSEWHERE for name in stage.sections}, where)
    if name not in rows and (own := _others_with(name, section)):
        option = "; or give --episodes N" if (section, name) == ("ads_test", "episodes") else ""
        raise InvalidInput(
            f"{where}: {section} has no parameter {name}; expected {' or '.join(f'{o}.{name}' for o in own)}{option}"
        )
    refuse_unknown({name: None}, rows, where)
    return section, name, rows[name].check(parse_yaml(value, where), where)


def _others_with(name: str, section: str) -> list[str]:
    """Return the sections beside this one, of a stage that reads it, that have a parameter of this name."""
    stages = [stage for stage in ELSEWHERE if section in stage.sections]
    return list(dict.fromkeys(other for stage in stages for other in stage.sections if name in stage.reads(other)))
