"""Messages of the lock-step come as bytes, which `vpsci_ros.wire` reads without making message objects.

Bytes of a layout that it does not know, from another implementation of DDS, the middleware turns into a message.
"""

from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message

from vpsci_msgs.msg import AgentAction, SafetyState, WorldState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import received, world_state
from vpsci_ros.wire.answers import SerializedAction, SerializedSafety, read_action, read_safety_state
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.layout import SAFETY, WORLD
from vpsci_ros.wire.world_state import SerializedState
from vpsci_ros.world.state import EPISODE
from vpsci_ros.world.tick import Tick


def shown(message: WorldState | bytes, where: str = WORLD) -> SerializedState:
    """Return what a WorldState says.

    :raises InvalidInput: it is none, or as `vpsci_ros.wire.received.world_state`.
    """
    if isinstance(message, bytes):
        state = world_state.read_world_state(message)
        if state is not None:
            received.credible(state.tick, where)
            return state
        message = message_of(message, WorldState, where)
    stamp = message.header.stamp
    header = WireHeader(stamp.sec, stamp.nanosec, message.header.frame_id)
    return SerializedState(header, received.world_state(message, where), message.dt)


def safety_state(message: SafetyState | bytes, where: str = SAFETY) -> SafetyState | SerializedSafety:
    """Return a SafetyState; its fields are not checked yet.

    :raises InvalidInput: it is none.
    """
    if not isinstance(message, bytes):
        return message
    return read_safety_state(message) or message_of(message, SafetyState, where)


def action(message: AgentAction | bytes, where: str) -> AgentAction | SerializedAction:
    """Return an AgentAction; its fields are not checked yet.

    :raises InvalidInput: it is none.
    """
    if not isinstance(message, bytes):
        return message
    return read_action(message) or message_of(message, AgentAction, where)


def time_of(header: WireHeader) -> Time:
    """Return the stamp of a header."""
    return Time(sec=header.seconds, nanosec=header.nanoseconds)


def message_of(data: bytes, kind: Any, where: str) -> Any:
    """Return the message that bytes are.

    :raises InvalidInput: they are no such message.
    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # noqa: BLE001  the middleware raises errors of several kinds
        raise InvalidInput(f"{where}: {len(data)} bytes that are no {kind.__name__}: {error}") from None


def warm_up() -> None:
    """Have what reads and checks a state compiled (or loaded), so that no tick waits for it."""
    world_state.warm_up()
    received.credible(Tick(0, np.zeros(1, EPISODE), np.zeros(1, np.bool_)))
