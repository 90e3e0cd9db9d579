"""Segments of shared memory are removed where their owner is dead, and nowhere else."""

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from vpsci_ros.nodes import graph
from vpsci_ros.nodes.shared_memory import remove_left_behind

HOLD = (
    "import fcntl, sys, time; f = open(sys.argv[1]); fcntl.flock(f, fcntl.LOCK_EX); print(flush=True); time.sleep(60)"
)


def segment(folder: Path, name: str) -> Path:
    (folder / name).write_bytes(bytes(100))
    (folder / f"{name}_el").touch()
    return folder / f"{name}_el"


def test_only_segments_that_nobody_holds_are_removed(tmp_path: Path) -> None:
    alive = segment(tmp_path, "fastrtps_0123456789abcdef")
    segment(tmp_path, "fastrtps_fedcba9876543210")
    segment(tmp_path, "fastrtps_port7411")
    (tmp_path / "somebody_elses").touch()
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(alive)], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        assert remove_left_behind(tmp_path) == ["fastrtps_fedcba9876543210"]
    finally:
        holder.kill()
        holder.communicate()
    left = sorted(path.name.removeprefix("fastrtps_") for path in tmp_path.iterdir())
    assert left == ["0123456789abcdef", "0123456789abcdef_el", "port7411", "port7411_el", "somebody_elses"]
    assert remove_left_behind(tmp_path) == ["fastrtps_0123456789abcdef"]
    assert remove_left_behind(tmp_path / "nowhere") == []


def test_a_graph_that_ends_frees_what_its_killed_nodes_have_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graph, "remove_left_behind", partial(remove_left_behind, tmp_path))
    segment(tmp_path, "fastrtps_fedcba9876543210")
    assert graph.NodeProcesses(["world_simulator"], tmp_path / "params.yaml", tmp_path).stop() == {}
    assert list(tmp_path.iterdir()) == []
