"""Bags of any ROS 2 tool: MCAP, one file or several, whole or in part, with definitions or without."""

import subprocess
import sys
from pathlib import Path

import mcap.writer
import numpy as np
import pytest
from mcap.writer import IndexType
from rosbags.rosbag2 import Reader

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.reader import Bag, bag_files
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.bags.topic_info import KEEP_ALL
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput

SHIPPED = Path(__file__).parents[2] / "bags" / "LocationA_PedCross_E-W"


def test_reading_a_bag_loads_neither_torch_nor_policies_nor_learning() -> None:
    code = f"""
import sys
from vpsci_ros.bags.ticks import read_bag
print(len([tick for tick in read_bag({str(SHIPPED)!r})]), *sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    ticks, *modules = done.stdout.split()
    assert int(ticks) > 200
    rooms = {name.split(".")[1] for name in modules if name.startswith("vpsci_ros.")}
    assert {"bags", "wire", "world"} <= rooms
    assert not rooms & {"policy", "learning", "evaluation"}
    assert "torch" not in modules


def split_bag(folder: Path, messages: int = 60) -> Path:
    topic = BagTopic("/a", "std_msgs/msg/String", "string data\n", "RIHS01_0")
    bag = BagWriter(folder, [topic], chunk_size=1024, split_size=4096)
    bag.describe("node", {"seed": "7"})
    noise = np.random.default_rng(1)
    for i in range(messages):
        bag.write("/a", b"\x00\x01\x00\x00" + noise.bytes(500), 1000 + i, 5)
    bag.close({})
    return folder


def test_a_bag_is_split_by_size_and_read_as_one(tmp_path: Path) -> None:
    folder = split_bag(tmp_path / "bag")
    files = bag_files(folder)
    assert len(files) > 3
    assert [file.name for file in files] == [f"bag_{i}.mcap" for i in range(len(files))]
    assert all(4096 <= file.stat().st_size < 8192 for file in files[:-1])
    assert [raw.time for raw in Bag(folder).messages()] == list(range(1000, 1060))
    with Reader(folder) as reader:
        assert reader.message_count == 60
        assert [time for _, time, _ in reader.messages()] == list(range(1000, 1060))


def test_every_file_of_a_split_bag_says_how_it_was_made_and_what_was_seen_and_written_so_far(tmp_path: Path) -> None:
    folder = split_bag(tmp_path / "bag")
    written = []
    for file in bag_files(folder):
        records = dict(Bag(file).records())
        assert records["node"] == {"seed": "7"}
        assert records["vpsci_ros"]["messages_seen"] == records["vpsci_ros"]["messages_written"]
        written.append(int(records["vpsci_ros"]["messages_written"]))
    assert written == sorted(written)
    assert written[-1] == 60


@pytest.mark.parametrize("number", [2, -1], ids=["one in the middle", "the last one"])
@pytest.mark.parametrize("listed", [True, False])
def test_a_bag_that_lost_a_file_is_refused_until_it_is_repaired(tmp_path: Path, number: int, listed: bool) -> None:
    folder = split_bag(tmp_path / "bag")
    lost = bag_files(folder)[number]
    lost.unlink()
    if not listed and number == 2:  # what the recorder counted says it still
        (folder / "metadata.yaml").unlink()
    with pytest.raises(InvalidInput, match=rf"lists {lost.name}, which the folder lacks|of the 60 messages of /a"):
        bag_run(Bag(folder))
    (damage,) = bag_info(folder)["damage"]
    assert lost.name in damage or "of the 60 messages of /a" in damage
    repair_bag(folder)
    assert bag_info(folder)["damage"] == []


def test_repair_completes_the_last_file_of_a_split_bag_and_keeps_the_others(tmp_path: Path) -> None:
    folder = split_bag(tmp_path / "bag")
    *whole, last = bag_files(folder)
    before = [path.read_bytes() for path in whole]
    last.write_bytes(last.read_bytes()[:-200])  # as a killed recorder leaves it
    (folder / "metadata.yaml").unlink()
    assert "recovered" in str(repair_bag(folder))
    assert [path.read_bytes() for path in whole] == before
    times = [raw.time for raw in Bag(folder).messages()]
    assert times == list(range(1000, 1000 + len(times)))
    with Reader(folder) as reader:
        assert reader.message_count == len(times)


@pytest.mark.parametrize(
    ("profiles", "kept"),
    [
        ("", 0),
        ("- durability: volatile\n  depth: 10\n", 0),
        ("- {history: keep_last, depth: 1, durability: transient_local}\n", 1),
        ("- {history: 1, depth: 1, durability: 1}\n- {history: 1, depth: 3, durability: 1}\n", 4),  # of two publishers
        ("- {depth: 1, durability: transient_local}\n- {depth: 5, durability: volatile}\n", 1),
        ("- {history: keep_all, depth: 0, durability: transient_local}\n", KEEP_ALL),
        ("- [", 0),
    ],
)
def test_a_topic_is_latched_as_its_publishers_profiles_say(tmp_path: Path, profiles: str, kept: int) -> None:
    """Recorders of ROS 2 Humble write policies as rmw's numbers."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": profiles})
        writer.add_message(channel, 1, b"\x00\x01\x00\x00\x01\x00\x00\x00\x00", 1)
        writer.finish()
    assert Bag(path).topics()["/a"].latched == kept


