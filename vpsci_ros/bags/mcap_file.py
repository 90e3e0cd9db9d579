"""One MCAP file: by its index where it is whole, from front to back otherwise, so that a cut-off file reads too."""

import contextlib
import io
import struct
import zlib
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from zstandard import ZstdError

from vpsci_ros.bags.topic_info import TopicInfo
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage

MCAP0_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of a record: its kind and its length
_FOOTER = struct.Struct("<QQI")  # start of the index, start of its offsets, checksum
_DATA_END = struct.Struct("<BQI")  # kind, length, checksum of all that comes before
_BLOCK = 2**20  # [B] read at once for the checksum
# What the parser raises on bytes that are not what they should be; lengths that are nonsense end in MemoryError.
_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class McapMessage(NamedTuple):
    """A message with the channel and the schema that it was written with."""

    schema: Schema
    channel: Channel
    message: Message


class McapFile:
    """The messages of one file in the order of writing.

    :param strict: refuse a file that is not complete and whole, instead of noting what is wrong with it.
    :ivar damage: what was found wrong while reading, one sentence each.
    :ivar records: the named text records that were met while reading, each with its name.
    """

    def __init__(self, path: Path, *, strict: bool) -> None:
        self.path = path
        self.strict = strict
        self.damage: list[str] = []
        self.records: list[tuple[str, dict[str, str]]] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def topics(self) -> list[TopicInfo]:
        """Return what topics the file has, in the order of their names.

        :raises InvalidInput: see `messages`.
        """
        self._check_ends()
        found: dict[str, TopicInfo] = {}
        with self._indexed() as reader:
            if reader is not None:
                summary = reader.get_summary()
                counts = summary.statistics.channel_message_counts
                for number, channel in summary.channels.items():
                    schema = summary.schemas.get(channel.schema_id)
                    ends = [next(reader.iter_messages([channel.topic], reverse=r), None) for r in (False, True)]
                    first, last = (0 if end is None else end[2].log_time for end in ends)
                    row = _topic(channel, schema, counts.get(number, 0), first, last)
                    found[row.name] = found[row.name].joined(row) if row.name in found else row
                return sorted(found.values(), key=lambda row: row.name)
        for schema, channel, message in self.messages():
            row = _topic(channel, schema, 1, message.log_time, message.log_time)
            found[row.name] = found[row.name].joined(row) if row.name in found else row
        return sorted(found.values(), key=lambda row: row.name)

    def named_records(self) -> list[tuple[str, dict[str, str]]]:
        """Return the file's text records with their names, in the order of writing; messages are not read for it.

        :raises InvalidInput: see `messages`.
        """
        self._check_ends()
        with self._indexed() as reader:
            if reader is not None:
                return [(record.name, dict(record.metadata)) for record in reader.iter_metadata()]
        self.records.clear()
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
        self._check_ends()
        with self._indexed() as reader:
            if reader is not None:
                try:
                    chosen = reader.iter_messages(topics, starting_at=start, ending_at=stop, log_time_order=ordered)
                    yield from (_raw(*entry) for entry in chosen)
                    return
                except _DAMAGE as error:
                    self._report_damage(f"a chunk is damaged ({_reason(error)})")
                    return
        for schema, channel, message in self.messages():
            if start <= message.log_time <= stop and (topics is None or channel.topic in topics):
                yield _raw(schema, channel, message)

    @contextlib.contextmanager
    def _indexed(self) -> Iterator[Any]:
        """Give a reader that uses the file's index, or None where the index is not whole or must not be trusted."""
        with self.path.open("rb") as file:
            reader = None
            if self.strict and self._index_is_whole():
                with contextlib.suppress(*_DAMAGE):
                    reader = SeekingReader(file, validate_crcs=True)
                    summary = reader.get_summary()
                    if summary is None or summary.statistics is None or not summary.chunk_indexes:
                        reader = None
            yield reader

    def messages(self) -> Iterator[McapMessage]:
        """Yield every whole message: damaged chunks are left out, and reading ends where the file breaks off.

        :raises InvalidInput: not an MCAP file, or (strict) one that breaks off or is damaged.
        """
        self._check_ends()
        if self._index_is_whole():
            self._read_summary()
        elif not self.strict:
            self._find_descriptions()
        read = undescribed = 0
        for record in self._records():
            for entry in self._unpacked(record, read):
                if isinstance(entry, Schema):
                    self._schemas[entry.id] = entry
                elif isinstance(entry, Channel):
                    self._channels[entry.id] = entry
                elif isinstance(entry, Metadata):
                    self.records.append((entry.name, dict(entry.metadata)))
                elif isinstance(entry, Message):
                    channel = self._channels.get(entry.channel_id)
                    schema = self._schemas.get(channel.schema_id) if channel else None
                    if channel is None or schema is None:
                        undescribed += 1
                    else:
                        read += 1
                        yield McapMessage(schema, channel, entry)
        if undescribed:
            self._report_damage(f"{undescribed} messages belong to topics whose description is lost")

    def _unpacked(self, record: McapRecord, read: int) -> list[McapRecord]:
        if not isinstance(record, Chunk):
            return [record]
        try:
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
                begin = file.tell() or len(MCAP0_MAGIC)
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
                if isinstance(record, Footer) and not self._index_is_whole():
                    self._report_damage("its index is damaged")
                yield record

    def _index_is_whole(self) -> bool:
        """Whether the file ends in an index that agrees with its checksum (0: none), before the closing magic."""
        with self.path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            tail = _FOOTER.size + len(MCAP0_MAGIC)
            file.seek(max(size - tail, 0))
            end = file.read()
            if len(end) < tail or not end.endswith(MCAP0_MAGIC):
                return False
            start, _, checksum = _FOOTER.unpack(end[: _FOOTER.size])
            file.seek(min(start, size))
            return checksum == 0 or checksum == zlib.crc32(file.read()[: -(4 + len(MCAP0_MAGIC))])

    def last_record(self, name: str) -> dict[str, str]:
        """Return the last record of that name which was met while reading, empty for none."""
        return next((values for found, values in reversed(self.records) if found == name), {})

    def _read_summary(self) -> None:
        """Take the descriptions of topics from the index: in the data they may be lost with the first chunk."""
        with contextlib.suppress(*_DAMAGE), self.path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
            if summary is not None:
                self._schemas |= summary.schemas
                self._channels |= summary.channels

    def _find_descriptions(self) -> None:
        """Take the descriptions of topics that are left of a damaged index, before the messages come by."""
        noted = list(self.damage)
        for record in self._records():
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
        self.damage = noted

    def _check_ends(self) -> None:
        with self.path.open("rb") as file:
            begin = file.read(len(MCAP0_MAGIC))
            file.seek(max(file.seek(0, io.SEEK_END) - len(MCAP0_MAGIC), 0))
            end = file.read()
        if not MCAP0_MAGIC.startswith(begin):
            raise InvalidInput(f"{self.path}: not an MCAP file; expected one that a recorder wrote")
        if self.strict and end != MCAP0_MAGIC:
            self._report_damage("it was not completed")
        if self.strict and not self._data_is_whole:
            self._report_damage("its data do not agree with their checksum")

    @cached_property
    def _data_is_whole(self) -> bool:
        """Whether all bytes before the index agree with the checksum in front of it (0: none), where there is one."""
        with self.path.open("rb") as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(max(size - _FOOTER.size - len(MCAP0_MAGIC), 0))
            end = file.read(_FOOTER.size)
            start = _FOOTER.unpack(end)[0] if len(end) == _FOOTER.size else 0
            data_end = (start or size - len(MCAP0_MAGIC) - _FOOTER.size - _HEAD.size) - _DATA_END.size
            if data_end < 0 or start > size:
                return False
            file.seek(data_end)
            kind, length, expected = _DATA_END.unpack(file.read(_DATA_END.size))
            if (kind, length) != (Opcode.DATA_END, 4):
                return False
            if expected == 0:
                return True
            file.seek(0)
            checksum, left = 0, data_end
            while left > 0 and (block := file.read(min(_BLOCK, left))):
                checksum, left = zlib.crc32(block, checksum), left - len(block)
            return checksum == expected

    def _report_damage(self, text: str) -> None:
        if self.strict:
            raise InvalidInput(
                f"{self.path}: {text}: its recorder was killed, or the file is cut or damaged; "
                "complete the bag with `vpsci bag repair`, or read what is whole with --recover"
            )
        self.damage.append(text)


def _reason(error: BaseException) -> str:
    """Return what the parser says; some of its errors, such as the one for the end of a file, have no words."""
    return "the end of the file" if isinstance(error, EndOfFile) else str(error) or type(error).__name__


def _topic(channel: Channel, schema: Schema | None, count: int, first: int, last: int) -> TopicInfo:
    latched = "transient_local" in channel.metadata.get("offered_qos_profiles", "")
    return TopicInfo(channel.topic, schema.name if schema else "", count, first, last, latched)


def _raw(schema: Schema | None, channel: Channel, message: Message) -> RawMessage:
    kind, form, text = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
    definition = text.decode(errors="replace")
    return RawMessage(channel.topic, kind, channel.message_encoding, definition, form, message.log_time, message.data)
