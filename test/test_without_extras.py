"""What the core does in an environment without torch and the other extras, and what it says of those that it lacks."""

import ast
import json
import os
import subprocess
import sys
import sysconfig
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from vpsci_ros import errors

ROOT = Path(__file__).resolve().parents[1]
ABSENT = {"torch", "torchgen", "functorch", "stable_baselines3", "sklearn", "threadpoolctl", "gymnasium", "pettingzoo"}
RUN = """
import contextlib, io, json, sys
from vpsci_ros.cli import main
results = []
for arguments in json.loads(sys.argv[1]):
    sys.argv, status, text = ["vpsci", *arguments], 0, io.StringIO()
    with contextlib.redirect_stderr(text), contextlib.redirect_stdout(io.StringIO()):
        try:
            main.main()
        except SystemExit as end:
            status = end.code or 0
    results.append([status, text.getvalue()])
print(json.dumps([sorted(set(sys.modules) & {"torch"}), results]))
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """Python of an environment that has what this one has, by links, but for `ABSENT`."""
    prefix = tmp_path_factory.mktemp("core") / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", prefix], check=True, timeout=60)
    here, packages = Path(sys.prefix), Path(sysconfig.get_path("purelib"))
    there = prefix / packages.relative_to(here)
    names = {canonicalize_name(name) for module in ABSENT for name in packages_distributions().get(module, ())}
    for path in packages.iterdir():
        distribution = canonicalize_name(path.name.split("-")[0]) if path.suffix == ".dist-info" else ""
        if path.name not in ABSENT and distribution not in names:
            (there / path.name).symlink_to(path)
    for path in [*(here / "lib").iterdir(), here / "share"]:  # libraries and messages of ROS 2
        link = prefix / path.relative_to(here)
        if not link.exists():
            link.symlink_to(path)
    return prefix / "bin" / "python"


def run(python: Path, folder: Path, *commands: list[str]) -> list[tuple[int, str]]:
    """Run commands of `vpsci` one after the other; return exit status and standard error of each."""
    own = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    command = [python, "-c", RUN, json.dumps(commands)]
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=500)
    assert result.returncode == 0, result.stderr
    loaded, results = json.loads(result.stdout.splitlines()[-1])
    assert loaded == []
    return [(status, text) for status, text in results]


def test_dataset_exam_view_export_and_graph_run_where_there_is_no_torch(python, tmp_path):
    short = ["--set", "world_simulator.scenarios=[1]", "--set", "world_simulator.batch=1"]
    commands = [
        ["generate", "--params", "stage3_generate", "-o", "data", "--episodes", "1", "--workers", "1", *short[:2]],
        ["dataset", "verify", "data"],
        ["ads-test", "--params", "ads_test", "-o", "exam", "--episodes", "1", *short[:2],
         "--ads-class", "vpsci_ros.nodes.example_driver:ExampleDriver"],
        ["view", "data", "-o", "page.html"],
        ["export", "data", "--to", "carla-csv", "-o", "csv"],
        ["graph", "--params", "stage3_generate", "-o", "graph", "--set", "world_simulator.episodes=1", *short],
        ["bag", "verify", "graph/bag"],
    ]  # fmt: skip
    assert [status for status, _ in run(python, tmp_path, *commands)] == [0] * len(commands)


def test_what_needs_an_extra_names_it_in_one_line_and_leaves_nothing(python, tmp_path):
    data = ["--data", "right_turns/dev"]
    search = ["ads-search", "--params", "ads_test", "-o", "out", "--ads", "true"]
    commands = {
        ("pretrain", "--params", "stage1_pretrain", "-o", "out"): "learn",
        ("refine", "--params", "stage2_online", "-o", "out"): "learn",
        ("evaluate", *data): "learn",
        ("realism", *data): "learn",
        ("demo", "-o", "out"): "learn",
        ("node", "learner"): "learn",
        tuple(search): "exam_extra",
    }
    results = run(python, tmp_path, *map(list, commands))
    for (command, extra), (status, text) in zip(commands.items(), results, strict=True):
        assert status == 2, (command, text)
        assert text.endswith(f" is not installed: pip install 'vpsci_ros[{extra}]'\n"), (command, text)
        assert len(text.splitlines()) == 1, (command, text)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_environments_name_their_extra_as_an_import_error(python):
    program = "import warnings\ntry: import vpsci_ros.envs\nexcept ImportError as error: print(error.name, error)"
    result = subprocess.run([python, "-c", program], capture_output=True, text=True, timeout=60)
    assert result.stdout == "gymnasium gymnasium is not installed: pip install 'vpsci_ros[rl]'\n"


def test_every_module_that_a_hint_names_is_brought_by_that_extra():
    (extras,) = [
        ast.literal_eval(node.value)
        for node in ast.parse((ROOT / "setup.py").read_text()).body
        if isinstance(node, ast.Assign) and node.targets[0].id == "EXTRAS"
    ]
    brought = packages_distributions()
    for module, extra in errors._EXTRAS.items():
        wanted = {canonicalize_name(Requirement(line).name) for line in extras[extra]}
        if module in brought:  # not every extra is installed here
            assert wanted & {canonicalize_name(name) for name in brought[module]}, module
