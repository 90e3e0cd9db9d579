"""A driving system that is a Python class: many episodes side by side, each as if it were alone, and those it loses."""

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags.episodes import read_episodes
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.kept import read_kept
from vpsci_ros.episodes import open_source
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam import in_process
from vpsci_ros.exam.prepare import prepare
from vpsci_ros.exam.run import read_exam, run_exam
from vpsci_ros.resources import params_dir

Write = Callable[[str], str]
EXAMPLE = "vpsci_ros.nodes.example_driver:ExampleDriver"


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Write]:
    """Write a module with a class `Mine` into the working directory and return what --ads-class takes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    name = re.sub(r"\W", "_", f"driver_of_{request.node.name}")

    def write(text: str) -> str:
        (tmp_path / f"{name}.py").write_text(text)
        return f"{name}:Mine"

    yield write
    sys.modules.pop(name, None)


def mine(act: str, reset: str = "self.begin = begin") -> str:
    """Return a class with these bodies."""
    return f"class Mine:\n  def reset(self, begin):\n    {reset}\n  def act(self, observation):\n    {act}\n"


def examined(folder: Path, ads_class: str, *criteria: str, **world: Any) -> tuple[list[str], pl.DataFrame]:
    """Put a class to a short exam of six episodes; return why it fails, and the table of its episodes."""
    exam = {"pedestrians": ["learned", "walker"], "baseline": False, "bags": world.pop("bags", False)}
    short = {"scenarios": [1, 104], "episodes": 3, "episode_time": 6.0} | world
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", short).changed("ads_test", exam)
    failures = run_exam(prepare(chosen, ads_class=ads_class), folder, criteria, quiet=True)
    return failures, pl.read_parquet(folder / "episodes.parquet")


def test_an_episode_comes_out_the_same_however_many_run_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures, together = examined(tmp_path / "together", EXAMPLE, "ticks_unanswered > 0")
    monkeypatch.setattr(in_process, "SIDE_BY_SIDE", 2)
    _, by_two = examined(tmp_path / "by_two", EXAMPLE)
    assert failures == []
    assert together.height == 18
    assert by_two.equals(together)
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_bag_is_made_where_one_is_asked_for_and_holds_the_same_episodes(tmp_path: Path) -> None:
    _, table = examined(tmp_path / "exam", EXAMPLE, bags=True, scenarios=[1], episodes=2)
    run = tmp_path / "exam" / "runs" / "walker"
    kept, recorded = read_kept(run / "episodes.npz"), list(read_episodes(run / "bag"))
    assert [episode.name for episode in recorded] == [episode.name for episode in kept] == ["1:0", "1:1"]
    for one, other in zip(kept, recorded, strict=True):
        assert np.array_equal(one.x, other.x)
        assert np.array_equal(one.ped_x, other.ped_x)
    assert table.filter(pl.col("pedestrian") == "walker")["duration"].to_list() == [each.time[-1] for each in kept]


def test_it_leaves_what_an_exam_leaves_and_goes_on_without_driving_again(tmp_path: Path) -> None:
    examined(tmp_path / "exam", EXAMPLE)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "exam" / "runs").rglob("*")}
    failures, _ = examined(tmp_path / "exam", EXAMPLE, "time_lost < 100 @learned")
    assert len(failures) == 1
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "exam" / "runs").rglob("*")} == before
    identity = json.loads((tmp_path / "exam" / "exam.json").read_text())
    assert identity["ads"] == EXAMPLE
    assert identity["ads_files_sha256"].keys() == {"example_driver.py"}
    assert f"Exam of {EXAMPLE}" in (tmp_path / "exam" / "report.html").read_text()
    assert {source.key for source in read_exam(tmp_path / "exam", 9)} == {"ads-learned", "ads-walker"}
    source = open_source(tmp_path / "exam")
    names = ["1:0", "1:1", "1:2", "104:0", "104:1", "104:2"]
    assert [one.name for one in source.listed] == [f"{run}/{name}" for run in ("learned", "walker") for name in names]
    assert next(source.read(["walker/104:1"])).scenario is not None
    kept = tmp_path / "exam" / "runs" / "walker" / "episodes.npz"
    kept.write_bytes(b"")
    with pytest.raises(InvalidInput, match=r"walker/episodes.npz: not readable as the episodes of a run"):
        examined(tmp_path / "exam", EXAMPLE)


def test_what_raises_loses_its_episode_and_no_other_and_the_report_says_where(tmp_path: Path, module: Write) -> None:
    way = "if (self.begin.scenario.number, self.begin.episode) == (104, 1):"
    driver = module(mine(f"{way}\n      raise RuntimeError('no plan')\n    return 1.0"))
    failures, table = examined(tmp_path / "exam", driver)
    first = "nobody there: the ADS did not drive 104:1 to the end: at 0.00 s RuntimeError: no plan (log: "
    assert failures[0].startswith(first)
    assert table["pedestrian"].value_counts().sort("pedestrian").rows() == [("alone", 5), ("learned", 5), ("walker", 5)]
    assert "raise RuntimeError('no plan')" in (tmp_path / "exam" / "logs" / "ads_walker.log").read_text()
    report = json.loads((tmp_path / "exam" / "report.json").read_text())
    assert report["conduct"]["walker"]["episodes_driven"] == 5


def test_a_class_that_never_drives_is_said_so_once_and_its_refused_answers_are_counted(
    tmp_path: Path, module: Write
) -> None:
    failures, table = examined(tmp_path / "exam", module(mine("return None")))
    assert len(failures) == 1
    assert "did not drive 1:0 and 5 more to the end: at 0.00 s act returned None" in failures[0]
    assert table.height == 0
    report = json.loads((tmp_path / "exam" / "report.json").read_text())
    assert report["conduct"]["alone"]["commands_refused"] == 6


def test_other_forms_and_pairs_of_options_are_refused_before_anything_is_written() -> None:
    found = load(params_dir() / "ads_test.yaml")
    with pytest.raises(InvalidInput, match="--ads and --ads-class exclude each other"):
        prepare(found, "example_ads", EXAMPLE)
    with pytest.raises(InvalidInput, match="external_mode = real_time: a system that drives without ROS is called"):
        prepare(found.changed("world_simulator", {"external_mode": "real_time"}), ads_class=EXAMPLE)
    assert prepare(found.changed("ads_test", {"ads_class": EXAMPLE}), "external").config.examined == "external"


def test_a_class_whose_process_ends_has_failed_and_the_report_is_where_it_was_asked_for(
    tmp_path: Path, module: Write
) -> None:
    text = mine("if self.begin.episode: import os; os._exit(0)\n    return 1.0", "self.begin = begin; os.chdir('/')")
    failures, table = examined(Path("exam"), module("import os\n" + text))
    ended = "and 5 more to the end: at 0.05 s the ADS ended with exit status 0 (log: exam/logs/ads_alone.log)"
    assert ended in failures[0]
    assert (tmp_path / "exam" / "report.html").is_file()
    assert table.height == 0


def test_the_class_of_the_page_arrives(tmp_path: Path, module: Write, capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[2] / "docs" / "ads.md").read_text(encoding="utf-8")
    programs = [text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "def act" in text]
    assert len(programs) == 1
    text = module(programs[0].replace("class MyDriver", "class Mine"))
    failures, table = examined(tmp_path / "exam", text, scenarios=[1], episodes=2, episode_time=30.0)
    assert failures == []
    unhurt = table.filter(~pl.col("collision"))
    assert unhurt.height >= 5
    assert unhurt["arrived"].all(), "whoever has crossed walks on, out of its way"
    never_and_still = r"walker, does not react .* 0\.0% +0\.0% +[\d.]+ *\n"
    assert re.search(never_and_still, capsys.readouterr().out)
