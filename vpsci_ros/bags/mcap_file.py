"""One MCAP file, read by its index if the index is complete, otherwise from front to back.

`mcap` reads and unpacks. The checksums over the data and over the index are compared here, since no reader does it:
of 200 copies of a bag with one flipped bit, rosbags' reader took 88 for whole and gave other messages for 17 of them,
at less than half the speed; this one refuses all 200.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.summary import Summary
from zstandard import ZstdError, frame_content_size

from vpsci_ros.bags.topic_info import KEEP_ALL, TopicInfo, by_name
from vpsci_ros.documents import parse_yaml
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage

MAGIC = b"\x89MCAP0\r\n"  # at both ends
_HEAD = struct.Struct("<BQ")  # of a record: its kind and its length
_FOOTER = struct.Struct("<QQI")  # start of the index, start of its offsets, checksum; 0: there is none
_DATA_END = struct.Struct("<BQI")  # kind, length, checksum of all that comes before; 0: there is none
_BLOCK = 2**20  # [bytes] read at once for the checksum
# What the parser raises on bytes that are not what they should be; lengths that are nonsense end in MemoryError.
_DAMAGE = (
    *(McapError, CRCValidationError, ZstdError, struct.error),
    *(ValueError, OverflowError, MemoryError, RuntimeError),  # the last one is LZ4's
)
LARGEST_CHUNK = 2**28  # [bytes] unpacked; recorders write chunks of less than a megabyte


McapMessage = tuple[Schema, Channel, Message]
"""A message after the schema and the channel that it was written with."""


class McapFile:
    """One MCAP file: its topics, text records and messages.

    :param strict: refuse a file that is not complete and whole, instead of noting what is wrong with it.
    :ivar damage: what was found wrong while reading, one sentence each.
    :ivar records: the named text records that `messages` found, each with its name.
    """

    def __init__(self, path: Path, *, strict: bool) -> None:
        self.path = path
        self.strict = strict
        self.damage: list[str] = []
        self.records: list[tuple[str, dict[str, str]]] = []

    def topics(self) -> list[TopicInfo]:
        """Return the topics of the file, sorted by name.

        :raises InvalidInput: see `messages`.
        """
        if self._index is not None:
            with self._seeking() as reader:
                return list(by_name(_indexed_topics(reader, self._index)).values())
        single = (_topic(channel, schema, 1, m.log_time, m.log_time) for schema, channel, m in self.messages())
        return list(by_name(single).values())

    def named_records(self) -> list[tuple[str, dict[str, str]]]:
        """Return the file's text records with their names, in the order of writing; with an index, no message is read.

        :raises InvalidInput: see `messages`.
        """
        if self._index is not None:
            with self._seeking() as reader:
                return [(record.name, dict(record.metadata)) for record in reader.iter_metadata()]
        for _ in self.messages():
            pass
        return self.records

    def select(
        self, topics: Collection[str] | None = None, start: int = 0, stop: int = 2**63 - 1, *, ordered: bool = False
    ) -> Iterator[RawMessage]:
        """Yield the messages of these topics (None: all) with log times from `start` to `stop` [ns], both included.

        Of a whole file only the chunks that hold any are read.

        :param ordered: by log time, where the file has an index; else in the order of writing.
        :raises InvalidInput: see `messages`.
        """
        if self._index is not None:
            with self._seeking() as reader:
                chosen = reader.iter_messages(topics, starting_at=start, ending_at=stop, log_time_order=ordered)
                yield from (_raw(*entry) for entry in chosen)
            return
        for schema, channel, message in self.messages():
            if start <= message.log_time <= stop and (topics is None or channel.topic in topics):
                yield _raw(schema, channel, message)

    @cached_property
    def _index(self) -> Summary | None:
        """The index of the file, whose checksums were compared; None where it is not complete or (not strict) not used.

        Recorders may leave parts of the index out: what is not listed may be in the file all the same.
        """
        if not self.strict:
            return None
        with self.path.open("rb") as file:
            self._check(file)
        with self._seeking() as reader, self.path.open("rb") as file:
            summary = reader.get_summary()
            for index in summary.chunk_indexes if summary is not None else ():
                file.seek(index.chunk_start_offset + _HEAD.size)
                _require_modest(Chunk.read(ReadDataStream(file)))
            return summary if summary is not None and _covers(summary) else None

    @contextlib.contextmanager
    def _seeking(self) -> Iterator[SeekingReader]:
        """Yield a reader that seeks by the index; damage that it meets is reported.

        :raises InvalidInput: the file is damaged.
        """
        with self.path.open("rb") as file:
            try:
                yield SeekingReader(file, validate_crcs=True)
            except InvalidInput:
                raise
            except _DAMAGE as error:
                self._report_damage(f"a chunk or its index is damaged ({_reason(error)})")

    def messages(self) -> Iterator[McapMessage]:
        """Yield every complete message; damaged chunks are skipped, and reading ends where the file breaks off.

        :raises InvalidInput: not an MCAP file, or (strict) one that breaks off or is damaged.
        """
        with self.path.open("rb") as file:
            self._check(file)
        return self._in_order()

    def _in_order(self) -> Iterator[McapMessage]:
        self.records.clear()
        schemas, channels = self._descriptions()
        read = undescribed = 0
        for record in self._records():
            for entry in self._unpacked(record, read):
                if isinstance(entry, Schema):
                    schemas[entry.id] = entry
                elif isinstance(entry, Channel):
                    channels[entry.id] = entry
                elif isinstance(entry, Metadata):
                    self.records.append((entry.name, dict(entry.metadata)))
                elif isinstance(entry, Message):
                    channel = channels.get(entry.channel_id)
                    schema = schemas.get(channel.schema_id) if channel else None
                    if channel is None or schema is None:
                        undescribed += 1
                    else:
                        read += 1
                        yield schema, channel, entry
        if undescribed:
            self._report_damage(f"{undescribed} messages belong to topics whose description is lost")

    def _descriptions(self) -> tuple[dict[int, Schema], dict[int, Channel]]:
        """Return the descriptions of topics in the index, if there is one; those in the data may be lost.

        Damage is noted when the messages are read.
        """
        with contextlib.suppress(OSError, *_DAMAGE), self.path.open("rb") as file:
            summary = SeekingReader(file, record_size_limit=self.path.stat().st_size).get_summary()
            if summary is not None:
                return dict(summary.schemas), dict(summary.channels)
        return {}, {}

    def _unpacked(self, record: McapRecord, read: int) -> list[McapRecord]:
        if not isinstance(record, Chunk):
            return [record]
        try:
            _require_modest(record)
            return breakup_chunk(record, validate_crc=True)
        except _DAMAGE as error:
            self._report_damage(f"the chunk after message {read} is damaged ({_reason(error)})")
            return []

    def _records(self) -> Iterator[McapRecord]:
        """Yield the file's records; a damaged one is passed over by its length, as long as that is believable."""
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            records = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size).records
            while True:
                begin = file.tell() or len(MAGIC)
                try:
                    record = next(records)
                except StopIteration:
                    return
                except _DAMAGE as error:
                    self._report_damage(f"it breaks off or is damaged before byte {file.tell()} ({_reason(error)})")
                    file.seek(begin)
                    head = file.read(_HEAD.size)
                    after = begin + len(head) + (_HEAD.unpack(head)[1] if len(head) == _HEAD.size else size)
                    if after >= size:
                        return
                    file.seek(after)
                    records = StreamReader(file, True, emit_chunks=True, record_size_limit=size).records
                    continue
                yield record

    def _check(self, file: BinaryIO) -> None:
        """Look at both ends of the file and compare the checksums of its data and of its index.

        :raises InvalidInput: see `messages`.
        """
        if not MAGIC.startswith(file.read(len(MAGIC))):
            raise InvalidInput(f"{self.path}: not an MCAP file; expected one that a recorder wrote")
        end = file.seek(0, io.SEEK_END) - len(MAGIC)
        footer = end - _FOOTER.size
        file.seek(max(footer, 0))
        last = file.read()
        if footer < 0 or not last.endswith(MAGIC):
            if self.strict:
                self._report_damage("it was not completed")
            return
        start, _, checksum = _FOOTER.unpack(last[: _FOOTER.size])
        begin = start or footer - _HEAD.size
        if begin > footer or (checksum and checksum != _checksum(file, begin, end - 4)):
            self._report_damage("its index is damaged")
        elif self.strict:
            file.seek(max(begin - _DATA_END.size, 0))
            kind, length, checksum = _DATA_END.unpack(file.read(_DATA_END.size))
            whole = (kind, length) == (Opcode.DATA_END, 4)
            if not whole or (checksum and checksum != _checksum(file, 0, begin - _DATA_END.size)):
                self._report_damage("its data do not agree with their checksum")

    def _report_damage(self, text: str) -> None:
        if self.strict:
            raise InvalidInput(
                f"{self.path}: {text}: its recorder was killed, or the file is cut or damaged; "
                "complete the bag with `vpsci bag repair`, or read what is whole with --recover"
            )
        self.damage.append(text)


