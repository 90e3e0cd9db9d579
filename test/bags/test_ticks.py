"""Bags read back without ROS, whole or broken off, and completed by repair."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.layout import SAFETY, WORLD

TICK = 50_000_000  # [ns]
STRING = BagTopic("/a", "std_msgs/msg/String", "string data\n", "RIHS01_0")


def mcap_file(bag: Path) -> Path:
    (path,) = bag.glob("*.mcap")
    return path


def test_a_tick_without_an_answer_has_an_unknown_curvttc(short_bag: Path, tmp_path: Path) -> None:
    messages = [raw for raw in Bag(short_bag).messages([WORLD, SAFETY]) if (raw.topic, raw.time) != (SAFETY, 3 * TICK)]
    topics = {raw.topic: BagTopic(raw.topic, raw.type, raw.definition, "RIHS01_0") for raw in messages}
    bag = BagWriter(tmp_path / "bag", [*topics.values()])
    for raw in messages:
        bag.write(raw.topic, raw.data, raw.time, 0)
    bag.close({})
    back, whole = list(read_bag(tmp_path / "bag")), list(read_bag(short_bag))
    assert [tick.number for tick in back] == list(range(len(whole)))
    assert [tick.number for tick in back if np.isnan(tick.curvttc).all()] == [3]


def test_a_damaged_text_record_costs_no_message(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", [STRING])
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


def test_a_bag_with_nothing_in_it_is_named(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    BagWriter(bag, [STRING]).close({})
    with pytest.raises(InvalidInput, match="holds no message of /world/state"):
        list(read_bag(bag))
    with pytest.raises(InvalidInput, match="nothing to recover"):
        repair_bag(bag)
    mcap_file(bag).write_bytes(b"")
    with pytest.raises(InvalidInput, match="nothing to recover"):
        repair_bag(bag)
