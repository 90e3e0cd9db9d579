"""The first bytes of a serialized message of `vpsci_msgs`: encapsulation, header, tick.

Little-endian CDR as ROS makes it (OMG DDS-XTypes 1.3, 7.4.1: XCDR version 1): a number stands at a multiple of its
size, counted from behind the 4 bytes of the encapsulation. What is written here has zeros between fields, and behind
the last one up to a multiple of 4, to which the middleware would fill it up by whatever lies in the memory.
"""

import struct
from typing import Any, NamedTuple

from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.layout import MAP

LITTLE_ENDIAN = b"\x00\x01"
_START = struct.Struct("<4siII")  # encapsulation, stamp, length of frame_id with the zero that ends it
_CLOCK = struct.Struct("<4siI")
_STAMP = struct.Struct("<iI")
_LENGTH = struct.Struct("<I")  # of a sequence; of a string with the zero that ends it
_TICK = struct.Struct("<Q")
_SEQUENCES = ("/markers", "/tf", "/tf_static")  # topics of messages that are sequences


class WireHeader(NamedTuple):
    """The content of a std_msgs/Header."""

    seconds: int  # of the stamp
    nanoseconds: int
    frame_id: str

    @property
    def at(self) -> int:
        """The time stamp of the header [ns]."""
        return self.seconds * 1_000_000_000 + self.nanoseconds


def tick_header(tick: int, period: float) -> WireHeader:
    """Return the header of a tick by its number and `period` [s]: its simulated time, and frame_id `map`."""
    return WireHeader(*divmod(tick * round(period * 1e9), 1_000_000_000), MAP)


def read_start(data: bytes, where: str) -> tuple[WireHeader, int, int]:
    """Return header and tick of a serialized message, and the offset of the first byte after them.

    :param where: the topic, which opens the error message.
    :raises InvalidInput: they are not as ROS writes them.
    """
    if len(data) >= _START.size:
        encoding, seconds, nanoseconds, length = _START.unpack_from(data)
        at = aligned(_START.size + length, 8)
        if encoding[:2] == LITTLE_ENDIAN and length > 0 and at + _TICK.size <= len(data):
            frame_id = str(data[_START.size : _START.size + length - 1], "utf-8", "replace")
            return WireHeader(seconds, nanoseconds, frame_id), _TICK.unpack_from(data, at)[0], at + _TICK.size
    raise InvalidInput(f"{where}: {len(data)} bytes that are no message with header and tick in little-endian CDR")


def write_start(header: WireHeader, tick: int) -> bytes:
    """Return the first bytes of a message: encapsulation, header and tick."""
    return padded(with_header(LITTLE_ENDIAN + b"\0\0", header), 8) + _TICK.pack(tick)


def with_header(data: bytes, header: WireHeader) -> bytes:
    """Return the given bytes with a header appended."""
    return with_text(padded(data, 4) + _STAMP.pack(header.seconds, header.nanoseconds), header.frame_id)


def with_text(data: bytes, text: str) -> bytes:
    """Return the given bytes with a string appended."""
    name = text.encode() + b"\0"
    return padded(data, 4) + _LENGTH.pack(len(name)) + name


def with_numbers(data: bytes, values: NDArray[Any]) -> bytes:
    """Return the given bytes with a sequence of n > 0 numbers appended."""
    return padded(padded(data, 4) + _LENGTH.pack(len(values)), values.itemsize) + values.tobytes()


def padded(data: bytes, size: int) -> bytes:
    """Return the given bytes with zeros appended, so that a number of `size` bytes can follow at its alignment."""
    return data + bytes(-(len(data) - 4) % size)


def write_clock(header: WireHeader) -> bytes:
    """Return the serialized rosgraph_msgs/Clock of a header's stamp."""
    return _CLOCK.pack(LITTLE_ENDIAN, header.seconds, header.nanoseconds)


def stamp_of(topic: str, data: bytes) -> int:
    """Return the stamp [ns] of a serialized message of any recorded topic.

    Every recorded type begins with its stamp, after CDR's 4 bytes; in a sequence its length comes first.

    :raises InvalidInput: the message is too short to have one, or it is none: negative, or of more than a second's
        nanoseconds.
    """
    at = 8 if topic in _SEQUENCES else 4
    if len(data) < at + _STAMP.size:
        raise InvalidInput(f"{topic}: expected a message of at least {at + _STAMP.size} bytes, got {len(data)}")
    seconds, nanoseconds = _STAMP.unpack_from(data, at)
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise InvalidInput(
            f"{topic}: expected a stamp from 0 s on, got {seconds} s and {nanoseconds} ns; "
            "does another program publish it?"
        )
    return int(seconds * 1_000_000_000 + nanoseconds)


def aligned(at: int, size: int) -> int:
    """Return the first offset, `at` or later, at which a number of `size` bytes is aligned."""
    return at + -(at - 4) % size
