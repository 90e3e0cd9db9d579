"""A whole search: failures found and listed."""

import json
from pathlib import Path

import polars as pl
import pytest
from class_in_process import CARELESS, class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.exam import prepare
from vpsci_ros.extras.exam_extra.search import plan
from vpsci_ros.extras.exam_extra.search.search_exam import run_search
from vpsci_ros.extras.exam_extra.search.seek import SearchConfig
from vpsci_ros.resources import params_dir


def test_a_search_finds_failures_and_lists_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "ROUNDS", 1)
    (tmp_path / "careless.py").write_text(CARELESS)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "search"
    found = load(params_dir() / "ads_test.yaml").changed(
        "world_simulator", {"scenarios": [1], "episode_time": 3.0, "spawn": "paper"}
    )
    found = found.changed("ads_test", {"baseline": False, "failure": "conflict"})
    search = SearchConfig("walker", 60, 40)
    with class_in_process():
        exam = prepare(found, ads_class="careless:Careless")
        assert run_search(exam, search, folder, quiet=True) == []

    report = json.loads((folder / "report.json").read_text())
    assert (report["driven"], report["pool"]) == (40, 60)
    table = pl.read_parquet(folder / "episodes.parquet")
    assert table.height == 40
    assert table.select("scenario", "episode").is_unique().all()
    failed = table.filter("conflict")
    assert report["count"]["failures_low"] >= failed.height == len(report["failures"])
    again = load(params_dir() / "ads_test.yaml", [report["again"]] if report["failures"] else [])
    if report["failures"]:
        assert set(prepare(again).episodes) == {(1, number) for number in failed["episode"]}
    assert "vpsci ads-test --set" in (folder / "report.html").read_text() or not report["failures"]
