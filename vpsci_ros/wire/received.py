"""What comes from a topic, checked before a node acts on it: any program in the ROS domain may publish there.

A message that the graph's own nodes cannot have sent is refused (`InvalidInput`); the subscriber counts it and goes on.
What they could have sent is accepted: a message does not say who sent it.
"""

import struct
from typing import Any

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import layout
from vpsci_ros.wire.header import aligned
from vpsci_ros.wire.layout import WORLD
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import ENDED
from vpsci_ros.world.tick import Tick

_SEQUENCES = ("/markers", "/tf", "/tf_static")  # topics of messages that are sequences
_LENGTH = struct.Struct("<I")
_TRANSFORM = 56  # [bytes] of its numbers
FARTHEST = 1e8  # [m], [m/s], [rad]: nothing in a world is beyond
_MOTION = (
    *("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature"),
    *("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"),
)


def world_state(message: Any, where: str = WORLD) -> Tick:
    """Return the tick of a WorldState.

    :raises InvalidInput: as `layout.world_state` and `credible`.
    """
    return credible(layout.world_state(message, where), where)


def credible(tick: Tick, where: str = WORLD) -> Tick:
    """Return a tick of EPISODE[B] that a world can have sent.

    :raises InvalidInput: no episode, an unknown status, or a number that is not finite or beyond `FARTHEST`.
    """
    if len(tick.state) == 0:
        raise InvalidInput(f"{where}: expected at least one episode, got none; does another program publish it?")
    if not in_range(tick.state):  # at every tick, so one compiled look at all; this one finds out what is wrong
        layout.require_codes(tick.state["status"], ENDED, f"{where}: status")
        for name in _MOTION:
            bad = ~(np.abs(tick.state[name]) <= FARTHEST)
            if bad.any():
                slot = int(np.argmax(bad))
                raise InvalidInput(
                    f"{where}: {name} of slot {slot}: expected a number within {FARTHEST:g}, got "
                    f"{tick.state[name][slot]}; does another program publish it?"
                )
    return tick


@kernel
def in_range(state):  # type: ignore[no-untyped-def]
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


def stamp(topic: str, data: bytes) -> int:
    """Return the stamp [ns] of a serialized message of any recorded topic.

    Every recorded type begins with its stamp, after CDR's 4 bytes; in a sequence its length comes first.

    :raises InvalidInput: the message is too short to have one, or it is none: negative, or of more than a second's
        nanoseconds.
    """
    end = 16 if topic in _SEQUENCES else 12
    if len(data) < end:
        raise InvalidInput(f"{topic}: expected a message of at least {end} bytes with a stamp, got {len(data)}")
    seconds, nanoseconds = struct.unpack_from("<iI", data, end - 8)
    if seconds < 0 or nanoseconds >= 1_000_000_000:
        raise InvalidInput(
            f"{topic}: expected a stamp from 0 s on, got {seconds} s and {nanoseconds} ns; "
            "does another program publish it?"
        )
    return int(seconds * 1_000_000_000 + nanoseconds)


def child_frames(data: bytes, where: str) -> list[str]:
    """Return the child frames of a serialized TFMessage.

    :raises InvalidInput: it is none.
    """
    frames, at = [], 8
    try:
        for _ in range(_LENGTH.unpack_from(data, 4)[0]):
            for ahead in (8, 0):  # behind the stamp the frame, behind that the child frame
                at = aligned(at, 4) + ahead
                begin = at + 4
                at = begin + _LENGTH.unpack_from(data, at)[0]
            frames.append(str(data[begin : at - 1], "utf-8"))
            at = aligned(at, 8) + _TRANSFORM
            if at > len(data):
                break
    except (struct.error, UnicodeDecodeError):
        at = len(data) + 1
    if at > len(data):
        raise InvalidInput(f"{where}: {len(data)} bytes that are no TFMessage")
    return frames
