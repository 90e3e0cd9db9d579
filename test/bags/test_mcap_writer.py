"""Our own writer of MCAP leaves the bytes that the `mcap` package's leaves."""

import io
import random

import pytest
from mcap.writer import CompressionType, Writer

from vpsci_ros.bags.mcap_writer import McapWriter


def theirs(messages: list[tuple[int, int, bytes]]) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=3000, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="ros2", library="a 1")
    schema = writer.register_schema("a/b", "ros2msg", b"int8 a")
    channels = [writer.register_channel(f"/{k}", "cdr", schema, {"quality": "é"}) for k in range(3)]
    for number, (channel, at, data) in enumerate(messages):
        writer.add_message(channels[channel], at, data, publish_time=number, sequence=7)
        if number % 17 == 0:
            writer.add_metadata("record", {"number": str(number), "ü": "ö"})
    writer.finish()
    return stream.getvalue()


def ours(messages: list[tuple[int, int, bytes]]) -> bytes:
    stream = io.BytesIO()
    writer = McapWriter(stream, 3000, profile="ros2", library="a 1")
    schema = writer.add_schema("a/b", "ros2msg", b"int8 a")
    channels = [writer.add_channel(f"/{k}", "cdr", schema, {"quality": "é"}) for k in range(3)]
    for number, (channel, at, data) in enumerate(messages):
        writer.add_message(channels[channel], 7, at, number, data)
        if number % 17 == 0:
            writer.add_metadata("record", {"number": str(number), "ü": "ö"})
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_a_file_is_byte_for_byte_that_of_the_mcap_package(count: int) -> None:
    draw = random.Random(count)
    messages = [(draw.randrange(3), draw.randrange(10**9), draw.randbytes(draw.randrange(300))) for _ in range(count)]
    assert ours(messages) == theirs(messages)
