"""A bag is written as rosbag2 wants it: `mcap` and `rosbags` read back what was put in."""

import random
import resource

import pytest
import yaml
from mcap.reader import make_reader

from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import VpsciError

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def topics() -> list[BagTopic]:
    return [
        BagTopic("/a", "std_msgs/msg/String", "string data\n", STRING_HASH),
        BagTopic("/b", "std_msgs/msg/String", "string data\n", STRING_HASH, latched=True),
    ]


def write(folder, count: int = 3) -> list[bytes]:
    bag = BagWriter(folder, topics(), chunk_size=1024)
    messages = [b"\x00\x01\x00\x00" + bytes([i]) * 700 for i in range(count)]
    for i, data in enumerate(messages):
        bag.write("/a" if i % 2 == 0 else "/b", data, log_time=1000 + i, publish_time=5)
    bag.close({"seed": "7"})
    return messages


def test_mcap_reads_back_every_byte(tmp_path) -> None:
    sent = write(tmp_path / "bag", 5)
    with open(tmp_path / "bag" / "bag_0.mcap", "rb") as file:
        reader = make_reader(file)
        got = [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert got == [("/a" if i % 2 == 0 else "/b", 1000 + i, data) for i, data in enumerate(sent)]
    totals = {
        "messages_seen": "5",
        "messages_written": "5",
        "seen": '{"/a": 3, "/b": 2}',
        "written": '{"/a": 3, "/b": 2}',
    }
    assert metadata["vpsci_ros"] == {"seed": "7"} | totals


def test_messages_that_nobody_could_read_are_counted_as_seen_and_refused(tmp_path) -> None:
    bag = BagWriter(tmp_path / "bag", topics())
    bag.write("/a", b"\x00\x01\x00\x00", log_time=1, publish_time=1)
    bag.refuse("/b")
    bag.close({})
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["custom_data"] == {
        "messages_seen": "2",
        "messages_written": "1",
        "messages_refused": "1",
        "seen": '{"/a": 1, "/b": 1}',
        "written": '{"/a": 1, "/b": 0}',
        "refused": '{"/a": 0, "/b": 1}',
    }


def test_a_disk_that_refuses_a_part_is_an_error_at_once_and_when_the_bag_is_closed(tmp_path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    bag = BagWriter(tmp_path / "bag", topics(), chunk_size=1024)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        with pytest.raises(VpsciError, match=r"bag_0.mcap: cannot write \(File too large\); free some space"):
            for i in range(100):
                bag.write("/a", random.Random(i).randbytes(700), log_time=i, publish_time=i)
        with pytest.raises(VpsciError, match=r"not complete, since the disk refused a part of it \(File too large\)"):
            bag.close({})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
