"""A serialized `vpsci_msgs/WorldState` to records and back, at once.

It is the one message that three nodes read and one writes at every tick. Its twenty sequences, each made an object of
Python and then copied into records or out of them, took as long as everything else at a tick; compiled code goes
through the bytes once: 10 us to read and 7 us to write a state of one episode, where rosbags' CDR takes 55 and 15
without the records.
"""

import struct
from typing import NamedTuple

import numpy as np

from vpsci_ros.wire import layout
from vpsci_ros.wire.header import WireHeader, read_start, write_start
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import EPISODE
from vpsci_ros.world.tick import Tick

_REST = struct.Struct("<dI")  # dt, length of the first sequence
_FRAME = -1  # in place of an offset in a record: `policy_frame` has none
_OFFSETS = {name: int(field[1]) for name, field in dict(EPISODE.fields or {}).items()}
_SEQUENCES = layout.sequences("WorldState")
_SIZES = np.array([np.dtype(kind).itemsize for kind in _SEQUENCES.values()])
_PLACES = np.array([_FRAME if name == "policy_frame" else _OFFSETS[name] for name in _SEQUENCES])
_ROW = int(_SIZES.sum())  # [bytes] of one slot
_SENT = np.zeros(EPISODE.itemsize // 8, np.uint64)  # mask of a record's bytes that a message has
for _size, _place in zip(_SIZES, _PLACES, strict=True):
    if _place != _FRAME:
        _SENT.view(np.uint8)[_place : _place + _size] = 255


class SerializedState(NamedTuple):
    """What a serialized WorldState says."""

    header: WireHeader  # also for the answers to it
    tick: Tick
    period: float  # [s] of a tick, unchecked


def read_world_state(data: bytes) -> SerializedState | None:
    """Return what a serialized WorldState says; its numbers are as they come, see `received.credible`.

    :return: None where the bytes are not as ROS writes them, or the sequences differ in length, or are empty: the
        caller then has the middleware read the message, which finds out what is wrong with it.
    """
    start = read_start(data)
    if start is None or start[2] + _REST.size > len(data):
        return None
    header, number, at = start
    period, count = _REST.unpack_from(data, at)
    if count == 0 or count * _ROW > len(data):
        return None
    words = np.frombuffer(data, np.uint32, len(data) // 4)
    state = np.zeros(count * EPISODE.itemsize, np.uint8)
    frame = np.zeros(count, np.bool_)
    rows = state.reshape(count, EPISODE.itemsize)
    octets, begin = np.frombuffer(data, np.uint8), at + _REST.size - 4
    if not _read(octets, words, begin, _SIZES, _PLACES, rows, rows.view(np.uint32), frame):
        return None
    records = state.view(EPISODE)
    layout.number_pedestrians(records)
    return SerializedState(header, Tick(number, records, frame), period)


def write_world_state(world: SerializedState) -> bytes:
    """Return the serialized WorldState that says this, as ROS would write it, with zeros for padding."""
    start = write_start(world.header, world.tick.number) + _REST.pack(world.period, len(world.tick.state))
    state, frame, count = world.tick.state, world.tick.policy_frame, len(world.tick.state)
    words = np.zeros((len(start) + count * _ROW) // 4 + 4 * len(_SIZES), np.uint32)  # with room for lengths and padding
    data = words.view(np.uint8)
    data[: len(start)] = np.frombuffer(start, np.uint8)
    rows = state.view(np.uint8).reshape(count, EPISODE.itemsize)
    end = _write(data, words, len(start) - 4, _SIZES, _PLACES, rows, rows.view(np.uint32), frame)
    return data[:end].tobytes()


def as_read(world: SerializedState) -> SerializedState:
    """Return what a reader of the serialized state gets, arrays of its own, without the bytes between."""
    words = np.frombuffer(world.tick.state, np.uint64)  # a view, which numpy makes in a third of the time of `view`
    sent = np.empty_like(words)
    _mask(words, _SENT, sent)
    state = np.frombuffer(sent, EPISODE)
    layout.number_pedestrians(state)
    return SerializedState(world.header, Tick(world.tick.number, state, world.tick.policy_frame), world.period)


def warm_up() -> None:
    """Have all of it compiled (or loaded), so that no tick waits for it."""
    tick = Tick(0, np.zeros(1, EPISODE), np.zeros(1, np.bool_))
    read_world_state(write_world_state(as_read(SerializedState(WireHeader(0, 0, ""), tick, 1.0))))


@kernel
def _mask(words, mask, sent):  # type: ignore[no-untyped-def]
    """Fill `sent` with the words that the mask of each record leaves, a tenth of the time of numpy's `&`."""
    for i in range(0, words.size, mask.size):
        for j in range(mask.size):
            sent[i + j] = words[i + j] & mask[j]


@kernel
def _read(data, words, at, sizes, places, rows, row_words, frame):  # type: ignore[no-untyped-def]
    """Fill records from the sequences that begin at offset `at`; return whether all are there, one value a row.

    :param data, words: the message, uint8[n] and uint32[n // 4]; rows, row_words: EPISODE[B] likewise, [B, ...].
    :param sizes, places: of each sequence, the bytes of a value and its offset in a record.
    """
    count = rows.shape[0]
    for f in range(sizes.size):
        size, place = sizes[f], places[f]
        at = (at + 3) // 4 * 4
        if at + 4 > data.size or words[at // 4] != count:
            return False
        at += 4
        if size == 8 and at % 8 == 0:
            at += 4  # since it counts from behind the 4 bytes of the encapsulation
        if at + size * count > data.size:
            return False
        if place == _FRAME:
            for i in range(count):
                frame[i] = data[at + i] != 0
        elif size == 1:
            for i in range(count):
                rows[i, place] = data[at + i]
        else:
            first, word, each = at // 4, place // 4, size // 4
            for i in range(count):
                row_words[i, word] = words[first + i * each]
                if each == 2:
                    row_words[i, word + 1] = words[first + i * 2 + 1]
        at += size * count
    return True


@kernel
def _write(data, words, at, sizes, places, rows, row_words, frame):  # type: ignore[no-untyped-def]
    """Do the reverse of `_read`, with room enough in `data`; return the offset behind the last sequence."""
    count = rows.shape[0]
    for f in range(sizes.size):
        size, place = sizes[f], places[f]
        at = (at + 3) // 4 * 4
        words[at // 4] = count
        at += 4
        if size == 8 and at % 8 == 0:
            at += 4
        if place == _FRAME:
            for i in range(count):
                data[at + i] = frame[i]
        elif size == 1:
            for i in range(count):
                data[at + i] = rows[i, place]
        else:
            first, word, each = at // 4, place // 4, size // 4
            for i in range(count):
                words[first + i * each] = row_words[i, word]
                if each == 2:
                    words[first + i * 2 + 1] = row_words[i, word + 1]
        at += size * count
    return (at + 3) // 4 * 4
