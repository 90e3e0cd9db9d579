"""The bags that come with the package: small, critical, and what the shipped policies do and learn."""

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.scenario import scenario_files

FOLDER = Path(__file__).parents[2] / "bags"
NAMES = sorted([*(path.stem for path in scenario_files()), "closed_loop"])


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no bags/; tools/make_bags.py makes it")
@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_bag_shows_a_critical_interaction_by_the_shipped_policies(name: str) -> None:
    bag = FOLDER / name
    assert sum(path.stat().st_size for path in bag.iterdir()) <= 500_000  # as tools/make_bags.py has it
    info = bag_info(bag)
    (episode,) = info["episodes"]
    assert episode["least_curvttc"] < CRITICAL_TTC
    assert {"/markers", "/vehicle/odometry", "/pedestrian/odometry", "/safety/state", "/world/state"} <= {
        topic["name"] for topic in info["topics"] if topic["messages"]
    }, "the Foxglove layout shows these"
    assert info["missing"] == info["damage"] == []
    assert verify_bag(bag).difference == "", "make the bags again after the weights have changed"


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no bags/; tools/make_bags.py makes it")
def test_the_shipped_bag_of_stage_2_holds_transitions_without_gaps_and_policies_that_took_new_weights() -> None:
    numbers: list[int] = []
    versions = set()
    with AnyReader([FOLDER / "learning"]) as reader:
        for connection, _, data in reader.messages():
            if connection.topic in ("/replay", "/vehicle/action"):
                message = reader.deserialize(data, connection.msgtype)
                if connection.topic == "/replay":
                    numbers += range(message.first_number, message.first_number + len(message.scenario))
                else:
                    versions.add(message.policy_version)
    assert numbers == [*range(len(numbers))]
    assert len(numbers) > 50
    assert len(versions) >= 2
