"""The arguments of `ros2 launch` become parameters, checked before anything starts; launch files ask for nothing."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from vpsci_ros.cli.launch_arguments import prepare
from vpsci_ros.errors import InvalidInput

LAUNCH = Path(__file__).parents[2] / "launch"
FILES = sorted(path.name for path in LAUNCH.glob("*.launch.py"))
STAGES = {
    "stage1_pretrain.launch.py": ["learner", "recorder"],
    "stage2_online.launch.py": [
        *("world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "learner", "recorder")
    ],
    "stage3_generate.launch.py": [
        *("world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder")
    ],
    "graph.launch.py": [*("world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder")],
    "ads.launch.py": [*("world_simulator", "safety_monitor", "pedestrian_policy", "recorder", "example_ads")],
}


def parameters(run: Any) -> dict[str, Any]:
    file = yaml.safe_load(run.parameters.read_text())
    return {name.removeprefix("/**/"): section["ros__parameters"] for name, section in file.items()}


# ---- arguments become parameters


def test_arguments_override_the_file_in_every_section_that_they_mean(tmp_path: Path) -> None:
    given = {"scenarios": "1,8", "episodes": "3", "batch": "2", "weights": "closed_loop", "namespace": "/left"}
    run = prepare("stage3_generate", str(tmp_path / "out"), given, "world_simulator.seed=9; world_simulator.batch=64")
    values = parameters(run)
    world = values["world_simulator"]
    assert (world["scenarios"], world["episodes"], world["batch"], world["seed"]) == ([1, 8], 3, 2, 9)
    assert values["vehicle_policy"]["weights"] == values["pedestrian_policy"]["weights"] == "closed_loop"
    assert values["recorder"]["bag"] == str(tmp_path / "out/bag")
    assert (run.namespace, run.folder) == ("/left", tmp_path / "out")
    assert run.nodes == STAGES["stage3_generate.launch.py"]


@pytest.mark.parametrize(
    ("params", "given", "settings", "message"),
    [
        ("stage1_pretrain", {"batch": "2"}, "", "batch:=2: nothing reads it in stage 1"),
        ("stage3_generate", {"batch": "none"}, "", "world_simulator.*batch must be a whole number"),
        ("stage3_generate", {}, "world_simulator.sed=1", "unknown parameter 'sed'; did you mean seed"),
        ("stage4", {}, "", "stage4: no such parameter file"),
    ],
)
def test_what_is_not_to_be_run_is_refused_and_leaves_no_folder(
    tmp_path: Path, params: str, given: dict[str, str], settings: str, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        prepare(params, str(tmp_path / "out"), given, settings)
    assert not (tmp_path / "out").exists()


# ---- the launch files, with what stands in for `launch` where that is not installed


class Made:
    """What a launch file has made: a class's name and its arguments."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs

    def perform(self, context: dict[str, str]) -> str:
        return context[self.args[0]]


class StandIn(ModuleType):
    """A module of `launch` in which every class only keeps what it is made from."""

    def __getattr__(self, name: str) -> type:
        if not name[0].isupper():
            raise AttributeError(name)
        made = type(name, (Made,), {})
        setattr(self, name, made)
        return made


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Return the function that gives a launch file's module, arguments with defaults, and included files."""
    names = ("", ".actions", ".events", ".events.process", ".substitutions", ".launch_description_sources")
    for name in [f"launch{end}" for end in names] + ["launch_ros", "launch_ros.actions"]:
        monkeypatch.setitem(sys.modules, name, StandIn(name))

    def describe(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        path = LAUNCH / name
        module: dict[str, Any] = {"__file__": str(path), "__name__": path.stem}
        exec(compile(path.read_text(), path, "exec"), module)
        (entities,) = module["generate_launch_description"]().args
        declared = {each.args[0]: each for each in entities if type(each).__name__ == "DeclareLaunchArgument"}
        return module, declared

    return describe


@pytest.mark.parametrize("name", FILES)
def test_a_launch_file_starts_the_nodes_of_its_stage_with_its_defaults(
    described: Any, name: str, tmp_path: Path
) -> None:
    graph, declared = described("graph.launch.py")
    own, more = described(name)
    given = {key: each.kwargs["default_value"] for key, each in (declared | more).items()}
    if name == "ads.launch.py":
        given["set"] = "; ".join(own["WORLD"])
    started = graph["start"](given | {"output": str(tmp_path / "out")})
    nodes = [each.kwargs["executable"] for each in started if type(each).__name__ == "Node"]
    assert nodes == STAGES[name]
    assert all(each.kwargs["on_exit"] is graph["ended"] for each in started if type(each).__name__ == "Node")


def test_a_node_that_failed_fails_the_launch_and_one_that_ended_ends_it(described: Any) -> None:
    graph, _ = described("graph.launch.py")
    event = Made()
    event.process_name, event.returncode = "vehicle_policy-3", -9
    context = Made()
    context.is_shutdown = False
    with pytest.raises(RuntimeError, match="vehicle_policy-3 ended with exit status -9"):
        graph["ended"](event, context)
    event.returncode = 0
    assert type(graph["ended"](event, context)).__name__ == "Shutdown"
    context.is_shutdown = True
    assert graph["ended"](event, context) is None
