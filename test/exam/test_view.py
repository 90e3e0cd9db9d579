"""An exam's episodes as the page plays them: the driving system's and the autopilot's."""

from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.bags.episodes import read_bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import scenarios_of
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import BASELINE, prepare
from vpsci_ros.exam.measures import COLUMNS, episode_table
from vpsci_ros.exam.result import FRAMES, RunResult, block_of_ticks, write_episodes
from vpsci_ros.exam.run import autopilot_run
from vpsci_ros.exam.view import exam_sources, read_exam
from vpsci_ros.runs.run_config import Sections


@pytest.fixture(scope="module")
def exam():
    world = {"scenarios": [1], "episodes": 3, "seed": 5}
    return prepare(Sections({"world_simulator": world, "ads_test": {"pedestrians": ["walker"]}}), "external")


@pytest.fixture(scope="module")
def autopilot(exam):
    return autopilot_run(exam, "walker").episodes


def rows(found, driver):
    return episode_table(RunResult(found), [], driver=driver, pedestrian="walker")


def sources(table, autopilot, limit=1000):
    return exam_sources(table, {BASELINE: {"walker": autopilot}}, limit)


def test_an_exam_that_is_over_is_shown_with_its_verdicts(own_bag, exam, autopilot, tmp_path: Path) -> None:
    driven = list(read_bag_episodes(own_bag))
    (tmp_path / "runs" / "walker" / "1").mkdir(parents=True)
    roads = scenarios_of(Bag(own_bag))
    write_episodes(
        tmp_path / "runs" / "walker" / "1" / FRAMES, block_of_ticks(read_bag(own_bag), roads), exam.world.tick, roads
    )
    table = rows(driven, "ads")
    table = pl.concat([table, rows(autopilot, "autopilot")])
    write_parquet(table, tmp_path / "episodes.parquet", COLUMNS, content="episodes of an exam")
    (tmp_path / "autopilot").mkdir()
    autopilot_run(exam, "walker", tmp_path / "autopilot" / "walker.parquet")
    source, beside = read_exam(tmp_path, 1000)
    assert (source.key, beside.key) == ("ads-walker", "autopilot-walker")
    assert [each.episode.name for each in beside.episodes] == [each.name for each in autopilot]
    assert sorted(e.episode.name for e in source.episodes) == ["1:0", "1:2", "6:4"]
    by_name = {f"{row['scenario']}:{row['episode']}": row for row in table.filter(driver="ads").to_dicts()}
    for episode in source.episodes:
        row = by_name[episode.episode.name]
        assert episode.yielded == row["yielded"]
        assert ("conflict" in episode.marks) == row["conflict"]
        assert ("evasion_success" in episode.marks) == (row["critical"] and not row["collision"])


def test_of_too_many_the_nearest_are_shown(autopilot) -> None:
    table = rows(autopilot, "autopilot")
    (source,) = sources(table, autopilot, limit=2)
    nearest = table.sort("least_curvttc", "scenario", "episode").head(2)
    assert {e.episode.name for e in source.episodes} == {f"1:{number}" for number in nearest["episode"]}
    assert source.total == 3


def test_an_exam_in_which_nobody_drove_is_refused(tmp_path: Path) -> None:
    empty = pl.DataFrame(schema={name: column.dtype for name, column in COLUMNS.items()})
    write_parquet(empty, tmp_path / "episodes.parquet", COLUMNS, content="episodes of an exam")
    with pytest.raises(InvalidInput, match="not one episode of this exam was driven"):
        read_exam(tmp_path, 1000)
