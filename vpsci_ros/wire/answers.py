"""Conversion of serialized `vpsci_msgs/SafetyState` and `vpsci_msgs/AgentAction` to arrays and back.

The objects returned have the fields of the messages that `vpsci_ros.wire.layout` reads. By hand, since rosbags' CDR
takes 1 to 5 us more for each message and 0.17 s of CPU at the start of each node, for the types that it reads.
"""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.header import WireHeader, aligned, padded, read_start, with_numbers, write_start
from vpsci_ros.wire.layout import SAFETY

Floats = NDArray[np.float64]
_U32 = struct.Struct("<I")


class SafetyContent(NamedTuple):
    """The content of a serialized SafetyState."""

    header: WireHeader
    tick: int
    curvttc: Floats  # [s]
    distance: Floats  # [m]
    critical: NDArray[np.uint8] | NDArray[np.bool_]


class ActionContent(NamedTuple):
    """The content of a serialized AgentAction."""

    header: WireHeader
    tick: int
    longitudinal: Floats  # [m/s2]
    lateral: Floats  # [m/s2]
    policy_version: int


def read_safety_state(data: bytes, where: str = SAFETY) -> SafetyContent:
    """Return the content of a serialized SafetyState; its numbers are checked by `vpsci_ros.wire.layout.safety_state`.

    :raises InvalidInput: the bytes are not as ROS writes them.
    """
    header, tick, curvttc, distance, count, at = _read(data, where)
    if count > len(data) - at:
        raise _broken_off(data, where)
    critical = np.frombuffer(data, np.uint8, count, at) if count else np.zeros(0, np.uint8)
    return SafetyContent(header, tick, curvttc, distance, critical)


def read_action(data: bytes, where: str) -> ActionContent:
    """Return the content of a serialized AgentAction; its lengths are checked by `vpsci_ros.wire.layout.action`.

    :raises InvalidInput: the bytes are not as ROS writes them.
    """
    return ActionContent(*_read(data, where)[:5])


def write_safety_state(safety: SafetyContent) -> bytes:
    """Return the serialized SafetyState of at least one slot."""
    data = write_start(safety.header, safety.tick)
    for values in (safety.curvttc, safety.distance, safety.critical):
        data = with_numbers(data, values)
    return padded(data, 4)


def write_action(action: ActionContent) -> bytes:
    """Return the serialized AgentAction of at least one slot."""
    data = with_numbers(with_numbers(write_start(action.header, action.tick), action.longitudinal), action.lateral)
    return data + _U32.pack(action.policy_version)


def _read(data: bytes, where: str) -> tuple[WireHeader, int, Floats, Floats, int, int]:
    """Return header, tick, two float64[] and a uint32 of a SafetyState or AgentAction, and the offset behind them.

    :raises InvalidInput: the bytes are not as ROS writes them.
    """
    header, tick, at = read_start(data, where)
    try:
        first, at = _floats(data, at)
        second, at = _floats(data, at)
        (number,) = _U32.unpack_from(data, aligned(at, 4))
    except (struct.error, ValueError):
        raise _broken_off(data, where) from None
    return header, tick, first, second, number, aligned(at, 4) + _U32.size


def _broken_off(data: bytes, where: str) -> InvalidInput:
    return InvalidInput(f"{where}: {len(data)} bytes, which is shorter than the lengths in the message say")


def _floats(data: bytes, at: int) -> tuple[Floats, int]:
    """Return the float64[] that begins at or behind an offset, and the offset behind it.

    :raises struct.error, ValueError: the message ends before.
    """
    at = aligned(at, 4)
    (count,) = _U32.unpack_from(data, at)
    if count == 0:
        return np.zeros(0), at + 4
    at = aligned(at + 4, 8)
    # Copied, since in a message it does not stand where memory wants a float64.
    return np.frombuffer(data, np.float64, count, at).copy(), at + 8 * count
