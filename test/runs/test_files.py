"""Files appear whole or not at all, and outputs never mix with what is already there."""

import os
import resource
import socket
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.data.parquet import Column, read_metadata, read_parquet, write_parquet
from vpsci_ros.errors import InvalidInput, in_words
from vpsci_ros.runs.files import atomic_write, require_empty_folder, sha256, write_text


def test_of_two_writes_of_one_file_at_once_the_last_one_stays_whole_and_nothing_beside_it(tmp_path) -> None:
    target = tmp_path / "a[1].html"
    with atomic_write(target) as first:
        with atomic_write(target) as second:
            second.write_text("second")
        first.write_text("first")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {target.name: "first"}


def test_the_next_write_takes_over_what_a_killed_process_left_and_touches_nothing_else(tmp_path) -> None:
    code = """
import os, signal, sys
from vpsci_ros.runs.files import atomic_write
with atomic_write(sys.argv[1]) as part:
    part.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    target, others = tmp_path / "a.csv", [tmp_path / ".thesis.part", tmp_path / ".b.csv.vpsci.part"]
    for other in others:
        other.write_text("of another")
    subprocess.run([sys.executable, "-c", code, target], check=False, timeout=60)
    assert (tmp_path / ".a.csv.vpsci.part").read_text() == "half"
    write_text(target, "whole")
    assert sorted(tmp_path.iterdir()) == sorted([target, *others])
    assert target.read_text() == "whole"
    assert {other.read_text() for other in others} == {"of another"}


def test_a_library_that_opens_paths_in_utf8_alone_reads_and_writes_any(tmp_path) -> None:
    folder = tmp_path / os.fsdecode(b"\xff")
    folder.mkdir()
    table = pl.DataFrame({"a": [1.5]})
    write_parquet(table, folder / "t.parquet", {"a": Column(pl.Float64, "m", "")}, said=str(folder))
    assert read_parquet(folder / "t.parquet", "a table").equals(table)
    assert read_metadata(folder / "t.parquet")["said"] == str(folder)
    write_text(folder / "t.html", f"of {folder}")
    assert (folder / "t.html").read_text() == f"of {tmp_path}/\\udcff"
    assert sorted(path.name for path in folder.iterdir()) == ["t.html", "t.parquet"]


def test_what_is_no_file_is_never_replaced_by_one(tmp_path) -> None:
    pipe, server, link, regular = (tmp_path / name for name in ("pipe", "socket", "link", "file"))
    os.mkfifo(pipe)
    link.symlink_to(os.devnull)
    regular.write_text("before")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(server))
        for path in (pipe, server, link):
            before = path.lstat()
            with pytest.raises(InvalidInput, match="found a pipe, a device or a socket, which a file would replace"):
                write_text(path, "after")
            assert (path.lstat().st_ino, path.lstat().st_mode) == (before.st_ino, before.st_mode)
    standard_output = tmp_path / "stdout"
    with open(regular) as opened:
        standard_output.symlink_to(f"/proc/self/fd/{opened.fileno()}")  # as /dev/stdout is one, sent to a file
        with pytest.raises(InvalidInput, match="found an open file of a process"):
            write_text(standard_output, "after")
    assert standard_output.is_symlink()
    assert regular.read_text() == "before"
    assert not [*tmp_path.glob(".*")]
    write_text(regular, "after")
    assert regular.read_text() == "after"


def test_a_path_with_a_nul_is_refused_by_its_text() -> None:
    with pytest.raises(InvalidInput, match=r"'map\\x00.xodr': expected the path of a file"):
        sha256("map\0.xodr")


def test_a_folder_that_holds_anything_is_refused(tmp_path) -> None:
    (tmp_path / "x").write_text("kept")
    with pytest.raises(InvalidInput, match="not empty"):
        require_empty_folder(tmp_path)
    with pytest.raises(InvalidInput, match="found a file"):
        require_empty_folder(tmp_path / "x")
    assert require_empty_folder(tmp_path / "new" / "deep").is_dir()


def test_a_folder_that_holds_anything_that_the_command_does_not_write_is_refused_by_its_name(tmp_path) -> None:
    for name in ("report.html", "figure_1.png", ".report.html.vpsci.part"):
        (tmp_path / name).touch()
    require_empty_folder(tmp_path, "report.html", "figure_*.png")
    (tmp_path / "failed.json").write_text("{}")
    with pytest.raises(InvalidInput, match=r"not empty: it holds failed.json; choose another one or empty it first"):
        require_empty_folder(tmp_path, "report.html", "figure_*.png")


def test_an_error_of_the_disk_names_the_file_that_could_not_be_written(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            write_text(tmp_path / "run.json", "x" * 100)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert in_words(caught.value).startswith(f"{tmp_path / 'run.json'}: File too large")
    assert list(tmp_path.iterdir()) == []
