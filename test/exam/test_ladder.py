"""The order of known drivers in an exam, where physics leaves no choice."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import polars as pl
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def ladder(monkeypatch: pytest.MonkeyPatch, here: None) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    sys.modules.pop("ladder", None)
    return importlib.import_module("ladder")


def test_closed_eyes_hit_more_than_braking_the_faster_the_harder_and_standing_does_not_arrive(
    ladder: ModuleType, tmp_path: Path
) -> None:
    """With walkers that do not react, in 16 episodes each."""
    found = {name: ladder.driven(tmp_path, name, "own", 2, ["walker"])
             for name in ("Blind3", "FullThrottle", "Brakes", "Late20", "Stands")}  # fmt: skip
    hits = {name: table.filter(pl.col("pedestrian") == "walker", "moving_collision") for name, table in found.items()}
    counts = {name: rows.height for name, rows in hits.items()}
    assert counts["Brakes"] < counts["Late20"] <= counts["FullThrottle"]
    assert counts["Brakes"] < counts["Blind3"]
    assert counts["Stands"] == 0
    assert hits["Blind3"]["impact_speed"].max() < 3.1 < hits["FullThrottle"]["impact_speed"].min()
    arrived = {name: table.filter(pedestrian="alone")["arrived"].all() for name, table in found.items()}
    assert [name for name, there in arrived.items() if not there] == ["Stands"]
