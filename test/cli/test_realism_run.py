"""A study of realism keeps what it has measured only for as long as everything that it read is the same."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from vpsci_ros.cli import realism_run as realism
from vpsci_ros.cli.realism_run import run_realism
from vpsci_ros.policy.weights import save_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import sha256


def test_parts_are_kept_for_the_very_weights_and_dataset_that_were_read(
    dataset: Path, near_misses_file: Path, networks: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[dict[str, str]] = []

    def stopped(*_: object, inputs: dict[str, str], **__: object) -> None:
        seen.append(inputs)
        raise KeyboardInterrupt

    own, generated = tmp_path / "own.safetensors", tmp_path / "dataset"
    shutil.copytree(dataset, generated)
    shutil.copy(weights_path("ma_sst_ddpg"), own)
    monkeypatch.setattr(realism, "measure_realism", stopped)
    options: dict[str, Any] = {"data": near_misses_file, "library": None, "weights": [str(own)], "dataset": generated}
    options |= {"held_out": False, "clean": False, "seed": 0, "episodes": 4, "json_path": None, "quiet": True}
    for changed in (None, own, generated / "dataset.json"):
        if changed is not None and changed.suffix == ".json":
            changed.write_text(changed.read_text() + "\n")
        elif changed is not None:
            save_weights(changed, networks(seed=len(seen)).weights({}, {}))
        with pytest.raises(KeyboardInterrupt):
            run_realism(**options, output=tmp_path / "out")
        if changed is not None:
            before, now = seen[-2:]
            assert {name for name in now if now[name] != before[name]} == {str(changed)}
            assert now[str(changed)] == sha256(changed)
