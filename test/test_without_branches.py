"""The trunk does its work where `vpsci_ros/extras/` is not there: help, a dataset, an exam, a bag and a page."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vpsci_ros  # noqa: F401 (chooses the cache of numba)

ROOT = Path(__file__).resolve().parents[1]
RUN = """
import contextlib, io, json, sys
from vpsci_ros.cli import main
results = []
for arguments in json.loads(sys.argv[1]):
    sys.argv, status, text = ["vpsci", *arguments], 0, io.StringIO()
    with contextlib.redirect_stderr(text), contextlib.redirect_stdout(text):
        try:
            main.main()
        except SystemExit as end:
            status = end.code or 0
    results.append([status, text.getvalue()])
print(json.dumps([main.__file__, results]))
"""
SHORT = ["--episodes", "1", "--set", "world_simulator.scenarios=[1]"]


def compiled_for(copy: Path) -> Path:
    """Return a cache in which numba finds the kernels of this package as those of its copy: folders by their path."""
    cache = copy / "compiled"
    cache.mkdir()
    for room in filter(Path.is_dir, (copy / "vpsci_ros").rglob("*")):
        here = Path(os.environ["NUMBA_CACHE_DIR"]) / numba_folder(ROOT / room.relative_to(copy))
        if here.is_dir():
            (cache / numba_folder(room)).symlink_to(here)
    return cache


def numba_folder(room: Path) -> str:
    return f"{room.name}_{hashlib.sha1(str(room).encode()).hexdigest()}"


@pytest.mark.timeout(600)  # where no kernel is compiled yet, it compiles all of them
def test_without_its_branches_the_package_makes_a_dataset_an_exam_a_bag_and_a_page(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "vpsci_ros", tmp_path / "vpsci_ros", ignore=shutil.ignore_patterns("extras", "__pycache__"))
    for name in ("package.xml", "params", "msg_defs", "urdf"):
        (tmp_path / name).symlink_to(ROOT / name)
    one_run = [
        "--ads-class",
        "vpsci_ros.nodes.example_driver:ExampleDriver",
        "--set",
        "ads_test.pedestrians=[walker]",
        "--set",
        "ads_test.bags=true",
    ]
    commands = [
        ["--help"],
        ["generate", "-o", "data", "--params", "stage3_generate", "--workers", "1", *SHORT],
        ["dataset", "verify", "data"],
        ["ads-test", "-o", "exam", "--params", "ads_test", *SHORT, *one_run],
        ["bag", "info", "exam/runs/walker/bag"],
        ["view", "data", "-o", "page.html"],
        ["drive", "-o", "drive"],
    ]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(compiled_for(tmp_path))}
    command = [sys.executable, "-c", RUN, json.dumps(commands)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    where, results = json.loads(done.stdout.splitlines()[-1])
    assert Path(where).is_relative_to(tmp_path)
    assert [status for status, _ in results] == [0, 0, 0, 0, 0, 0, 2], results
    assert "turing" not in results[0][1]
    assert (tmp_path / "page.html").stat().st_size > 10_000
