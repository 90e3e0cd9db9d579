"""Writes an MCAP file, a chunk at a time, byte for byte as `mcap.writer.Writer` would.

That one makes some fifteen calls of Python for each message, where a tick of the graph has eight. The format is that of
mcap.dev/spec: message records in chunks compressed by zstd, an index behind each, checksums of everything.
"""

import struct
import zlib
from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log and publish time; then the data
_CHUNK = struct.Struct("<BQQQQII4sQ")  # opcode, length, first and last time, size, checksum, "zstd", compressed size
_INDEX = struct.Struct("<BQHI")  # opcode, length, channel, length of pairs of log time and offset


class McapWriter:
    """An MCAP file being written.

    :param stream: where it goes, from its present place on, which is the file's beginning.
    :param chunk_size: size that a chunk exceeds by its last message, before compression [bytes].
    """

    def __init__(self, stream: BinaryIO, chunk_size: int, profile: str, library: str) -> None:
        self._stream, self._chunk_size = stream, chunk_size
        self._schemas: list[McapRecord] = []
        self._channels: list[McapRecord] = []
        self._chunks: list[McapRecord] = []
        self._metadata: list[McapRecord] = []
        self._compressor = zstandard.ZstdCompressor()
        self._counts: Counter[int] = Counter()  # messages by channel
        self._first, self._last = 2**63 - 1, 0  # log times [ns]
        self._crc = 0  # of all that was written
        self._parts: list[bytes] = []  # of the present chunk
        self._size = 0  # of them together
        self._index: defaultdict[int, list[int]] = defaultdict(list)  # channel -> log time, offset, log time, ...
        self._write(MCAP0_MAGIC)
        self._write(_bytes(Header(profile, library)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a type and return its number."""
        self._schemas.append(Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._append(_bytes(self._schemas[-1]))
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Define a topic and return its number."""
        number = len(self._channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=dict(metadata))
        self._channels.append(channel)
        self._append(_bytes(channel))
        return number

    def add_message(self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes) -> bool:
        """Add a message, times in nanoseconds; return whether its chunk is full with it, and written.

        :raises OSError: the disk refuses it.
        """
        self._index[channel] += log_time, self._size
        size = len(data)
        self._parts += _MESSAGE.pack(Opcode.MESSAGE, 22 + size, channel, sequence, log_time, publish_time), data
        self._size += _MESSAGE.size + size
        if self._size > self._chunk_size:
            self._end_chunk()
            return True
        return False

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named record of text values; errors as `add_message`."""
        pairs = b"".join(_text(text) for pair in values.items() for text in pair)
        body = _text(name) + len(pairs).to_bytes(4, "little") + pairs
        data = _RECORD.pack(Opcode.METADATA, len(body)) + body
        self._metadata.append(MetadataIndex(offset=self._stream.tell(), length=len(data), name=name))
        self._write(data)

    @property
    def has_messages(self) -> bool:
        """Whether any message was added."""
        return bool(self._index or self._chunks)

    def finish(self) -> tuple[int, int, int]:
        """Write what waits, and the summary; return the first and last log time [ns] and the number of messages.

        :raises OSError: the disk refuses it.
        """
        if self._index:
            self._end_chunk()
        self._write(_bytes(DataEnd(self._crc)))
        start = self._stream.tell()
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=self._counts.total(),
            message_end_time=self._last,
            message_start_time=self._first if self._chunks else 0,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", []
        for opcode, records in groups:
            data = _bytes(*records)
            offsets.append(SummaryOffset(opcode, group_start=start + len(summary), group_length=len(data)))
            summary += data
        places = start, start + len(summary)
        summary += _bytes(*offsets)
        footer = _bytes(Footer(*places, summary_crc=0))[:-4]
        self._stream.write(summary + footer + struct.pack("<I", zlib.crc32(footer, zlib.crc32(summary))) + MCAP0_MAGIC)
        return self._first, self._last, self._counts.total()

    def _append(self, record: bytes) -> None:
        self._parts.append(record)
        self._size += len(record)

    def _end_chunk(self) -> None:
        """Write the present chunk with an index of each channel's messages, and begin another."""
        data = b"".join(self._parts)
        compressed = self._compressor.compress(data)
        times = [time for index in self._index.values() for time in index[::2]]
        first, last, size = min(times), max(times), _CHUNK.size - 9 + len(compressed)
        start = self._stream.tell()
        head = first, last, len(data), zlib.crc32(data), 4, b"zstd", len(compressed)
        self._write(_CHUNK.pack(Opcode.CHUNK, size, *head) + compressed)
        offsets, indices, end = {}, [], self._stream.tell()
        for channel, index in self._index.items():
            self._counts[channel] += len(index) // 2
            pairs = array("Q", index).tobytes()
            offsets[channel] = end
            indices.append(_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs), channel, len(pairs)) + pairs)
            end += len(indices[-1])
        self._write(b"".join(indices))
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=9 + size,
                message_index_offsets=offsets,
                message_index_length=sum(map(len, indices)),
                compression="zstd",
                compressed_size=len(compressed),
                uncompressed_size=len(data),
            )
        )
        self._first, self._last = min(first, self._first), max(last, self._last)
        self._parts, self._size = [], 0
        self._index.clear()

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._stream.write(data)


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _text(text: str) -> bytes:
    data = text.encode()
    return len(data).to_bytes(4, "little") + data