def _covers(summary: Summary) -> bool:
    """Return whether a file's index lists all its types, topics, chunks, messages of chunks and text records."""
    counts, chunks = summary.statistics, summary.chunk_indexes
    if counts is None or not chunks:
        return False
    listed = len(summary.channels), len(chunks), len(summary.metadata_indexes)
    messages = sum(counts.channel_message_counts.values())
    return (
        listed == (counts.channel_count, counts.chunk_count, counts.metadata_count)
        and messages == counts.message_count
        and all(chunk.message_index_offsets for chunk in chunks)
        and {channel.schema_id for channel in summary.channels.values()} <= {0, *summary.schemas}
    )


def _require_modest(chunk: Chunk) -> None:
    """Refuse a chunk that unpacks to more than `LARGEST_CHUNK`; the size that it declares is not trusted.

    :raises McapError: it does.
    """
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        size = max(size, frame_content_size(chunk.data))
    elif chunk.compression == "lz4":
        size, unpacker, data = 0, LZ4FrameDecompressor(), chunk.data
        while size <= LARGEST_CHUNK and not unpacker.eof and (data or not unpacker.needs_input):
            size, data = size + len(unpacker.decompress(data, _BLOCK)), b""
    if size > LARGEST_CHUNK:
        raise McapError(f"it unpacks to more than {LARGEST_CHUNK / 1e6:.0f} MB")


