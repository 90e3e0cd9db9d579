"""A whole search: failures found, listed, and the same command goes on with it."""

import json
from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.episode_list import with_episode_list
from vpsci_ros.exam.prepare import prepare
from vpsci_ros.extras.exam_extra.search import plan
from vpsci_ros.extras.exam_extra.search.run import run_search
from vpsci_ros.extras.exam_extra.search.seek import SearchConfig
from vpsci_ros.resources import params_dir

CARELESS = """
class Careless:
    def reset(self, begin):
        pass

    def act(self, observation):
        return 2.0 * (5.0 - observation.vehicle.speed)
"""


def test_a_search_finds_failures_and_lists_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(plan, "ROUNDS", 1)
    (tmp_path / "careless.py").write_text(CARELESS)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "search"
    found = load(params_dir() / "ads_test.yaml")
    found = found.changed("world_simulator", {"scenarios": [1], "episode_time": 6.0})
    search = SearchConfig("walker", 100, 40)
    exam = prepare(found.changed("ads_test", {"baseline": False}), ads_class="careless:Careless")

    assert run_search(exam, search, folder, quiet=True) == []

    report = json.loads((folder / "report.json").read_text())
    assert (report["driven"], report["pool"]) == (40, 100)
    table = pl.read_parquet(folder / "episodes.parquet")
    assert table.height == 40
    assert table.select("scenario", "episode").is_unique().all()
    hits = table.filter("moving_collision")
    assert hits.height == report["failures"] > 3
    assert report["count"]["failures_low"] >= hits.height
    listed = [entry["episode"] for entry in json.loads((folder / "failures.json").read_text())["episodes"]]
    assert sorted(listed) == sorted(hits["episode"].to_list())
    assert set(prepare(with_episode_list(found, folder / "failures.json")).episodes) == {(1, n) for n in listed}
    assert "vpsci ads-test --episodes failures.json" in (folder / "report.html").read_text()

    before = capfd.readouterr().out
    records = {path: path.stat().st_mtime_ns for path in folder.rglob("run.json")}
    assert run_search(exam, search, folder, quiet=True) == []
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("run.json")} == records, "nothing is driven again"
    assert capfd.readouterr().out == before
