"""A bag becomes a dataset with a summary, and says how it was made."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from vpsci_ros.bags import export
from vpsci_ros.bags.export import export_bag, provenance_of
from vpsci_ros.bags.reader import BagTick
from vpsci_ros.bags.run_record import NODE, node_record
from vpsci_ros.bags.writer import BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.summary import print_info
from vpsci_ros.world.state import COLLISION, GOAL


@pytest.fixture
def bag(tmp_path: Path, simulate, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run's folder whose bag reads as three episodes of scenario 1 (reading real ones is tested with the bags)."""
    run = tmp_path / "run"
    BagWriter(run / "bag", []).close({})
    ticks = [BagTick(k, 0.05, *tick) for k, tick in enumerate(simulate([150, 60, 120], [GOAL, COLLISION, GOAL], 2))]
    monkeypatch.setattr(export, "read_bag", lambda *_, **__: iter(ticks))
    return run / "bag"


def test_an_exported_bag_is_a_dataset_that_a_summary_reads(bag: Path, tmp_path: Path) -> None:
    text = io.StringIO()
    description = export_bag(bag, tmp_path / "dataset")
    print_info(tmp_path / "dataset", Console(width=80, file=text))
    assert {path.name for path in (tmp_path / "dataset").iterdir()} == {
        "LocationA_PedCross_S-N.parquet",
        "dataset.json",
        "episodes.parquet",
    }
    assert description["scenarios"]["LocationA_PedCross_S-N"]["kept"] == 2
    assert description["period"] == 0.05
    assert "A S-N" in text.getvalue()
    (row,) = (line.split() for line in text.getvalue().splitlines() if "too short" in line)
    assert row == ["too", "short", "1", "1"]


def test_the_configuration_and_the_seed_of_a_run_are_taken_from_its_bag(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", [])
    writer.describe(NODE, node_record("world_simulator", {"seed": 7, "batch": 2}))
    writer.describe(NODE, node_record("vehicle_policy", {"weights": "w"}, "abc"))
    writer.close({})
    found = provenance_of(tmp_path / "bag")
    assert found["configuration"] == {"world_simulator": {"seed": 7, "batch": 2}, "vehicle_policy": {"weights": "w"}}
    assert (found["seed"], found["weights"]) == (7, {"vehicle_policy": "abc"})


def test_a_bag_in_which_nothing_ended_leaves_nothing_behind(
    bag: Path, tmp_path: Path, simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = [BagTick(k, 0.05, *tick) for k, tick in enumerate(simulate([50], [GOAL], 1))][:20]
    monkeypatch.setattr(export, "read_bag", lambda *_, **__: iter(ticks))
    with pytest.raises(InvalidInput, match="not one of its 1 episodes ended"):
        export_bag(bag, tmp_path / "dataset", console=Console(file=io.StringIO()))
    assert list((tmp_path / "dataset").iterdir()) == []
