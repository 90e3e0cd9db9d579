"""A whole search: failures found, driven again, listed, and the same command goes on with it."""

import json
import re
from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.episode_list import with_episode_list
from vpsci_ros.exam.run import prepare
from vpsci_ros.exam.search import plan
from vpsci_ros.exam.search.run import run_search
from vpsci_ros.resources import params_dir

pytestmark = pytest.mark.usefixtures("forked_nodes")
CARELESS = """
class Careless:
    def reset(self, begin):
        pass

    def act(self, observation):
        return 2.0 * (5.0 - observation.vehicle.speed)
"""


def test_a_search_finds_failures_lists_them_and_has_them_driven_again_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(plan, "ROUNDS", 1)
    (tmp_path / "careless.py").write_text(CARELESS)
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "search"
    found = load(params_dir() / "ads_test.yaml")
    found = found.changed("world_simulator", {"scenarios": [1], "episode_time": 6.0})
    search = {"search.pedestrian": "walker", "search.pool": 100, "search.budget": 40, "search.shown": 3}
    exam = prepare(found.changed("ads_test", search | {"baseline": False}), ads_class="careless:Careless")

    assert run_search(exam, folder, quiet=True) == []

    report = json.loads((folder / "report.json").read_text())
    assert (report["driven"], report["pool"]) == (40, 100)
    table = pl.read_parquet(folder / "episodes.parquet")
    assert table.height == 40
    assert table.select("scenario", "episode").is_unique().all()
    hits = table.filter("moving_collision")
    assert hits.height == report["failures"] > 3
    assert report["count"]["failures_low"] >= hits.height
    assert report["again"] == {"driven": 3, "failed": 3, "same": 3}
    listed = [entry["episode"] for entry in json.loads((folder / "failures.json").read_text())["episodes"]]
    assert sorted(listed) == sorted(hits["episode"].to_list())
    assert set(prepare(with_episode_list(found, folder / "failures.json")).episodes) == {(1, n) for n in listed}
    page = (folder / "report.html").read_text()
    assert re.findall('"failures/view.html#a=ads-walker&amp;episode=1:([0-9]+)">', page) == [str(n) for n in listed[:3]]
    assert (folder / "failures" / "view.html").is_file()

    before = capfd.readouterr().out
    records = {path: path.stat().st_mtime_ns for path in folder.rglob("run.json")}
    assert run_search(exam, folder, quiet=True) == []
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("run.json")} == records, "nothing is driven again"
    assert capfd.readouterr().out == before
