"""Exams of several systems on the same episodes: their table, their order, and where it is not sure."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from class_in_process import class_in_process
from typer.testing import CliRunner

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.measures import COLUMNS
from vpsci_ros.extras.exam_extra.ads_commands import compare_app
from vpsci_ros.extras.exam_extra.side_by_side import Finished, compare_exams, compared, holm
from vpsci_ros.resources import params_dir

DRIVERS = """
class Fast:
    speed = 8.0
    def reset(self, begin): pass
    def act(self, observation): return 2.0 * (self.speed - observation.vehicle.speed)

class Slow(Fast):
    speed = 4.0

class Stands(Fast):
    speed = 0.0
"""


def examined(driver: str, folder: Path, **world: object) -> Path:
    """Examine a class of `DRIVERS` on two episodes with the walker, and return the folder."""
    short = {"scenarios": [1], "episodes": 2, "episode_time": 12.0} | world
    chosen = {"pedestrians": ["walker"], "baseline": False, "allow_standing": True}
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", short).changed("ads_test", chosen)
    run_exam(prepare(sections, ads_class=f"drivers_side_by_side:{driver}"), folder, quiet=True)
    return folder


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of three exams of the same two episodes, and of one of other episodes."""
    folder = tmp_path_factory.mktemp("three")
    (folder / "drivers_side_by_side.py").write_text(DRIVERS)
    with pytest.MonkeyPatch.context() as patch, class_in_process():
        patch.chdir(folder)
        patch.setattr(sys, "path", [str(folder), *sys.path])
        for driver in ("Fast", "Slow", "Stands"):
            examined(driver, folder / driver)
        examined("Slow", folder / "other", seed=2)
        yield folder


def test_three_exams_are_one_page_with_the_numbers_of_each(three: Path, tmp_path: Path) -> None:
    page, numbers = tmp_path / "page.html", tmp_path / "numbers.json"
    arguments = [*(str(three / name) for name in ("Fast", "Slow", "Stands")), "-o", str(page), "--json", str(numbers)]
    said = CliRunner().invoke(compare_app, arguments)
    assert said.exit_code == 0, said.output
    found = json.loads(numbers.read_text())
    walker = found["pedestrians"]["walker"]
    for system in walker["systems"]:
        own = json.loads((Path(system["exam"]) / "report.json").read_text())["drivers"]["ads"]["walker"]
        assert system["measures"]["arrived_rate"] == own["arrived_rate"]
        assert system["measures"]["collision_rate"] == own["collision_rate"]
    assert walker["systems"][0]["exam"].endswith("Stands")
    assert [system["rank"] for system in walker["systems"]] == [[1, 3]] * 3, "two episodes decide nothing"
    assert len(walker["pairs"]) == 3
    text = page.read_text()
    assert all(f"drivers_side_by_side:{name}" in text for name in ("Fast", "Slow", "Stands"))
    assert text.count("not sure") == 3
    assert "1 to 3" in text


def test_exams_of_other_episodes_are_refused_with_the_parameter_that_differs(three: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    with pytest.raises(InvalidInput, match=r"other: is an exam with world_simulator.seed = 2, and .*Fast has 1; exams"):
        compare_exams([three / "Fast", three / "other"], page)
    with pytest.raises(InvalidInput, match="expected two exams or more, each named once"):
        compare_exams([three / "Fast", three / "Fast"], page)
    with pytest.raises(InvalidInput, match="no exam that is over"):
        compare_exams([three / "Fast", three], page)
    assert not page.exists()


def finished(name: str, fails: list[bool]) -> Finished:
    """Return an exam in which a system drives so many episodes with the walker and fails in some."""
    n = len(fails)
    values = {column: [None] * n for column in COLUMNS} | {
        "driver": ["ads"] * n, "pedestrian": ["walker"] * n, "scenario": [1] * n, "episode": list(range(n)),
        "moving_collision": fails, "collision": fails, "conflict": fails, "severe_conflict": fails,
        "hard_braking": fails, "arrived": fails, "least_curvttc": [1.0] * n, "time_lost": [np.nan] * n,
    }  # fmt: skip
    schema = {column: each.dtype for column, each in COLUMNS.items()}
    return Finished(name, name, "moving_collision", pl.DataFrame(values, schema=schema))


def test_systems_have_an_order_where_their_difference_shows_and_share_a_rank_where_it_does_not() -> None:
    exams = [finished("bad", [True] * 30), finished("good", [False] * 30), finished("also", [True] + [False] * 29)]
    walker = compared(exams)["pedestrians"]["walker"]
    assert [(each["exam"], each["rank"]) for each in walker["systems"]] == [
        ("good", [1, 2]), ("also", [1, 2]), ("bad", [3, 3])]  # fmt: skip
    assert [(each["better"], each["worse"], each["sure"]) for each in walker["pairs"]] == [
        ("good", "also", False), ("good", "bad", True), ("also", "bad", True)]  # fmt: skip
    assert walker["pairs"][1]["differences"]["moving_collision_rate"]["value"] == 1.0


def test_p_values_are_corrected_for_their_number_by_holms_method() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
