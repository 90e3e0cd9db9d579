"""Near-miss tables, datasets, bags and exams are read into the same episodes, any of them without the rest."""

import json
import shutil
from collections.abc import Collection
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags import episodes as bags
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import scenarios_of
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Key
from vpsci_ros.data.episode_block import concat_blocks, ended_blocks
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.result import FRAMES, write_episodes
from vpsci_ros.extras.formats.exporters import open_exam
from vpsci_ros.view.episode_sources import open_source, read_episodes


def write_run(path: Path, bag: Path, without: Collection[Key] = ()) -> None:
    """Write a bag's episodes as a run of an exam has them, but those of the keys `without`."""
    roads = scenarios_of(Bag(bag))
    block = concat_blocks(list(ended_blocks(read_bag(bag), roads))).without(without)
    write_episodes(path, block, 0.05, roads)


@pytest.fixture
def exam(own_bag: Path, tmp_path: Path) -> Path:
    (tmp_path / "exam.json").write_text(json.dumps({}))
    for name in ("alone", "learned", "walker"):
        (tmp_path / "runs" / name / "1").mkdir(parents=True)
        write_run(tmp_path / "runs" / name / "1" / FRAMES, own_bag)
    return tmp_path


def test_an_interaction_has_the_numbers_of_its_table(table_file: Path, near_misses: pl.DataFrame) -> None:
    found = list(read_episodes(table_file))
    assert [episode.listed for episode in found] == open_source(table_file).listed
    rows = near_misses.filter(pl.col("interaction") == int(found[3].name))
    for ours, theirs in {"x": "veh_x", "heading": "veh_heading", "speed": "veh_speed"}.items():
        np.testing.assert_array_equal(getattr(found[3], ours), rows[theirs])
    for ours in ("ped_x", "ped_vy", "curvttc", "distance"):
        np.testing.assert_array_equal(getattr(found[3], ours), rows[ours].to_numpy()[None])
    assert (found[3].outcome, found[3].scenario, found[3].period) == ("recorded", None, 0.1)


def test_a_datasets_kept_episodes_come_with_their_numbers_outcomes_and_values(dataset: Path) -> None:
    found = list(read_episodes(dataset))
    kept = Dataset(dataset).index().filter(pl.col("reason") == "kept")
    assert [one.key for one in found] == kept.select("scenario", "count").rows()
    assert [one.outcome for one in found] == kept["outcome"].to_list()
    assert [one.least_curvttc for one in found] == kept["least_curvttc"].to_list()
    rows = Dataset(dataset).rows(found[0].group).filter(pl.col("count") == found[0].number)
    for ours, theirs in {"x": "position_x_av", "vx": "velocity_x_av", "vy": "velocity_y_av"}.items():
        np.testing.assert_array_equal(getattr(found[0], ours).astype(np.float32), rows[theirs])
    np.testing.assert_array_equal(found[0].curvttc[0], rows["CurvTTC"])
    assert found[0].time[-1] == pytest.approx(0.05 * (rows.height - 1))
    assert found[0].scenario is not None
    assert found[0].scenario.name == found[0].group


def test_a_bags_episodes_have_the_poses_of_its_states(own_bag: Path) -> None:
    found = {one.label: one for one in read_episodes(own_bag)}
    assert list(found) == [
        "LocationA_PedCross_S-N_000000", "LocationB_PedCross_N-S_000004", "LocationA_PedCross_S-N_000002"
    ]  # fmt: skip
    one = found["LocationB_PedCross_N-S_000004"]
    mine = [tick.state[0] for tick in read_bag(own_bag) if tick.state["scenario"][0] == 6]
    for ours, theirs in {"x": "vehicle_x", "speed": "vehicle_speed", "curvature": "vehicle_curvature"}.items():
        assert getattr(one, ours).tolist() == [float(state[theirs]) for state in mine]
    assert np.abs(one.heading - [state["vehicle_heading"] for state in mine]).max() < 1e-9
    assert one.ped_y[0].tolist() == [float(state["pedestrian_y"]) for state in mine]


def test_an_exams_episodes_are_named_by_pedestrian_in_each_part_and_those_without_one_are_left_out(
    exam: Path, own_bag: Path
) -> None:
    (exam / "runs" / "learned" / "2").mkdir()
    write_run(exam / "runs" / "learned" / "1" / FRAMES, own_bag, without=[(1, 2), (6, 4)])
    write_run(exam / "runs" / "learned" / "2" / FRAMES, own_bag, without=[(1, 0)])
    shutil.copytree(exam / "runs" / "learned" / "2", exam / "runs" / "learned" / "2 (copy)")
    names = [one.name for one in open_exam(exam).read()]
    assert names == [f"{run}/{name}" for run in ("learned", "walker") for name in ("1:0", "1:2", "6:4")]
    assert [one.label for one in open_exam(exam).read(["walker/6:4"])] == ["walker_LocationB_PedCross_N-S_000004"]


@pytest.mark.parametrize("wanted", [["6:4"], ["4"], ["LocationB_PedCross_N-S_000004"]])
def test_episodes_are_meant_by_name_number_or_label_and_the_rest_is_not_read(
    wanted: list[str], own_bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = open_source(own_bag)
    taken = []
    ticks = bags.episode_ticks
    monkeypatch.setattr(bags, "episode_ticks", lambda *a, **k: (taken.append(tick) or tick for tick in ticks(*a, **k)))
    assert [one.name for one in source.read(wanted)] == ["6:4"]
    assert len(taken) < sum(1 for _ in read_bag(own_bag)) / 2


def test_an_episode_that_is_not_there_is_named_with_what_there_is(dataset: Path, own_bag: Path) -> None:
    with pytest.raises(InvalidInput, match=r"no episode 9:9; it has 1:0, "):
        list(read_episodes(dataset, ["9:9"]))
    with pytest.raises(InvalidInput, match=r"no episode 77, 78; it has 1:0, 6:4, 1:2"):
        list(read_episodes(own_bag, ["4", "78", "77"]))


def test_of_more_than_the_limit_evenly_spread_episodes_are_read(table_file: Path) -> None:
    assert [one.name for one in read_episodes(table_file, limit=4)] == ["0", "5", "10", "15"]


def test_what_is_no_source_is_refused_with_what_was_expected(tmp_path: Path, near_misses: pl.DataFrame) -> None:
    (tmp_path / "notes.txt").write_text("no table")
    near_misses.drop("curvttc").write_parquet(tmp_path / "short.parquet")
    for path, message in {
        tmp_path / "absent": "no such file or folder; expected a near-miss table",
        tmp_path / "notes.txt": "expected a near-miss table in Parquet, not readable",
        tmp_path / "short.parquet": "needs column curvttc",
        tmp_path: r"neither dataset\.json nor a bag in it",
    }.items():
        with pytest.raises(InvalidInput, match=message):
            read_episodes(path)
