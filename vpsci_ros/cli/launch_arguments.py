"""The arguments of `ros2 launch` and the nodes' parameter file made from them. It does not import `launch`."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.cli.parameter_file import STAGES, load, stage_of
from vpsci_ros.documents import dump_yaml
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.parameters import as_ros_parameters, read_parameter_file
from vpsci_ros.resources import params_path
from vpsci_ros.runs.files import require_empty_folder, write_text


class Argument(NamedTuple):
    """A launch argument that sets parameters; an empty argument keeps the values of the parameter file.

    :ivar sets: stage -> the parameters that it sets, "section.name".
    """

    name: str
    description: str
    sets: Mapping[str, tuple[str, ...]]


_WORLD = ("refine", "generate")
_EVERY = ("pretrain", *_WORLD)
ARGUMENTS = (
    Argument("scenarios", "numbers, as in 1,8", dict.fromkeys(_WORLD, ("world_simulator.scenarios",))),
    Argument(
        "episodes",
        "in each scenario; stage 1: iterations",
        {"pretrain": ("learner.episodes",)} | dict.fromkeys(_WORLD, ("world_simulator.episodes",)),
    ),
    Argument(
        "batch",
        "parallel episodes; RViz and Foxglove need 1",
        dict.fromkeys(_WORLD, ("world_simulator.batch",)),
    ),
    Argument(
        "weights",
        "safetensors file or shipped name, for both policies; stage 2: to start from",
        {"refine": ("learner.weights",), "generate": ("vehicle_policy.weights", "pedestrian_policy.weights")},
    ),
    Argument(
        "near_misses",
        "Parquet files to learn from, separated by commas",
        dict.fromkeys(("pretrain", "refine"), ("learner.near_misses",)),
    ),
    Argument("namespace", "namespace of all nodes, such as /left", dict.fromkeys(_EVERY, ("graph.namespace",))),
)


class LaunchedRun(NamedTuple):
    """A run prepared for `ros2 launch`: its folder, parameter file and nodes.

    :ivar folder: output folder.
    :ivar parameters: file that all nodes take.
    :ivar nodes: executables of this package.
    :ivar namespace: of the nodes, empty for none.
    """

    folder: Path
    parameters: Path
    nodes: list[str]
    namespace: str


def prepare(params: str, output: str, given: Mapping[str, str], settings: str = "") -> LaunchedRun:
    """Check the arguments and write the nodes' parameter file with every default; return the run to start.

    :param params: a parameter file, or the name of one of the package's.
    :param output: folder, new or empty; empty: out/NAME-DATE-TIME.
    :param given: argument -> its value, empty for none.
    :param settings: more parameters, "NODE.PARAMETER=VALUE; ..."; the arguments come after them.
    :raises InvalidInput: a parameter is refused, an argument sets nothing in this stage, or the folder is not empty.
    """
    texts = [text.strip() for text in settings.split(";") if text.strip()]
    texts += _assignments(params, given)
    folder = Path(output or f"out/{params_path(params).stem}-{time.strftime('%Y%m%d-%H%M%S')}").absolute()
    sections = resolve(load(params, texts), folder)
    graph = sections.get(GraphConfig, "graph")
    parameters = require_empty_folder(folder) / "params.yaml"
    layout = as_ros_parameters(sections.values, any_namespace=True)
    write_text(parameters, dump_yaml(layout))
    return LaunchedRun(folder, parameters, graph.nodes, graph.namespace)


def _assignments(params: str, given: Mapping[str, str]) -> list[str]:
    """Return the arguments as `section.parameter=value`."""
    stage = stage_of(read_parameter_file(params_path(params)))
    (key,) = (key for key, each in STAGES.items() if each is stage)
    texts = []
    for argument in ARGUMENTS:
        value = given.get(argument.name, "")
        if value and key not in argument.sets:
            raise InvalidInput(f"{argument.name}:={value}: nothing reads it in {stage.name}, for which {params} is")
        if argument.name in ("scenarios", "near_misses") and value and not value.startswith("["):
            value = f"[{value}]"
        texts += [f"{target}={value}" for target in argument.sets.get(key, ()) if value]
    return texts
