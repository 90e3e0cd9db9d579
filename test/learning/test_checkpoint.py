"""Checkpoints are read as they were written, and written into no other file than the one that is swept up."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from vpsci_ros.learning import checkpoint
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path) -> None:
    tree = {"networks": {"a": torch.arange(3.0)}, "optimisers": [{0: np.eye(2)}], "episode": 7, "log": [{"loss": 0.5}]}
    save_checkpoint(tmp_path / "c.safetensors", tree)
    found = load_checkpoint(tmp_path / "c.safetensors")
    assert torch.equal(found["networks"]["a"], tree["networks"]["a"])
    assert np.array_equal(found["optimisers"][0][0], np.eye(2))
    assert (found["episode"], found["log"]) == (7, [{"loss": 0.5}])


def test_no_file_but_the_temporary_one_that_is_swept_up_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A library that writes a file of its own first, and renames it, changes which file the name stands for."""
    numbers: list[int] = []
    written_whole = checkpoint.written_whole

    @contextlib.contextmanager
    def watched(path: Path) -> Iterator[Path]:
        with written_whole(path) as temporary:
            numbers.append(temporary.stat().st_ino)
            yield temporary
            numbers.append(temporary.stat().st_ino)

    monkeypatch.setattr(checkpoint, "written_whole", watched)
    save_checkpoint(tmp_path / "c.safetensors", {"a": np.zeros(4)})
    assert len(set(numbers)) == 1