_WITHOUT = {
    "text records": {"index_types": IndexType.CHUNK | IndexType.MESSAGE},
    "chunks": {"index_types": IndexType.MESSAGE | IndexType.METADATA},
    "messages": {"index_types": IndexType.CHUNK | IndexType.METADATA},
    "topics": {"repeat_channels": False},
    "types": {"repeat_schemas": False},
    "counts": {"use_statistics": False},
    "anything": {"index_types": IndexType.NONE},
}


@pytest.mark.parametrize("without", _WITHOUT)
def test_what_is_not_in_the_index_of_a_file_is_read_all_the_same(own_bag: Path, tmp_path: Path, without: str) -> None:
    """As `mcap` and other recorders may write it."""
    again = tmp_path / "again.mcap"
    with again.open("wb") as file:
        writer = mcap.writer.Writer(file, chunk_size=64 * 1024, **_WITHOUT[without])
        writer.start(profile="ros2")
        for name, values in Bag(own_bag).records():
            writer.add_metadata(name, values)
        ids: dict[str, int] = {}
        (path,) = own_bag.glob("*.mcap")
        for schema, channel, message in McapFile(path, strict=True).messages():
            if channel.topic not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, "cdr", schema_id, channel.metadata)
            writer.add_message(ids[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    assert Bag(again).records() == Bag(own_bag).records()
    held = {name: topic for name, topic in Bag(own_bag).topics().items() if topic.messages}
    assert Bag(again).topics() == held
    assert list(Bag(again).messages()) == list(Bag(own_bag).messages())


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("bag_0.db3", b"", "sqlite3 storage is not read: have `ros2 bag convert`"),
        ("bag_0.mcap", b"count,frame\n", "not an MCAP file"),
        ("bag_0.mcap", b"", "not completed"),
        ("notes.txt", b"", r"no \.mcap file"),
    ],
)
def test_what_is_no_bag_is_named(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=message):
        Bag(tmp_path).topics()


def test_a_bag_without_definitions_of_vpsci_msgs_is_read(short_bag: Path, tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    with (tmp_path / "bare" / "bag_0.mcap").open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start(profile="ros2", library="")
        for raw in Bag(short_bag).messages(("/world/state", "/safety/state")):
            schema = writer.register_schema(raw.type, "ros2msg", b"")
            writer.add_message(writer.register_channel(raw.topic, "cdr", schema), raw.time, raw.data, raw.time)
        writer.finish()
    whole, bare = ([tick.state.tobytes() for tick in read_bag(bag)] for bag in (short_bag, tmp_path / "bare"))
    assert bare == whole