def _checksum(file: BinaryIO, begin: int, end: int) -> int:
    """Return the checksum of the bytes from `begin` to `end`."""
    file.seek(begin)
    checksum, left = 0, end - begin
    while left > 0 and (block := file.read(min(_BLOCK, left))):
        checksum, left = zlib.crc32(block, checksum), left - len(block)
    return checksum


def _indexed_topics(reader: SeekingReader, summary: Summary) -> Iterable[TopicInfo]:
    assert summary.statistics is not None
    for number, channel in summary.channels.items():
        count = summary.statistics.channel_message_counts.get(number, 0)
        ends = [next(reader.iter_messages([channel.topic], reverse=last), None) for last in (False, True)]
        first, last = (0 if end is None else end[2].log_time for end in ends)
        yield _topic(channel, summary.schemas.get(channel.schema_id), count, first, last)


def _reason(error: BaseException) -> str:
    """Return the message of an error of the parser; for errors without text, such as the end of the file, a name."""
    return "the end of the file" if isinstance(error, EndOfFile) else str(error) or type(error).__name__


def _topic(channel: Channel, schema: Schema | None, count: int, first: int, last: int) -> TopicInfo:
    return TopicInfo(channel.topic, schema.name if schema else "", count, first, last, latched(channel))


def latched(channel: Channel) -> int:
    """Return the number of messages that a topic's publishers keep for late subscribers; 0 for a topic not latched.

    A bag has a profile for each publisher; older recorders write the durability as rmw's number, 1.
    """
    text = channel.metadata.get("offered_qos_profiles", "")
    try:
        profiles = parse_yaml(text, channel.topic)
    except InvalidInput:
        return 0  # a recorder that says nothing of it
    rows = [row for row in profiles if isinstance(row, dict)] if isinstance(profiles, list) else []
    return sum(_depth(row) for row in rows if row.get("durability") in ("transient_local", 1))


def _depth(profile: Mapping[str, object]) -> int:
    """Return how many messages a publisher with this profile keeps."""
    if profile.get("history") in ("keep_all", 2):
        return KEEP_ALL
    depth = profile.get("depth")
    return depth if isinstance(depth, int) and depth > 0 else 1


def _raw(schema: Schema | None, channel: Channel, message: Message) -> RawMessage:
    kind, form, text = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
    definition = text.decode(errors="replace")
    return RawMessage(channel.topic, kind, channel.message_encoding, definition, form, message.log_time, message.data)
