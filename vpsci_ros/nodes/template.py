"""Messages of which little changes from tick to tick: serialized once, then only the bytes that change are written.

To make the markers of a tick as objects of Python and serialize them takes 290 us, as long as all else that the world
does at a tick. The bytes are those that the middleware would write, with zeros for padding.
"""

import struct
from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from vpsci_ros.wire.padding import zeroed

_STAMP, _NUMBER = struct.Struct("<iI"), struct.Struct("<d")
MARK = Time(sec=0x5A17_5A17, nanosec=0x1A5C_1A5C)
"""The stamp of a message that becomes a template."""


class Template:
    """A serialized message to be filled with another stamp, wherever it has `MARK`, and other numbers.

    :param kind: its type, such as "nav_msgs/msg/Odometry".
    :param message: an example.
    :param numbers: float64 numbers of the example that change, such as nothing else in it has.
    """

    def __init__(self, kind: str, message: Any, numbers: Sequence[float]) -> None:
        self._data = zeroed(kind, serialize_message(message), kind)
        self._stamps = _places(self._data, _STAMP.pack(MARK.sec, MARK.nanosec))
        self._numbers = [(k, at) for k, each in enumerate(numbers) for at in _places(self._data, _NUMBER.pack(each))]

    def filled(self, stamp: Time, numbers: Sequence[float]) -> bytes:
        """Return the message with this stamp and these numbers in place of those of the example, in their order."""
        data, sec, nanosec = bytearray(self._data), stamp.sec, stamp.nanosec
        for at in self._stamps:
            _STAMP.pack_into(data, at, sec, nanosec)
        for k, at in self._numbers:
            _NUMBER.pack_into(data, at, numbers[k])
        return bytes(data)


def _places(data: bytes, mark: bytes) -> list[int]:
    """Return where a mark stands in a message, which has it at least once."""
    found = [at for at in range(len(data)) if data.startswith(mark, at)]
    assert found, "the example does not have one of its numbers"
    return found
