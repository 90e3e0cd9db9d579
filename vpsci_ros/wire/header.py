"""How a message of `vpsci_msgs` begins when it is serialized: encapsulation, header, tick.

Little-endian CDR as ROS makes it, see `vpsci_ros.wire.padding`: a number stands at a multiple of its size, counted from
behind the 4 bytes of the encapsulation.
"""

import struct
from typing import NamedTuple

LITTLE_ENDIAN = b"\x00\x01"
_START = struct.Struct("<4siII")  # encapsulation, stamp, length of frame_id with the zero that ends it
_CLOCK = struct.Struct("<4siI")
_TICK = struct.Struct("<Q")


class WireHeader(NamedTuple):
    """A std_msgs/Header."""

    seconds: int  # of the stamp
    nanoseconds: int
    frame_id: str

    @property
    def at(self) -> int:
        """The stamp [ns]."""
        return self.seconds * 1_000_000_000 + self.nanoseconds


def read_start(data: bytes) -> tuple[WireHeader, int, int] | None:
    """Return header and tick of a serialized message, and the offset behind them.

    :return: None where they are not as ROS writes them.
    """
    if len(data) < _START.size:
        return None
    encoding, seconds, nanoseconds, length = _START.unpack_from(data)
    at = aligned(_START.size + length, 8)
    if encoding[:2] != LITTLE_ENDIAN or length == 0 or at + _TICK.size > len(data):
        return None
    try:
        frame_id = str(data[_START.size : _START.size + length - 1], "utf-8")
    except UnicodeDecodeError:
        return None
    return WireHeader(seconds, nanoseconds, frame_id), _TICK.unpack_from(data, at)[0], at + _TICK.size


def write_start(header: WireHeader, tick: int) -> bytes:
    """Return the bytes from the encapsulation to the tick."""
    name = header.frame_id.encode() + b"\0"
    start = _START.pack(LITTLE_ENDIAN, header.seconds, header.nanoseconds, len(name)) + name
    return start + bytes(-(len(start) - 4) % 8) + _TICK.pack(tick)


def write_clock(header: WireHeader) -> bytes:
    """Return the serialized rosgraph_msgs/Clock of a header's stamp."""
    return _CLOCK.pack(LITTLE_ENDIAN, header.seconds, header.nanoseconds)


def aligned(at: int, size: int) -> int:
    """Return the offset of a number of `size` bytes at or behind `at`."""
    return at + -(at - 4) % size
