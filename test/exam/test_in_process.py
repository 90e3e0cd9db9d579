"""A driving system that is a Python class: many episodes side by side, each as if it were alone, and those it loses."""

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags.episodes import read_bag_episodes
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam import run
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import Exam, prepare
from vpsci_ros.exam.result import FRAMES, EpisodeFile, read_result
from vpsci_ros.exam.run import is_done, run_with
from vpsci_ros.exam.view import read_exam
from vpsci_ros.extras.formats.exporters import open_exam
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.workers import ThisMachine

Write = Callable[[str], str]
Small = Callable[..., Exam]
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


def mine(act: str) -> str:
    """Return a class with this body of `act`."""
    begins = "  def reset(self, begin):\n    self.begin = begin\n"
    return f"class Mine:\n{begins}  def act(self, observation):\n    {act}\n"


def test_an_episode_comes_out_the_same_however_many_run_beside_it_and_as_a_bag(
    driven: Path, small_exam: Small, here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = list(EpisodeFile(driven / "runs" / "walker" / "1" / FRAMES).read())
    assert [episode.name for episode in whole] == ["1:0", "1:1", "104:0", "104:1"]
    assert not list(driven.rglob("*.mcap"))
    run_with(small_exam(bags=True), "walker", tmp_path / "alone")
    monkeypatch.setattr(run, "SIDE_BY_SIDE", 3)
    run_with(small_exam(), "walker", tmp_path / "three")
    alone, three = (read_result(tmp_path / name, "walker").episodes for name in ("alone", "three"))
    bag = tmp_path / "alone" / "runs" / "walker" / "1" / "bag"
    recorded = sorted(read_bag_episodes(bag), key=lambda episode: episode.key)
    for other in (alone, three, recorded):
        for one, same in zip(whole, other, strict=True):
            assert one.listed == same.listed
            assert np.array_equal(one.x, same.x)
            assert np.array_equal(one.ped_x, same.ped_x)


def test_it_leaves_what_an_exam_leaves_and_goes_on_without_driving_again(
    driven: Path, small_exam: Small, here: None, tmp_path: Path
) -> None:
    folder = tmp_path / "exam"
    shutil.copytree(driven, folder)
    before = {path: path.stat().st_mtime_ns for path in (folder / "runs").rglob("*")}
    assert len(run_exam(small_exam(), folder, ["time_lost < 100 @learned"], quiet=True)) == 1
    assert {path: path.stat().st_mtime_ns for path in (folder / "runs").rglob("*")} == before
    identity = json.loads((folder / "exam.json").read_text())
    assert identity["ads"] == EXAMPLE
    assert identity["ads_files_sha256"].keys() == {"example_driver.py"}
    assert f"Exam of {EXAMPLE}" in (folder / "report.html").read_text()
    assert {source.key for source in read_exam(folder, 9)} == {"ads-learned", "ads-walker"}
    source = open_exam(folder)
    names = ["1:0", "1:1", "104:0", "104:1"]
    assert [one.name for one in source.listed] == [f"{run}/{name}" for run in ("learned", "walker") for name in names]
    assert next(source.read(["walker/104:1"])).scenario is not None
    with pytest.raises(InvalidInput, match=r"holds an exam with parameters\.[a-z_.]+ = "):
        run_exam(small_exam(seed=7), folder, quiet=True)
    assert is_done(small_exam(), folder, "walker")
    (folder / "runs" / "walker" / "1" / FRAMES).write_bytes(b"")
    assert not is_done(small_exam(), folder, "walker"), "it is driven again"


def test_a_finished_run_is_known_by_what_it_is_and_by_the_hash_of_its_files(
    driven: Path, small_exam: Small, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(driven, tmp_path / "exam")
    one, other, aside = folder / "runs" / "walker", folder / "runs" / "learned", tmp_path / "aside"
    (one / "1" / FRAMES).rename(aside)
    (other / "1" / FRAMES).rename(one / "1" / FRAMES)
    aside.rename(other / "1" / FRAMES)
    assert not any(is_done(small_exam(), folder, name) for name in ("walker", "learned"))
    assert "frames.parquet changed since it was written; it is driven again" in capsys.readouterr().err
    shutil.rmtree(one)
    shutil.copytree(driven / "runs" / "learned", one)
    assert not is_done(small_exam(), folder, "walker")
    assert "the result of another run; it is driven again" in capsys.readouterr().err


def test_what_raises_loses_its_episode_and_no_other_and_the_report_says_where(
    tmp_path: Path, module: Write, small_exam: Small, here: None
) -> None:
    way = "if (self.begin.scenario.number, self.begin.episode) == (104, 1):"
    driver = module(mine(f"{way}\n      raise RuntimeError('no plan')\n    return 1.0"))
    failures = run_exam(small_exam(driver), tmp_path / "exam", quiet=True)
    first = "empty road: the ADS did not drive 104:1 to the end: at 0.00 s RuntimeError: no plan (log: "
    assert failures[0].startswith(first)
    table = pl.read_parquet(tmp_path / "exam" / "episodes.parquet")
    assert table["pedestrian"].value_counts().sort("pedestrian").rows() == [("alone", 3), ("learned", 3), ("walker", 3)]
    assert "raise RuntimeError('no plan')" in (tmp_path / "exam" / "logs" / "ads_walker-1.log").read_text()
    report = json.loads((tmp_path / "exam" / "report.json").read_text())
    assert report["conduct"]["walker"]["episodes_driven"] == 3


COUNTS = """class Mine:
  n = 0
  def reset(self, begin):
    {reset}
  def act(self, observation):
    return 1.0 if self.n < 2 else -1.0
"""


@pytest.mark.parametrize(("reset", "kept"), [("self.n += 1", True), ("self.n = 1", False)])
def test_a_class_that_keeps_state_is_named_and_its_episodes_are_the_same_with_bags(
    tmp_path: Path, module: Write, small_exam: Small, here: None, reset: str, kept: bool
) -> None:
    driver = module(COUNTS.format(reset=reset))
    for name, bags in (("exam", False), ("bags", True)):
        failures = run_exam(small_exam(driver, bags=bags), tmp_path / name, quiet=True)
        said = "the ADS keeps state from one episode to the next, or draws random numbers of its own: 1 of 2 episodes"
        assert [said in failure for failure in failures] == [True] * kept
    exam, bags = (pl.read_parquet(tmp_path / name / "episodes.parquet") for name in ("exam", "bags"))
    assert exam.equals(bags)


def test_a_class_that_never_drives_is_said_so_once_and_its_refused_answers_are_counted(
    tmp_path: Path, module: Write, small_exam: Small, here: None
) -> None:
    failures = run_exam(small_exam(module(mine("return None"))), tmp_path / "exam", quiet=True)
    assert len(failures) == 1
    assert "did not drive 1:0 and 3 more to the end: at 0.00 s act returned None" in failures[0]
    assert pl.read_parquet(tmp_path / "exam" / "episodes.parquet").height == 0
    report = json.loads((tmp_path / "exam" / "report.json").read_text())
    assert report["conduct"]["alone"]["commands_refused"] == 4


def test_other_forms_and_pairs_of_options_are_refused_before_anything_is_written() -> None:
    found = load(params_dir() / "ads_test.yaml")
    with pytest.raises(InvalidInput, match="--ads and --ads-class exclude each other"):
        prepare(found, "example_ads", EXAMPLE)
    with pytest.raises(InvalidInput, match="external_mode = real_time: a system that drives without ROS is called"):
        prepare(found.changed("world_simulator", {"external_mode": "real_time"}), ads_class=EXAMPLE)
    assert prepare(found.changed("ads_test", {"ads_class": EXAMPLE}), "external").config.examined == "external"
    with pytest.raises(InvalidInput, match="a system that you start yourself"):
        prepare(found, "external", workers=ThisMachine(2))


def test_a_class_whose_process_ends_has_failed_and_the_report_is_where_it_was_asked_for(
    tmp_path: Path, module: Write, small_exam: Small
) -> None:
    driver = module(mine("import os; os.chdir('/'); os._exit(0)"))
    failures = run_exam(small_exam(driver), Path("exam"), quiet=True)
    ended = "and 3 more to the end: at 0.00 s the ADS ended with exit status 0 (log: logs/ads_alone-1.log)"
    assert ended in failures[0]
    assert (tmp_path / "exam" / "report.html").is_file()


def test_the_class_of_the_page_arrives(
    tmp_path: Path, module: Write, capsys: pytest.CaptureFixture[str], small_exam: Small, here: None
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "ads.md").read_text(encoding="utf-8")
    (program,) = [text for text in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "def act" in text]
    text = module(program.replace("class MyDriver", "class Mine"))
    world: dict[str, Any] = {"scenarios": [1], "episodes": 2, "episode_time": 30.0}
    assert run_exam(small_exam(text, **world), tmp_path / "exam", quiet=True) == []
    unhurt = pl.read_parquet(tmp_path / "exam" / "episodes.parquet").filter(~pl.col("collision"))
    assert unhurt["arrived"].all(), "whoever has crossed walks on, out of its way"
    never_and_still = r"walker, does not react .* 0\.0% +0\.0% +[\d.]+ *\n"
    assert re.search(never_and_still, capsys.readouterr().out)
