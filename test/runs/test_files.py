"""Files appear whole or not at all, and outputs never mix with what is already there."""

import subprocess
import sys

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import require_empty_folder, written_whole


def test_a_failed_write_keeps_the_file_that_was_there(tmp_path) -> None:
    target = tmp_path / "x.txt"
    target.write_text("before")
    with pytest.raises(RuntimeError), written_whole(target) as path:
        path.write_text("half")
        raise RuntimeError
    assert target.read_text() == "before"


_KILLED = """
import os, signal, sys
from vpsci_ros.runs.files import written_whole
with written_whole(sys.argv[1]) as part:
    part.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_write_removes_what_a_killed_one_left_of_the_same_file_and_not_what_another_process_still_writes(
    tmp_path,
) -> None:
    target, other = tmp_path / "a[1].html", tmp_path / ".b.html.abcdefgh.part"
    assert subprocess.run([sys.executable, "-c", _KILLED, str(target)]).returncode == -9
    (left,) = tmp_path.iterdir()  # a part, and no file
    assert left.name.endswith(".part")
    other.write_text("half of another file")
    with written_whole(target) as first:
        assert set(tmp_path.iterdir()) == {first, other}
        with written_whole(target) as second:
            assert set(tmp_path.iterdir()) == {first, second, other}
            second.write_text("second")
        first.write_text("first")
    assert {path.name: path.read_text() for path in tmp_path.iterdir() if path != other} == {target.name: "first"}


def test_a_folder_that_holds_anything_is_refused(tmp_path) -> None:
    (tmp_path / "x").write_text("kept")
    with pytest.raises(InvalidInput, match="not empty"):
        require_empty_folder(tmp_path)
    with pytest.raises(InvalidInput, match="found a file"):
        require_empty_folder(tmp_path / "x")
    assert require_empty_folder(tmp_path / "new" / "deep").is_dir()
