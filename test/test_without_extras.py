"""The trunk does its work without torch and other extras, and where `vpsci_ros/extras/` is not there."""

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from vpsci_ros import errors
from vpsci_ros.policy.compiling import DONE, PARTS, compile_kernels

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
print(json.dumps([sorted(set(sys.modules) & {"torch"}), main.__file__, results]))
"""
DATA, SHORT = ["--data", "right_turns/dev"], ["--episodes", "1", "--set", "world_simulator.scenarios=[1]"]
WORKS = [
    ["generate", "--params", "stage3_generate", "-o", "data", "--workers", "1", *SHORT],
    ["dataset", "verify", "data", "--workers", "1"],
    ["ads-test", "--params", "ads_test", "-o", "exam", "--ads-class", "vpsci_ros.nodes.example_driver:ExampleDriver",
     "--set", "ads_test.pedestrians=[walker]", "--set", "ads_test.baseline=false", *SHORT],
    ["view", "data", "-o", "page.html"],
    ["graph", "--params", "stage3_generate", "-o", "graph", "--set", "world_simulator.episodes=1", *SHORT[2:],
     "--set", "world_simulator.batch=1", "--set", "graph.composed=true"],
    ["bag", "verify", "graph/bag"],
]  # fmt: skip
NEED_LEARN = [
    ["pretrain", "--params", "stage1_pretrain", "-o", "out"],
    ["refine", "--params", "stage2_online", "-o", "out"],
    ["evaluate", *DATA],
    ["demo", "-o", "out"],
    ["node", "learner"],
]


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """Python of an environment that has what this one has, by links, but for `ABSENT`."""
    prefix = tmp_path_factory.mktemp("core") / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", prefix], check=True, timeout=60)
    here, packages = Path(sys.prefix), Path(sysconfig.get_path("purelib"))
    there = prefix / packages.relative_to(here)
    brought = packages_distributions()
    names = {canonicalize_name(name) for module in ABSENT for name in brought.get(module, ())}
    for path in packages.iterdir():
        distribution = canonicalize_name(path.name.split("-")[0]) if path.suffix == ".dist-info" else ""
        if path.name not in ABSENT and distribution not in names:
            (there / path.name).symlink_to(path)
    for path in [*(here / "lib").iterdir(), here / "share"]:  # libraries and messages of ROS 2
        link = prefix / path.relative_to(here)
        if not link.exists():
            link.symlink_to(path)
    return prefix / "bin" / "python"


def compiled_for(copy: Path) -> Path:
    """Return a cache in which numba finds the kernels of this package as those of its copy: folders by their path."""
    compile_kernels()
    cache = copy / "compiled"
    cache.mkdir()
    for part in PARTS:
        (cache / (DONE + part)).touch()
    for room in filter(Path.is_dir, (copy / "vpsci_ros").rglob("*")):
        here = Path(os.environ["NUMBA_CACHE_DIR"]) / numba_folder(ROOT / room.relative_to(copy))
        if here.is_dir():
            (cache / numba_folder(room)).symlink_to(here)
    return cache


def numba_folder(room: Path) -> str:
    return f"{room.name}_{hashlib.sha1(str(room).encode()).hexdigest()}"


@pytest.mark.timeout(600)  # where no kernel is compiled yet, it compiles all of them
def test_the_trunk_works_without_torch_and_branches_and_names_the_extra_of_what_does_not(python, tmp_path):
    copy, folder = tmp_path / "copy", tmp_path / "runs"
    folder.mkdir()
    shutil.copytree(ROOT / "vpsci_ros", copy / "vpsci_ros", ignore=shutil.ignore_patterns("extras", "__pycache__"))
    for name in ("package.xml", "params", "msg_defs", "urdf"):
        (copy / name).symlink_to(ROOT / name)
    own = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    environment |= {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(compiled_for(copy))}
    far = ["generate", "--params", "stage3_generate", "-o", "far", "--cluster", "tcp://127.0.0.1:1"]
    command = [python, "-c", RUN, json.dumps([*NEED_LEARN, *WORKS, ["drive", "-o", "drive"], far])]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    loaded, where, results = json.loads(done.stdout.splitlines()[-1])
    assert loaded == []
    assert Path(where).is_relative_to(copy)
    for arguments, (status, text) in zip(NEED_LEARN, results, strict=False):
        assert status == 2, (arguments, text)
        assert " is not installed: pip install 'torch" in text, (arguments, text)
        assert len(text.splitlines()) == 1, (arguments, text)
    assert not (folder / "out").exists()
    assert [status for status, _ in results[len(NEED_LEARN) :]] == [0] * len(WORKS) + [2, 2], results
    assert "--cluster tcp://127.0.0.1:1: this vpsci_ros lacks extras/cluster; install it again" in results[-1][1]
    assert (folder / "page.html").stat().st_size > 10_000


def test_environments_name_their_extra_as_an_import_error(python):
    program = "import warnings\ntry: import vpsci_ros.envs\nexcept ImportError as error: print(error.name, error)"
    result = subprocess.run([python, "-c", program], capture_output=True, text=True, timeout=60)
    assert result.stdout.startswith("gymnasium gymnasium is not installed: pip install 'gymnasium")


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
