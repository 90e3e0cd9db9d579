"""Messages of which little changes from tick to tick: serialized once, then only what changes is written.

To make the markers of a tick as objects of Python and serialize them takes 290 us, as long as all else that the world
does at a tick. The bytes are those that the middleware would write, with zeros for padding.
"""

import struct
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

from vpsci_ros.wire.header import WireHeader
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
        data = zeroed(kind, serialize_message(message), kind)
        marks = [_STAMP.pack(MARK.sec, MARK.nanosec), *map(_NUMBER.pack, numbers)]
        places = sorted((at, k) for k, mark in enumerate(marks) for at in _places(data, mark))
        self._constant: list[bytes] = []
        layout, order, end = "<", [], 0
        for at, k in [*places, (len(data), -1)]:  # what stands between two places, and what at the second one
            layout += f"{at - end}s" + ("" if k < 0 else "d" if k else "iI")
            order += [2 + len(numbers) + len(self._constant), *([] if k < 0 else [1 + k] if k else [0, 1])]
            self._constant.append(data[end:at])
            end = at + 8
        self._pack, self._in_order = struct.Struct(layout).pack, itemgetter(*order)

    def filled(self, header: WireHeader, numbers: Sequence[float]) -> bytes:
        """Return the message with this stamp and these numbers in place of those of the example, in their order."""
        values = (header.seconds, header.nanoseconds, *numbers, *self._constant)
        return self._pack(*self._in_order(values))


def _places(data: bytes, mark: bytes) -> list[int]:
    """Return where a mark stands in a message, which has it at least once."""
    found = [at for at in range(len(data)) if data.startswith(mark, at)]
    assert found, "the example does not have one of its numbers"
    return found
