"""Bags read back without ROS, whole or broken off, and completed by repair."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import COLLISION, EPISODE, GOAL

LENGTHS, OUTCOMES = [30, 12, 40, 25], [GOAL, COLLISION, GOAL, GOAL]
FIELDS = ("scenario", "episode", "frame", "status", "outcome", "vehicle_x", "vehicle_heading", "pedestrian_vy")


@pytest.fixture(scope="module")
def ticks(simulate) -> list:
    return list(simulate(LENGTHS, OUTCOMES, 2))


def mcap_file(bag: Path) -> Path:
    (path,) = bag.glob("*.mcap")
    return path


def test_every_tick_comes_back_to_the_bit(ticks, write_bag, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", ticks)
    back = list(read_bag(bag))
    assert [tick.number for tick in back] == list(range(len(ticks)))
    for tick, (state, curvttc, distance) in zip(back, ticks, strict=True):
        assert tick.state.dtype == EPISODE
        assert tick.period == 0.05
        np.testing.assert_array_equal(tick.curvttc, curvttc)
        np.testing.assert_array_equal(tick.distance, distance)
        for name in FIELDS:
            np.testing.assert_array_equal(tick.state[name], state[name])


def test_a_tick_without_an_answer_has_an_unknown_curvttc(ticks, write_bag, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", ticks, unanswered=(3, len(ticks) - 1))
    back = list(read_bag(bag))
    assert [tick.number for tick in back] == list(range(len(ticks)))
    assert [tick.number for tick in back if np.isnan(tick.curvttc).all()] == [3, len(ticks) - 1]


def test_a_damaged_text_record_costs_no_message(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", [BagTopic("/a", "std_msgs/msg/String", "string data\n", "RIHS01_0")])
    bag.describe("note", {"text": "here it is"})
    for i in range(5):
        bag.write("/a", b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00", i, i)
    bag.close({})
    path = mcap_file(tmp_path / "bag")
    data = bytearray(path.read_bytes())
    data[data.index(b"here it is")] = 0xFF  # no longer UTF-8
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match="do not agree with their checksum"):
        list(McapFile(path, strict=True).messages())
    assert len(list(McapFile(path, strict=False).messages())) == 5
    assert repair_bag(tmp_path / "bag").messages == {"/a": 5}


def test_a_bag_with_nothing_in_it_is_named(write_bag, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [])
    with pytest.raises(InvalidInput, match="holds no message of /world/state"):
        list(read_bag(bag))
    with pytest.raises(InvalidInput, match="nothing to recover"):
        repair_bag(bag)
    mcap_file(bag).write_bytes(b"")
    with pytest.raises(InvalidInput, match="nothing to recover"):
        repair_bag(bag)
