"""Zeros in place of the bytes that a serialized message leaves out between its fields.

CDR aligns numbers to their own size, and a serializer skips the gaps: what lay in the memory there goes over the wire
and into a raw recording. It differs from run to run, so the same run would not leave the same bag, and it may be
anything. (OMG DDS-XTypes 1.3, 7.4.1: XCDR version 1, little-endian, as Fast DDS writes.)

A type becomes a list of steps once, and compiled code walks over the bytes by it. To read and write the message by
rosbags' CDR would do the same, but for the bytes at its end, in 1600 us for the markers of a tick instead of 9.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import known_types
from vpsci_ros.wire.header import LITTLE_ENDIAN
from vpsci_ros.world.compiled import kernel

HEADER = 4  # [bytes] before the payload, from whose beginning on numbers are aligned
DEEPEST = 16  # sequences of messages within each other
# A step is (kind, size, count); a count below 0 is read from the message.
_NUMBERS, _STRING, _REPEAT, _END = range(4)  # the size of _REPEAT is the number of steps up to its _END
_SIZES = {
    **dict.fromkeys(("bool", "octet", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}


def zeroed(kind: str, data: bytes, where: str) -> bytes:
    """Return a serialized message of a type such as "nav_msgs/msg/Odometry" with zeros where it has padding.

    :param where: the topic, which opens the message.
    :raises InvalidInput: another encoding than little-endian CDR, or it is shorter than its own lengths say.
    """
    if data[:2] != LITTLE_ENDIAN:
        raise InvalidInput(f"{where}: expected little-endian CDR, got a message that begins with {data[:2].hex()}")
    clean = np.frombuffer(data, np.uint8).copy()
    end = _clear(clean, _program(kind), np.zeros((DEEPEST, 2), np.int64))
    if end > len(data):
        raise InvalidInput(f"{where}: expected a {kind} of {end} bytes or more, by its lengths, got {len(data)}")
    return clean.tobytes()


@cache
def _program(kind: str) -> NDArray[np.int64]:
    return np.array(_steps(Nodetype.NAME, kind), np.int64).reshape(-1, 3)


def _steps(node: Nodetype, about: Any) -> list[tuple[int, int, int]]:
    """Return the steps over a field, as rosbags describes it."""
    if node == Nodetype.NAME:
        return [step for _, field in known_types().fielddefs[about][1] for step in _steps(*field)]
    if node == Nodetype.BASE:
        return [(_STRING, 1, -1) if about[0] == "string" else (_NUMBERS, _SIZES[about[0]], 1)]
    element, length = about
    count = length if node == Nodetype.ARRAY else -1
    body = _steps(*element)
    if element[0] == Nodetype.BASE and body[0][0] == _NUMBERS:
        return [(_NUMBERS, body[0][1], count)]
    return [(_REPEAT, len(body), count), *body, (_END, 0, 0)]


@kernel
def _clear(data, program, loops):  # type: ignore[no-untyped-def]
    """Set the padding of a message, uint8[n], to zero; return where its fields end, beyond n where its lengths say so.

    :param program: int64[steps, 3].
    :param loops: int64[depth, 2], room for the first step of each sequence of messages that is open and what is left.
    """
    at, step, depth = HEADER, 0, 0
    while step < program.shape[0] and at <= data.size:
        kind, size, count = program[step, 0], program[step, 1], program[step, 2]
        step += 1
        if kind == _END:
            loops[depth - 1, 1] -= 1
            if loops[depth - 1, 1] > 0:
                step = loops[depth - 1, 0]
            else:
                depth -= 1
            continue
        if count < 0:
            at = _aligned(data, at, 4)
            if at + 4 > data.size:
                return at + 4
            count = 0
            for byte in range(4):
                count += np.int64(data[at + byte]) << (8 * byte)
            at += 4
        if kind == _REPEAT:
            if count == 0:
                step += size + 1
            else:
                loops[depth, 0], loops[depth, 1] = step, count
                depth += 1
        elif count > 0:
            at = _aligned(data, at, size) + size * count
            if kind == _STRING and at <= data.size:
                data[at - 1] = 0
    for i in range(at, data.size):
        data[i] = 0
    return at


@kernel
def _aligned(data, at, size):  # type: ignore[no-untyped-def]
    """Return the offset of a number of `size` bytes at or behind `at`, with zeros up to it."""
    end = at + -(at - HEADER) % size
    for i in range(at, min(end, data.size)):
        data[i] = 0
    return end
