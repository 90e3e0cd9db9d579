"""Output folders belong to one command at a time and say what failed."""

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pyarrow as pa
import pytest
import typer
from safetensors import SafetensorError
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput, VpsciError, in_words
from vpsci_ros.runs import output_folder as output_folders
from vpsci_ros.runs.files import FAILURE, require_empty_folder
from vpsci_ros.runs.output_folder import FolderLock, output_folder


def commands(group: Any, *names: str) -> Iterator[tuple[str, ...]]:
    """Yield words that call each command whose --output is a folder, required arguments filled in with anything."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, *names, name)
        for option in command.params:
            if option.name == "output" and "older" in option.help:
                required = [other for other in command.params if other.required and other is not option]
                words = [word for other in required for word in (*(o for o in other.opts if o[0] == "-"), "1")]
                yield (*names, name, *words)


def begin(folder: Path) -> None:
    """Stand in for what a command does first in a folder that it has claimed, and end it there."""
    raise AssertionError(f"{folder}: the command has begun")


@pytest.mark.timeout(100)  # commands that would begin by another way might train or serve for hours
@pytest.mark.parametrize("words", list(commands(typer.main.get_command(app))), ids=" ".join)
def test_every_command_refuses_a_folder_that_another_process_writes(
    words, claimed_by_another, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output_folders, "is_empty_folder", begin)
    monkeypatch.setattr("vpsci_ros.nodes.graph.require_empty_folder", begin)
    with claimed_by_another(tmp_path):
        result = CliRunner().invoke(app, [*words, "-o", str(tmp_path)])
    assert isinstance(result.exception, InvalidInput)
    assert f"{tmp_path}: another process is writing into this folder" in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_moved_away_ends_the_command_with_that_reason(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(VpsciError, match="out: this folder was deleted or moved"), output_folder(out):
        (out / "half").touch()
        out.rename(tmp_path / "moved")
    assert not out.exists()


def test_a_process_may_lock_its_folder_again_and_keeps_it_until_its_first_lock_ends(tmp_path: Path) -> None:
    def elsewhere() -> int:
        code = "import sys; from vpsci_ros.runs.output_folder import FolderLock; FolderLock(sys.argv[1])"
        return subprocess.run([sys.executable, "-c", code, tmp_path], stderr=subprocess.DEVNULL, check=False).returncode

    with output_folder(tmp_path):
        FolderLock(tmp_path / "." / ".." / tmp_path.name).close()
        assert elsewhere() != 0
    assert elsewhere() == 0


def test_what_a_failed_command_left_says_so_until_the_command_succeeds(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(OSError, match="no room"), output_folder(out):
        (out / "half.csv").write_text("a,")
        raise OSError(errno.ENOSPC, "no room", "half.csv")
    assert sorted(path.name for path in out.iterdir()) == [FAILURE, "half.csv"]
    assert read_json(out / FAILURE)["error"].startswith("half.csv: No space left on device; free some space")
    with output_folder(out):
        pass
    assert [path.name for path in out.iterdir()] == ["half.csv"]


def test_a_command_that_succeeds_or_fails_leaves_what_another_wrote_into_its_folder(tmp_path: Path) -> None:
    others = [tmp_path / name for name in (FAILURE, ".thesis.part", "deep/.report.html.vpsci.part")]
    (tmp_path / "deep").mkdir()
    for other in others:
        other.write_text('{"error": "of another program"}')
    with output_folder(tmp_path):
        pass
    with pytest.raises(VpsciError), output_folder(tmp_path):
        raise VpsciError("no room")
    assert {other.read_text() for other in others} == {'{"error": "of another program"}'}
    with pytest.raises(InvalidInput, match="not empty"):
        require_empty_folder(tmp_path)


def test_a_refused_command_leaves_no_folder_and_nothing_in_somebody_elses(tmp_path: Path) -> None:
    for out in (tmp_path / "new", tmp_path):
        with pytest.raises(InvalidInput), output_folder(out):
            require_empty_folder(out)
            (out / "mine").touch()
            (out / "mine").unlink()
            raise InvalidInput("no such table")
        (tmp_path / "notes.txt").touch()
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OSError(errno.EROFS, "", "a.png"), "a.png: Read-only file system; choose another place"),
        (pl.exceptions.ComputeError("write: No space left on device (os error 28)"), "No space left on device; free"),
        (SafetensorError('IoError(Os { code: 27, kind: FileTooLarge, message: "" })'), "File too large; allow larger"),
        (MemoryError(), "not enough memory; free some memory"),
        (ImportError("libarrow.so: failed to map segment from shared object"), "not enough memory; free some memory"),
        (RuntimeError("can't start new thread"), "no further thread; allow more processes (ulimit -u)"),
        (pa.ArrowException(f"Failed to launch worker thread: {os.strerror(errno.EAGAIN)}"), "no further thread; allow"),
        (RuntimeError("a defect"), ""),
    ],
)
def test_what_the_system_refuses_is_said_in_words_and_a_defect_is_not(error: Exception, text: str) -> None:
    assert in_words(error).startswith(text)
    assert bool(in_words(error)) == bool(text)
