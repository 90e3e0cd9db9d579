"""Episodes read from datasets, bags and exams for export."""

import json

import numpy as np
import pytest

from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.export.episode import motion
from vpsci_ros.export.sources import read_episodes


def test_a_datasets_kept_episodes_come_with_their_numbers_outcomes_and_values(dataset):
    episodes = list(read_episodes(dataset))
    index = Dataset(dataset).index()
    kept = index.filter(index["reason"] == "kept")
    assert [episode.number for episode in episodes] == kept["count"].to_list()
    assert [episode.outcome for episode in episodes] == kept["outcome"].to_list()
    (first,) = Dataset(dataset).episodes(episodes[0].scenario.name)
    assert np.array_equal(episodes[0].vehicle.x.astype(np.float32), first["position_x_av"][0])
    assert np.array_equal(episodes[0].curvttc.astype(np.float32), first["CurvTTC"][0])
    assert episodes[0].time[-1] == pytest.approx(0.05 * (first.lengths[0] - 1))


def test_a_bags_episodes_have_the_poses_of_its_states_and_their_own_headings(own_bag):
    episodes = {episode.name: episode for episode in read_episodes(own_bag)}
    assert list(episodes) == [
        "LocationA_PedCross_S-N_000000", "LocationB_PedCross_N-S_000004", "LocationA_PedCross_S-N_000002"
    ]  # fmt: skip
    states = [tick.state[0] for tick in read_bag(own_bag)]
    mine = [state for state in states if (state["scenario"], state["episode"]) == (6, 4)]
    found = episodes["LocationB_PedCross_N-S_000004"]
    assert found.vehicle.x.tolist() == [state["vehicle_x"] for state in mine]
    assert found.pedestrians[0].y.tolist() == [state["pedestrian_y"] for state in mine]
    assert np.abs(found.vehicle.heading - [state["vehicle_heading"] for state in mine]).max() < 1e-9
    assert found.vehicle.speed == pytest.approx([state["vehicle_speed"] for state in mine])


def test_an_exams_episodes_are_named_by_pedestrian_and_those_without_one_are_left_out(own_bag, tmp_path):
    (tmp_path / "exam.json").write_text(json.dumps({}))
    for name in ("alone", "learned", "walker"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "bag").symlink_to(own_bag)
    names = [episode.name for episode in read_episodes(tmp_path)]
    assert len(names) == len(set(names)) == 6
    assert {name.partition("_")[0] for name in names} == {"learned", "walker"}


def test_a_folder_that_is_no_source_is_refused_by_what_it_lacks(tmp_path):
    with pytest.raises(InvalidInput, match="expected the folder of a dataset .dataset.json., of an exam .* or a bag"):
        list(read_episodes(tmp_path))


def test_who_stands_keeps_the_heading_it_had_or_has_the_first_one_that_comes():
    vx, vy = np.array([0.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 2.0])
    found = motion(np.stack([np.zeros(4), np.zeros(4), vx, vy]), "test")
    assert found.heading == pytest.approx([np.pi, np.pi, np.pi, np.pi / 2])


def test_a_road_user_without_a_heading_or_a_position_is_refused():
    with pytest.raises(InvalidInput, match="vehicle of X: never moves, so its heading is unknown"):
        motion(np.zeros((4, 3)), "vehicle of X")
    with pytest.raises(InvalidInput, match="a position or velocity is missing"):
        motion(np.array([[0.0, np.nan, 0.0], [0.0] * 3, [0.0] * 3, [1.0] * 3]), "vehicle of X")
