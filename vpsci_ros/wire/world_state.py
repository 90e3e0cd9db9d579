"""Conversion of a serialized `vpsci_msgs/WorldState` to records and back.

Three nodes read it and one writes it at every tick. Its sequences, each made an object of Python and then copied into
records or out of them, took as long as everything else at a tick; compiled code goes through the bytes once: 10 us to
read and 7 us to write a state of one episode, where rosbags' CDR takes 55 and 15 without the records.
"""

import struct
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import layout
from vpsci_ros.wire.header import WireHeader, read_start, write_start
from vpsci_ros.wire.layout import WORLD
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import ENDED, EPISODE
from vpsci_ros.world.tick import Tick

_REST = struct.Struct("<dI")  # dt, length of the first sequence
_FRAME = -1  # in place of an offset in a record: `policy_frame` has none
FARTHEST = 1e8  # [m], [m/s], [rad]: nothing in a world is beyond
_MOTION = (
    *("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature"),
    *("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"),
)


class StateContent(NamedTuple):
    """The content of a serialized WorldState."""

    header: WireHeader  # also for the answers to it
    tick: Tick
    period: float  # [s] of a tick, unchecked


def read_world_state(data: bytes, where: str = WORLD, definition: str = "") -> StateContent:
    """Return the content of a serialized WorldState; values that no world can send are refused.

    :param where: the topic, which opens the error message.
    :param definition: of the type, where the bytes are of a bag, which holds it; empty: this package's.
    :raises InvalidInput: the bytes are not as ROS writes them or of another version, the sequences differ in length or
        are empty, an unknown status, or a quantity of `_MOTION` that is not finite or beyond `FARTHEST`.
    """
    if definition:
        _require_own(definition, where)
    names, sizes, places = _fields()
    header, number, at = read_start(data, where)
    if at + _REST.size > len(data):
        raise InvalidInput(f"{where}: {len(data)} bytes, which end before the first sequence of a WorldState")
    period, count = _REST.unpack_from(data, at)
    if count == 0:
        raise InvalidInput(f"{where}: expected at least one episode, got none; does another program publish it?")
    if count * int(sizes.sum()) > len(data):
        raise InvalidInput(f"{where}: {len(data)} bytes, too few for a WorldState of {count} episodes")
    octets, words = np.frombuffer(data, np.uint8), np.frombuffer(data, np.uint32, len(data) // 4)
    state, frame = np.zeros(count * EPISODE.itemsize, np.uint8), np.zeros(count, np.bool_)
    rows = state.reshape(count, EPISODE.itemsize)
    missing = _read(octets, words, at + _REST.size - 4, sizes, places, rows, rows.view(np.uint32), frame)
    if missing >= 0:
        raise InvalidInput(
            f"{where}: expected {count} entries in {names[missing]}, as in {names[0]}, got another number"
            "; are two graphs in one domain, or is the bag damaged?"
        )
    records = state.view(EPISODE)
    if not _in_range(records):  # at every tick, so one compiled look at all; this one finds out what is wrong
        _require_range(records, where)
    return StateContent(header, Tick(number, records, frame), period)


def write_world_state(world: StateContent) -> bytes:
    """Return the serialized WorldState with this content."""
    state, frame, count = world.tick.state, world.tick.policy_frame, len(world.tick.state)
    _, sizes, places = _fields()
    start = write_start(world.header, world.tick.number) + _REST.pack(world.period, count)
    # with room for lengths and padding
    words = np.zeros((len(start) + count * int(sizes.sum())) // 4 + 4 * len(sizes), np.uint32)
    data = words.view(np.uint8)
    data[: len(start)] = np.frombuffer(start, np.uint8)
    rows = state.view(np.uint8).reshape(count, EPISODE.itemsize)
    end = _write(data, words, len(start) - 4, sizes, places, rows, rows.view(np.uint32), frame)
    return data[:end].tobytes()


def warm_up() -> None:
    """Compile all kernels of this module, or load them, so that no tick waits for compilation."""
    tick = Tick(0, np.zeros(1, EPISODE), np.zeros(1, np.bool_))
    read_world_state(write_world_state(StateContent(WireHeader(0, 0, ""), tick, 1.0)))


@cache
def _fields() -> tuple[tuple[str, ...], NDArray[np.int64], NDArray[np.int64]]:
    """Return the sequences of a WorldState: names, bytes of a value, and offsets of the value in EPISODE records."""
    sequences = layout.sequences(layout.own_definition("WorldState"))
    offsets = {name: int(field[1]) for name, field in dict(EPISODE.fields or {}).items()}
    sizes = np.array([np.dtype(kind).itemsize for kind in sequences.values()])
    return tuple(sequences), sizes, np.array([offsets.get(name, _FRAME) for name in sequences])


@lru_cache(maxsize=16)
def _require_own(definition: str, where: str) -> None:
    """Refuse a definition of WorldState that has other sequences than this package's; `where` opens the message."""
    given, wanted = (layout.sequences(text) for text in (definition, layout.own_definition("WorldState")))
    if list(given.items()) != list(wanted.items()):
        odd = ", ".join(dict(sorted(given.items() ^ wanted.items()))) or "the order of its fields"
        raise InvalidInput(
            f"{where}: a WorldState of another version, which differs in {odd}; read it with the version of vpsci_ros "
            "that wrote it"
        )


def _require_range(state: NDArray[np.void], where: str) -> None:
    layout.require_codes(state["status"], ENDED, f"{where}: status")
    for name in _MOTION:
        bad = ~(np.abs(state[name]) <= FARTHEST)
        if bad.any():
            slot = int(np.argmax(bad))
            raise InvalidInput(
                f"{where}: {name} of slot {slot}: expected a number within {FARTHEST:g}, got {state[name][slot]}; "
                "does another program publish it?"
            )


@kernel
def _in_range(state):  # type: ignore[no-untyped-def]
    """Return whether status and `_MOTION` of EPISODE[B] are what a world can have; NaN is not."""
    for i in range(state.size):
        slot = state[i]
        if not (
            slot.status <= ENDED
            and abs(slot.vehicle_x) <= FARTHEST
            and abs(slot.vehicle_y) <= FARTHEST
            and abs(slot.vehicle_heading) <= FARTHEST
            and abs(slot.vehicle_speed) <= FARTHEST
            and abs(slot.vehicle_curvature) <= FARTHEST
            and abs(slot.pedestrian_x) <= FARTHEST
            and abs(slot.pedestrian_y) <= FARTHEST
            and abs(slot.pedestrian_vx) <= FARTHEST
            and abs(slot.pedestrian_vy) <= FARTHEST
        ):
            return False
    return True


@kernel
def _read(data, words, at, sizes, places, rows, row_words, frame):  # type: ignore[no-untyped-def]
    """Fill records from the sequences at offset `at`, one value a row; return the first missing one's index, or -1.

    :param data, words: the message, uint8[n] and uint32[n // 4]; rows, row_words: EPISODE[B] likewise, [B, ...].
    :param sizes, places: of each sequence, the bytes of a value and its offset in a record.
    """
    count = rows.shape[0]
    for f in range(sizes.size):
        size, place = sizes[f], places[f]
        at = (at + 3) // 4 * 4
        if at + 4 > data.size or words[at // 4] != count:
            return f
        at += 4
        if size == 8 and at % 8 == 0:
            at += 4  # since it counts from behind the 4 bytes of the encapsulation
        if at + size * count > data.size:
            return f
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
    return -1


@kernel
def _write(data, words, at, sizes, places, rows, row_words, frame):  # type: ignore[no-untyped-def]
    """Write records as sequences from offset `at` of `data` on, see `_read`; return the offset after the last one."""
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
