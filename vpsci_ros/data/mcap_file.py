"""One MCAP file read from front to back, as far as it is whole: no index is needed, so a cut-off file reads too."""

import contextlib
import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from zstandard import ZstdError

from vpsci_ros.errors import InvalidInput

MCAP0_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<QQI")  # start of the index, start of its offsets, checksum
# What the parser raises on bytes that are not what they should be; lengths that are nonsense end in MemoryError.
_DAMAGE = (McapError, CRCValidationError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class RawMessage(NamedTuple):
    """A message as it came off the wire, with the channel and the schema that it was written with."""

    schema: Schema
    channel: Channel
    message: Message


class McapFile:
    """The messages of one file in the order of writing.

    :param strict: refuse a file that is not complete and whole, instead of noting what is wrong with it.
    :ivar damage: what was found wrong while reading, one sentence each.
    :ivar metadata: the named text records that were met while reading.
    """

    def __init__(self, path: Path, *, strict: bool) -> None:
        self.path = path
        self.strict = strict
        self.damage: list[str] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def messages(self) -> Iterator[RawMessage]:
        """Yield every whole message: damaged chunks are left out, and reading ends where the file breaks off.

        :raises InvalidInput: not an MCAP file, or (strict) one that breaks off or is damaged.
        """
        self._check_ends()
        if self._index_is_whole():
            self._read_summary()
        read = undescribed = 0
        for record in self._records():
            for entry in self._unpacked(record, read):
                if isinstance(entry, Schema):
                    self._schemas[entry.id] = entry
                elif isinstance(entry, Channel):
                    self._channels[entry.id] = entry
                elif isinstance(entry, Metadata):
                    self.metadata[entry.name] = dict(entry.metadata)
                elif isinstance(entry, Message):
                    channel = self._channels.get(entry.channel_id)
                    schema = self._schemas.get(channel.schema_id) if channel else None
                    if channel is None or schema is None:
                        undescribed += 1
                    else:
                        read += 1
                        yield RawMessage(schema, channel, entry)
        if undescribed:
            self._amiss(f"{undescribed} messages belong to topics whose description is lost")

    def _unpacked(self, record: McapRecord, read: int) -> list[McapRecord]:
        if not isinstance(record, Chunk):
            return [record]
        try:
            return breakup_chunk(record, validate_crc=True)
        except _DAMAGE as error:
            self._amiss(f"the chunk after message {read} is damaged ({error or type(error).__name__})")
            return []

    def _records(self) -> Iterator[McapRecord]:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            records = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size).records
            while True:
                try:
                    record = next(records)
                except StopIteration:
                    return
                except _DAMAGE as error:
                    self._amiss(
                        f"it breaks off or is damaged before byte {file.tell()} ({error or 'the end of the file'})"
                    )
                    return
                if isinstance(record, Footer) and not self._index_is_whole():
                    self._amiss("its index is damaged")
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

    def _read_summary(self) -> None:
        """Take the descriptions of topics from the index: in the data they may be lost with the first chunk."""
        with contextlib.suppress(*_DAMAGE), self.path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
            if summary is not None:
                self._schemas |= summary.schemas
                self._channels |= summary.channels

    def _check_ends(self) -> None:
        with self.path.open("rb") as file:
            begin = file.read(len(MCAP0_MAGIC))
            file.seek(max(file.seek(0, io.SEEK_END) - len(MCAP0_MAGIC), 0))
            end = file.read()
        if not MCAP0_MAGIC.startswith(begin):
            raise InvalidInput(f"{self.path}: not an MCAP file; expected one that a recorder wrote")
        if self.strict and end != MCAP0_MAGIC:
            self._amiss("it was not completed")

    def _amiss(self, text: str) -> None:
        if self.strict:
            raise InvalidInput(
                f"{self.path}: {text}: its recorder was killed, or the file is cut or damaged; "
                "complete the bag with repair_bag, or read with recover what is whole"
            )
        self.damage.append(text)
