"""A bag becomes a dataset with a summary and a picture, and says how it was made."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from vpsci_ros.bags import export
from vpsci_ros.bags.export import export_bag, provenance_of
from vpsci_ros.bags.tick import RecordedTick
from vpsci_ros.bags.writer import BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import sha256
from vpsci_ros.world.state import COLLISION, GOAL


@pytest.fixture
def bag(tmp_path: Path, simulate, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run's folder whose bag reads as three episodes of scenario 1 (reading real ones is tested with the bags)."""
    run = tmp_path / "run"
    BagWriter(run / "bag", []).close({})
    ticks = [
        RecordedTick(k, 0.05, *tick) for k, tick in enumerate(simulate([150, 60, 120], [GOAL, COLLISION, GOAL], 2))
    ]
    monkeypatch.setattr(export, "read_bag", lambda *_, **__: iter(ticks))
    return run / "bag"


def test_an_exported_bag_is_a_dataset_with_table_and_picture(bag: Path, tmp_path: Path) -> None:
    text = io.StringIO()
    description = export_bag(bag, tmp_path / "dataset", console=Console(width=80, file=text))
    assert {path.name for path in (tmp_path / "dataset").iterdir()} == {
        "LocationA_PedCross_S-N.csv",
        "LocationA_PedCross_S-N.parquet",
        "dataset.json",
        "episodes.parquet",
        "trajectories.png",
    }
    assert description["scenarios"]["LocationA_PedCross_S-N"]["kept"] == 2
    assert description["period"] == 0.05
    assert "A S-N" in text.getvalue()
    (row,) = (line.split() for line in text.getvalue().splitlines() if "too short" in line)
    assert row == ["too", "short", "1", "1"]


def test_the_configuration_seed_and_weights_of_the_run_are_kept(bag: Path) -> None:
    run = bag.parent
    (run / "params.yaml").write_text("world_simulator:\n  ros__parameters: {seed: 7, batch: 2}\n")
    (run / "run.json").write_text(json.dumps({"weights_sha256": {"w.safetensors": "abc"}}))
    found = provenance_of(bag)
    assert found["configuration"] == {"world_simulator": {"seed": 7, "batch": 2}}
    assert (found["seed"], found["weights"]) == (7, {"w.safetensors": "abc"})
    assert found["bag"] == {"bag_0.mcap": sha256(bag / "bag_0.mcap")}


def test_a_bag_alone_has_no_configuration(bag: Path) -> None:
    assert provenance_of(bag)["configuration"] is None


def test_a_damaged_record_of_the_run_is_named(bag: Path) -> None:
    (bag.parent / "params.yaml").write_text("- 1\n")
    with pytest.raises(InvalidInput, match=r"run: params\.yaml or run\.json is not as a run writes it"):
        provenance_of(bag)


def test_a_bag_in_which_nothing_ended_leaves_nothing_behind(
    bag: Path, tmp_path: Path, simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = [RecordedTick(k, 0.05, *tick) for k, tick in enumerate(simulate([50], [GOAL], 1))][:20]
    monkeypatch.setattr(export, "read_bag", lambda *_, **__: iter(ticks))
    with pytest.raises(InvalidInput, match="not one of its 1 episodes ended"):
        export_bag(bag, tmp_path / "dataset", console=Console(file=io.StringIO()))
    assert list((tmp_path / "dataset").iterdir()) == []
