"""ScenarioNet's records: their content, and what their pickles may do."""

import pickletools

import numpy as np
import pytest

from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.extras.formats.movers import movers, road_of
from vpsci_ros.extras.formats.scenarionet import record
from vpsci_ros.view.episode_sources import read_episodes


@pytest.fixture(scope="module")
def episodes(own_bag):
    return list(read_episodes(own_bag))


def test_records_have_every_second_frame_of_our_motion_in_ten_hertz(episodes):
    for episode in episodes:
        found = record(episode)
        assert found["metadata"]["ts"] == pytest.approx(episode.time[::2])
        assert set(found["tracks"]) == {"ego", "pedestrian1"}
        for name, each in zip(("ego", "pedestrian1"), movers(episode), strict=True):
            state = found["tracks"][name]["state"]
            assert state["position"][:, :2] == pytest.approx(np.column_stack([each.x, each.y])[::2], abs=1e-5)
            assert np.sin(state["heading"]) == pytest.approx(np.sin(each.heading[::2]), abs=1e-6)
            assert all(len(column) == found["length"] for column in state.values())
        assert found["map_features"]["lane"]["polygon"].shape[1] == 2, "MetaDrive 0.4.3 takes no third coordinate"
        lane = road_of(episode).vehicle.path
        assert max(abs(lane.locate(*p)[1]) for p in found["map_features"]["lane"]["polyline"][:, :2]) < 0.01


def test_pickles_name_nothing_but_numpys_arrays(own_bag, tmp_path):
    export(own_bag, ["scenarionet"], tmp_path / "out")
    paths = sorted((tmp_path / "out/scenarionet").glob("*.pkl"))
    assert [path.name for path in paths][:2] == ["dataset_mapping.pkl", "dataset_summary.pkl"]
    for path in paths:
        left, memo, named = [], [], set()
        for operation, argument, _ in pickletools.genops(path.read_bytes()):
            assert operation.name not in ("GLOBAL", "INST", "EXT1", "EXT2", "EXT4")
            if operation.name == "STACK_GLOBAL":
                named.add(f"{left[-2]}.{left[-1]}")
            if operation.name == "MEMOIZE":
                memo.append(left[-1])
            elif operation.name != "FRAME":
                left.append(memo[argument] if "BINGET" in operation.name else argument)
        assert {name.rpartition(".")[2] for name in named} <= {
            "_reconstruct",
            "_frombuffer",
            "ndarray",
            "dtype",
            "scalar",
        }
        assert all(name.startswith("numpy") for name in named)
