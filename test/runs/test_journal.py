"""Of resumable work, what is whole counts; what is torn, or of other work, is known and said."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.runs.journal import OUTPUTS, claim, finished, read_item, write_item, write_item_record

WORK = {"seed": 3, "episodes": [[1, 0], [1, 1]]}


def test_a_file_is_read_by_the_work_and_name_that_it_was_written_for_and_in_no_other_state(tmp_path: Path) -> None:
    path = tmp_path / "1"
    assert read_item(path, b"run 1") is None
    write_item(path, b"run 1", b"bytes")
    assert read_item(path, b"run 1") == b"bytes"
    assert read_item(path, b"run ") is None
    assert read_item(path, b"run 1b") is None, "the work does not run over into the bytes"
    whole = path.read_bytes()
    flipped = [whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :] for at in range(len(whole))]
    for damaged in [whole[:at] for at in range(len(whole))] + [whole + b"0", *flipped]:
        path.write_bytes(damaged)
        assert read_item(path, b"run 1") is None


@pytest.fixture
def item(tmp_path: Path) -> Path:
    folder = tmp_path / "item"
    (folder / "sub").mkdir(parents=True)
    (folder / "one").write_bytes(b"1")
    (folder / "sub" / "two").write_bytes(b"2")
    write_item_record(folder / "record.json", WORK)
    return folder / "record.json"


def test_a_folder_is_finished_with_the_hashes_of_all_its_files(item: Path, tmp_path: Path) -> None:
    record = finished(item, WORK)
    assert record == json.loads(item.read_text())
    assert record[OUTPUTS].keys() == {"one", "sub/two"}
    assert finished(item, {"seed": 3}) == record
    moved = shutil.copytree(item.parent, tmp_path / "elsewhere")
    assert finished(moved / item.name, WORK) == record


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("one", b"", "one changed since it was written"),
        ("sub/two", None, "sub/two changed since it was written"),
        ("record.json", b'{"seed": 3', "not readable as JSON"),
        ("record.json", b'{"seed": 3}', "outputs_sha256"),
        ("record.json", b"[]", ""),
        ("record.json", b'{"seed": 3, "outputs_sha256": {}}', "the result of another run"),
    ],
)
def test_a_folder_that_is_torn_or_of_other_work_is_not_finished_and_said_so(
    file: str, content: bytes | None, said: str, item: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = item.parent / file
    path.unlink() if content is None else path.write_bytes(content)
    assert finished(item, WORK, "it is made again") is None
    error = capsys.readouterr().err
    assert error.startswith(f"note: {item.parent}")
    assert said in error
    assert error.endswith("; it is made again\n")


def test_a_folder_without_a_record_is_unfinished_without_a_word(item: Path, capsys: pytest.CaptureFixture[str]) -> None:
    item.unlink()
    assert finished(item, WORK, "it is made again") is None
    assert capsys.readouterr().err == ""


def test_a_new_folder_is_of_the_work_that_claims_it_and_of_no_other(tmp_path: Path) -> None:
    path = tmp_path / "work" / "of.json"
    claim(path, WORK)
    claim(path, WORK)
    with pytest.raises(InvalidInput, match="work: holds an exam with seed = 3, and this one has 4"):
        claim(path, WORK | {"seed": 4}, "holds an exam")
    path.write_text("[]")
    with pytest.raises(InvalidInput, match=r"of\.json: not what this command writes; choose another output folder"):
        claim(path, WORK)
    path.unlink()
    (path.parent / "cat.jpg").touch()
    with pytest.raises(InvalidInput, match="the output folder is not empty"):
        claim(path, WORK)


def test_a_checkpoint_with_a_changed_bit_is_refused_and_a_whole_one_is_what_was_saved(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.safetensors"
    save_checkpoint(path, {"networks": {"a": np.arange(1000.0)}, "episode": 3, 5: (1, None, "text")})
    tree = load_checkpoint(path)
    assert tree["networks"]["a"].tolist() == list(range(1000))
    assert (tree["episode"], tree[5]) == (3, [1, None, "text"])
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 1
    path.write_bytes(whole)
    with pytest.raises(InvalidInput, match="damaged, or no checkpoint of this version; delete it to start again"):
        load_checkpoint(path)
