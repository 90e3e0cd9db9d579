"""A graph with several pedestrians: what its bag holds is what the engine makes without nodes, to the bit."""

from pathlib import Path

import pytest
from bags.collected import collected
from composed import composed
from rosbags.highlevel import AnyReader

from vpsci_ros.bags.episodes import bag_episodes, read_bag_episodes
from vpsci_ros.bags.export import export_bag
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import NEXT_PEDESTRIAN
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.view.episode_sources import read_episodes

NODES = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder"]


POLICY = {"weights": "people", "seed": 11}
WORLD = {"scenarios": [1, 6], "episodes": 2, "batch": 1, "seed": 11, "pedestrians": 3}
CROWD = Sections(
    {
        "graph": {"nodes": NODES},
        "world_simulator": WORLD | {"crowd.sizes": [0.0, 1.0, 3.0], "kinds.older": 1.0},
        "vehicle_policy": POLICY,
        "pedestrian_policy": POLICY,
    }
)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of a graph of one slot; not to be changed."""
    folder = tmp_path_factory.mktemp("crowd")
    with own_domain(), composed(resolve(CROWD, folder)) as nodes:
        counts = nodes["world_simulator"].counts
    assert counts is not None
    assert counts.collision + counts.goal + counts.timeout == 4
    return folder / "bag"


def test_a_bag_of_several_pedestrians_is_simulated_again_to_the_bit(bag: Path) -> None:
    result = verify_bag(bag)
    assert (result.difference, result.uncompared, result.notes) == ("", (), ())
    assert result.episodes >= 4 * 2


def test_a_bag_tells_of_each_episode_once_and_of_every_pedestrian(bag: Path, tmp_path: Path) -> None:
    episodes = bag_episodes(Bag(bag))
    assert sorted(episode.listed.key for episode in episodes) == [(1, 0), (1, 1), (6, 0), (6, 1)]
    records = [block.records[0] for block in collected(bag)]
    people = {(int(each["scenario"]), int(each["count"])): int(each["pedestrians"]) for each in records}
    for episode in episodes:
        assert 2 <= people[episode.listed.key] <= 3
        (found,) = read_bag_episodes(bag, [episode])
        assert found.pedestrians == people[episode.listed.key]
        expected = 0.0 if episode.listed.outcome == "collision" else pytest.approx(found.least_curvttc)
        assert episode.listed.least_curvttc == expected
    several = sum(int(each["rows"]) for each in records)
    names = set()
    with AnyReader([bag]) as reader:
        wanted = [each for each in reader.connections if each.topic == "/pedestrians/odometry"]
        for connection, _, data in reader.messages(wanted):
            names.add(reader.deserialize(data, connection.msgtype).child_frame_id)
            several -= 1
    assert several == 0
    assert names == {f"pedestrian_{n}/base_link" for n in range(max(people.values()))}

    assert sorted(each.pedestrians for each in read_episodes(bag)) == sorted(people.values())
    export_bag(bag, tmp_path / "dataset", keep_rejected=True)
    data = Dataset(tmp_path / "dataset")
    for name in data.scenarios:
        rows = data.rows(name)
        assert (rows["ped_id"] % NEXT_PEDESTRIAN == 2 * rows["count"] + 1).all()
    assert data.index().height == 4
