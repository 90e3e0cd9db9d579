"""A damaged bag is never taken for a whole one: whatever byte has changed, `bag info` says so or gives an error."""

import shutil
import struct
from pathlib import Path
from types import SimpleNamespace

import pytest
from bags.rule_based import bag_of_the_rule_based_pair
from mcap.reader import make_reader
from mcap.writer import CompressionType

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.layout import WORLD
from vpsci_ros.wire.world_state import read_world_state

STATES = 3 * (11 + 1)  # of three episodes of half a second: its frames, and one tick without an episode


@pytest.fixture
def moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bag without compression in which a position has one bit changed: all of it can be read as if it were whole."""
    monkeypatch.setattr("vpsci_ros.bags.writer.CompressionType", SimpleNamespace(ZSTD=CompressionType.NONE))
    bag = bag_of_the_rule_based_pair(tmp_path / "bag", 0.5)
    states = list(Bag(bag).messages([WORLD]))
    assert len(states) == STATES
    sent, (path,) = states[5].data, bag.glob("*.mcap")
    place = sent.index(read_world_state(sent).tick.state["vehicle_x"].tobytes())
    data = bytearray(path.read_bytes())
    data[data.index(sent) + place] ^= 1
    path.write_bytes(data)
    return bag


def test_a_changed_bit_of_a_position_is_noticed_by_the_checksum_of_the_data(moved: Path) -> None:
    with pytest.raises(InvalidInput, match="its data do not agree with their checksum"):
        Bag(moved).topics()


def test_a_changed_bit_of_a_position_is_noticed_by_the_checksum_of_its_chunk(moved: Path) -> None:
    recovered = Bag(moved, recover=True)
    assert len(list(recovered.messages([WORLD]))) < STATES
    assert "the chunk after message 0 is damaged" in recovered.damage[0]
    (path,) = moved.glob("*.mcap")
    data = bytearray(path.read_bytes())
    (index,) = struct.unpack("<Q", data[-28:-20])
    data[index - 4 : index] = bytes(4)  # no checksum of the data, as other recorders write it
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match="a chunk or its index is damaged .*crc"):
        list(Bag(moved).messages([WORLD]))


def test_a_changed_name_of_a_topic_is_noticed_by_the_checksum_of_the_index(short_bag: Path, tmp_path: Path) -> None:
    bag = shutil.copytree(short_bag, tmp_path / "bag")
    (path,) = bag.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[data.rindex(WORLD.encode()) + 1] ^= 1
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match="its index is damaged"):
        Bag(bag).topics()


def test_of_a_bag_of_one_episode_a_damaged_byte_costs_one_chunk_and_repair_keeps_the_rest(
    own_bag: Path, tmp_path: Path
) -> None:
    bag = shutil.copytree(own_bag, tmp_path / "bag")
    (path,) = bag.glob("*.mcap")
    messages = bag_info(bag)["messages"]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(data)
    kept = sum(repair_bag(bag).messages.values())
    assert messages > kept > 0.8 * messages
    assert bag_info(bag)["damage"] == []
