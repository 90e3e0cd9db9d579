"""Zeros in place of the bytes that a serialized message leaves out between its fields.

CDR aligns numbers to their own size, and whoever serializes a message skips over the gaps: what lay in the memory there
goes over the wire and into a raw recording. It differs from run to run, so the same run would not leave the same bag,
and it is nobody's business. (OMG DDS-XTypes 1.3, 7.4.1: XCDR version 1, little-endian, as Fast DDS writes.)
"""

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import known_types

HEADER = 4  # [bytes] before the payload, from whose beginning on numbers are aligned
_SIZES = {
    **dict.fromkeys(("bool", "octet", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
_LITTLE_ENDIAN = b"\x00\x01"
Walk = Callable[["_Payload", int], int]  # from the offset at which a field may begin to the one behind it


class _Payload:
    """A serialized message, and the gaps that were found in it."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.gaps: list[tuple[int, int]] = []  # offsets in `data`

    def aligned(self, at: int, size: int) -> int:
        """Return the offset of a number of `size` bytes at or behind `at`, and note the gap."""
        if rest := (at - HEADER) % size:
            self.gaps.append((at, at + size - rest))
            return at + size - rest
        return at

    def count(self, at: int) -> tuple[int, int]:
        """Return a length, and the offset behind it; one that cannot be is more than the message has bytes."""
        at = self.aligned(at, 4)
        return int.from_bytes(self.data[at : at + 4], "little"), at + 4


def zeroed(kind: str, data: bytes, where: str) -> bytes:
    """Return a serialized message of a type such as "nav_msgs/msg/Odometry" with zeros where it has padding.

    :param where: the topic, which opens the message.
    :raises InvalidInput: another encoding than little-endian CDR, or it is shorter than its own lengths say.
    """
    if data[:2] != _LITTLE_ENDIAN:
        raise InvalidInput(f"{where}: expected little-endian CDR, got a message that begins with {data[:2].hex()}")
    payload = _Payload(data)
    end = _walker(kind)(payload, HEADER)
    if end > len(data):
        raise InvalidInput(f"{where}: expected a {kind} of {end} bytes, by its own lengths, got {len(data)}")
    dirty = [(a, b) for a, b in [*payload.gaps, (end, len(data))] if any(data[a:b])]
    if not dirty:
        return data
    clean = bytearray(data)
    for a, b in dirty:
        clean[a:b] = bytes(b - a)
    return bytes(clean)


@cache
def _walker(kind: str) -> Walk:
    """Return what walks over a message of a type; numbers of fixed places in a row are one step."""
    steps: list[Walk] = []
    for fixed, group in itertools.groupby(_parts(kind), lambda part: isinstance(part, tuple)):
        row: list[Any] = list(group)
        steps += [_run(row)] if fixed else row

    def walk(payload: _Payload, at: int) -> int:
        for step in steps:
            at = step(payload, at)
        return at

    return walk


def _parts(kind: str) -> Iterator[tuple[int, int] | Walk]:
    """Yield the fields of a type, those of its own fields' types in place: (size, count) of numbers, or a walk."""
    for _, (node, about) in known_types().fielddefs[kind][1]:
        if node == Nodetype.NAME:
            yield from _parts(str(about))
        else:
            yield _field(node, about)


def _field(node: Nodetype, about: Any) -> tuple[int, int] | Walk:
    if node == Nodetype.NAME:
        return _walker(about)
    if node == Nodetype.BASE:
        return _string if about[0] == "string" else (_SIZES[about[0]], 1)
    (inner, inside), length = about
    fixed = node == Nodetype.ARRAY
    if inner == Nodetype.BASE and inside[0] != "string":
        return (_SIZES[inside[0]], length) if fixed else _sequence(_SIZES[inside[0]])
    element = _field(inner, inside)
    return _each(_run([element]) if isinstance(element, tuple) else element, length if fixed else None)


def _run(numbers: list[tuple[int, int]]) -> Walk:
    """Return a step over (size, count) of numbers: where its gaps are depends on where it begins, of eight places."""
    found = []
    for phase in range(8):
        run, at = _Payload(b""), HEADER + phase
        for size, count in numbers:
            at = run.aligned(at, size) + size * count
        begin = HEADER + phase
        found.append((at - begin, [(a - begin, b - begin) for a, b in run.gaps]))

    def walk(payload: _Payload, at: int) -> int:
        length, gaps = found[(at - HEADER) % 8]
        if gaps:
            payload.gaps += [(at + a, at + b) for a, b in gaps]
        return at + length

    return walk


def _sequence(size: int) -> Walk:
    def walk(payload: _Payload, at: int) -> int:
        count, at = payload.count(at)
        return payload.aligned(at, size) + size * count if count else at

    return walk


def _string(payload: _Payload, at: int) -> int:
    count, at = payload.count(at)
    if count:
        payload.gaps.append((at + count - 1, at + count))  # the zero that ends it
    return at + count


def _each(step: Walk, count: int | None) -> Walk:
    def walk(payload: _Payload, at: int) -> int:
        many, at = (count, at) if count is not None else payload.count(at)
        for _ in _until_the_end(payload, many):
            at = step(payload, at)
            if at > len(payload.data):
                break  # lengths that cannot be must not cost the time that they say
        return at

    return walk


def _until_the_end(payload: _Payload, many: int) -> Iterator[int]:
    return iter(range(min(many, len(payload.data))))
