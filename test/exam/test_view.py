"""An exam's episodes as the page plays them: the driving system from its bags, the autopilot simulated again."""

import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags.episodes import read_episodes
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import autopilot_met
from vpsci_ros.exam.config import ExamConfig
from vpsci_ros.exam.measures import COLUMNS, episode_table
from vpsci_ros.exam.run import prepare
from vpsci_ros.exam.view import exam_sources
from vpsci_ros.runs.sections import Sections


@pytest.fixture(scope="module")
def exam():
    world = {"scenarios": [1], "episodes": 3, "seed": 5}
    return prepare(Sections({"world_simulator": world, "ads_test": {"pedestrians": ["walker"]}}), "external")


def rows(found, driver):
    return episode_table(found, [], ExamConfig(), driver=driver, pedestrian="walker")


def test_the_driving_systems_episodes_come_from_its_bag_with_the_exams_verdicts(own_bag, exam, tmp_path: Path) -> None:
    shutil.copytree(own_bag, tmp_path / "runs/walker/bag")
    table = rows(list(read_episodes(own_bag)), "ads")
    (source,) = exam_sources(tmp_path, table, None, 1000, pytest.fail)
    assert source.key == "ads-walker"
    assert sorted(e.episode.name for e in source.episodes) == ["1:0", "1:2", "6:4"]
    by_name = {f"{row['scenario']}:{row['episode']}": row for row in table.to_dicts()}
    for episode in source.episodes:
        row = by_name[episode.episode.name]
        assert episode.yielded == row["yielded"]
        assert ("conflict" in episode.marks) == row["conflict"]
        assert ("evasion_success" in episode.marks) == (row["critical"] and not row["collision"])


def test_the_autopilots_episodes_are_those_of_the_exam(exam, tmp_path: Path) -> None:
    found = autopilot_met(exam, "walker").episodes
    (source,) = exam_sources(
        tmp_path, rows(found, "autopilot"), lambda name: autopilot_met(exam, name).episodes, 1000, pytest.fail
    )
    assert source.key == "autopilot-walker"
    shown = {each.episode.name: each.episode for each in source.episodes}
    for episode in found:
        np.testing.assert_array_equal(shown[episode.name].x, episode.x)


def test_episodes_that_end_otherwise_now_are_left_out_and_it_is_said(exam, tmp_path: Path) -> None:
    changed = rows(autopilot_met(exam, "walker").episodes, "autopilot").with_columns(outcome=pl.lit("none"))
    said: list[str] = []
    with pytest.raises(InvalidInput, match="not one episode"):
        exam_sources(tmp_path, changed, lambda name: autopilot_met(exam, name).episodes, 1000, said.append)
    assert "simulated again, its episodes end otherwise" in said[0]


def test_of_too_many_the_nearest_are_shown(exam, tmp_path: Path) -> None:
    table = rows(autopilot_met(exam, "walker").episodes, "autopilot")
    (source,) = exam_sources(tmp_path, table, lambda name: autopilot_met(exam, name).episodes, 2, pytest.fail)
    nearest = table.sort("least_curvttc", "scenario", "episode").head(2)
    assert {e.episode.name for e in source.episodes} == {f"1:{number}" for number in nearest["episode"]}
    assert source.total == 3


def test_an_exam_in_which_nobody_drove_is_refused(exam, tmp_path: Path) -> None:
    empty = pl.DataFrame(schema={name: column.dtype for name, column in COLUMNS.items()})
    with pytest.raises(InvalidInput, match="not one episode of this exam was driven"):
        exam_sources(tmp_path, empty, lambda name: autopilot_met(exam, name).episodes, 1000, pytest.fail)
