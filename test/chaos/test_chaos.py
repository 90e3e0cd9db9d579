"""Damaged files, files made to harm, and writes that fail: read as they were, whole, or refused in words."""

import io
from pathlib import Path

import pytest
from chaos import bombs, files, writes
from mcap.writer import Writer
from rich.console import Console

from vpsci_ros.bags.info import bag_info, print_info
from vpsci_ros.errors import InvalidInput

CASES = 12
CORPUS = sorted(path for path in files.CORPUS.rglob("*") if path.is_file())


@pytest.mark.parametrize("kind", files.KINDS)
def test_a_damaged_file_is_read_as_it_was_or_refused_in_words(kind: str) -> None:
    found: list[files.Found] = []
    files.campaign(kind, range(CASES), found.append)
    assert [case for case in found if case.defect] == []
    assert {"read", "refused"} & {case.verdict for case in found}, "nothing was damaged"


@pytest.mark.parametrize("path", CORPUS, ids=[f"{path.parent.name}/{path.name}" for path in CORPUS])
def test_what_a_campaign_once_found_holds(path: Path, tmp_path: Path) -> None:
    target = files.KINDS[path.parent.name].make(tmp_path)
    whole = target.read_bytes()
    assert files.verdict_of(path.parent.name, path.read_bytes(), whole, target) in ("read", "refused")


@pytest.mark.parametrize("name", bombs.BOMBS)
def test_a_file_that_is_made_to_harm_is_refused_in_words_at_once(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for budget, value in bombs.SMALL.items():
        monkeypatch.setattr(budget, value)
    read = bombs.BOMBS[name](tmp_path)
    with files.time_limit(5), pytest.raises(InvalidInput):
        read()


@pytest.mark.parametrize("compression", ["LZ4", "ZSTD"])
def test_of_a_bag_with_a_bomb_in_it_the_rest_is_recovered(
    compression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vpsci_ros.bags.mcap_file.LARGEST_CHUNK", 2**20)
    assert bombs.packed(bombs.CompressionType[compression], True, tmp_path)() == []


def test_a_topic_whose_name_a_terminal_obeys_is_printed_escaped(tmp_path: Path) -> None:
    with (tmp_path / "bag_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        writer.add_message(writer.register_channel("/\x1b[2J\x9bm", "cdr", schema), 1, b"\x00\x01\x00\x00", 1)
        writer.finish()
    text = io.StringIO()
    print_info(bag_info(tmp_path), Console(file=text, width=200))
    assert "/\\x1b[2J\\x9bm" in text.getvalue()
    assert not {"\x1b", "\x9b"} & set(text.getvalue())


@pytest.mark.parametrize("name", writes.WRITERS)
@pytest.mark.parametrize("before", [None, b"what was there before"])
def test_what_is_written_on_a_disk_that_fills_at_any_byte_is_whole_or_not_there(
    name: str, before: bytes | None, tmp_path: Path
) -> None:
    path, write = tmp_path / "out" / "file", writes.WRITERS[name]
    path.parent.mkdir()
    write(path)
    whole = path.read_bytes()
    failed = 0
    for size in [*range(0, len(whole), max(1, len(whole) // 8)), len(whole) - 1, len(whole)]:
        path.unlink() if before is None else path.write_bytes(before)
        succeeded = writes.attempt(write, path, size)
        failed += not succeeded
        assert writes.defects(path, before, whole, succeeded) == [], f"full after {size} bytes"
        path.touch()
    assert failed > 3
