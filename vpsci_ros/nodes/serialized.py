"""Messages of the lock-step come as bytes, which `vpsci_ros.wire` reads without making message objects.

Bytes of a layout that it does not know, from another implementation of DDS, the middleware turns into a message.
"""

from collections.abc import Callable
from operator import is_
from typing import Any, TypeVar

import numpy as np
from rclpy.serialization import deserialize_message

from vpsci_msgs.msg import AgentAction, SafetyState, WorldState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.exchange import Outgoing
from vpsci_ros.wire import layout, received, world_state
from vpsci_ros.wire.answers import SerializedAction, SerializedSafety, read_action, read_safety_state
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.layout import SAFETY, WORLD
from vpsci_ros.wire.world_state import SerializedState
from vpsci_ros.world.state import EPISODE
from vpsci_ros.world.tick import Assessment, Tick

T = TypeVar("T")
_latest: dict[object, tuple[tuple[object, ...], Any]] = {}
"""What was read last, by kind: from which objects, and what it is. Nodes of one process get the same objects."""


def shown(message: WorldState | bytes | Outgoing, where: str = WORLD) -> SerializedState:
    """Return what a WorldState says.

    :raises InvalidInput: it is none, or as `vpsci_ros.wire.received.world_state`.
    """
    if isinstance(message, Outgoing):
        return _once("state", _credible, message.value)
    if isinstance(message, bytes):
        return _once("state", lambda data: _shown_in(data, where), message)
    return _shown(message, where)


def _shown_in(data: bytes, where: str) -> SerializedState:
    state = world_state.read_world_state(data)
    if state is None:
        return _shown(message_of(data, WorldState, where), where)
    return _credible(state, where)


def _credible(state: SerializedState, where: str = WORLD) -> SerializedState:
    received.credible(state.tick, where)
    return state


def _shown(message: WorldState, where: str) -> SerializedState:
    stamp = message.header.stamp
    header = WireHeader(stamp.sec, stamp.nanosec, message.header.frame_id)
    return SerializedState(header, received.world_state(message, where), message.dt)


def safety_state(message: SafetyState | bytes | Outgoing, where: str = SAFETY) -> SafetyState | SerializedSafety:
    """Return a SafetyState; its fields are not checked yet.

    :raises InvalidInput: it is none.
    """
    if not isinstance(message, bytes):
        return message.value if isinstance(message, Outgoing) else message
    return _once("safety", lambda data: read_safety_state(data) or message_of(data, SafetyState, where), message)


def action(message: AgentAction | bytes | Outgoing, where: str) -> AgentAction | SerializedAction:
    """Return an AgentAction; its fields are not checked yet.

    :raises InvalidInput: it is none.
    """
    if not isinstance(message, bytes):
        return message.value if isinstance(message, Outgoing) else message
    return _once("action", lambda data: read_action(data) or message_of(data, AgentAction, where), message)


def checked_safety_state(safety: SafetyState | SerializedSafety, batch: int) -> bool:
    """Return True for a SafetyState of so many episodes.

    :raises InvalidInput: as `vpsci_ros.wire.layout.safety_state`.
    """
    return _once(("checked", batch), lambda given: bool(layout.safety_state(given, batch)), safety)


def assessment(safety: SafetyState | SerializedSafety, tick: Tick) -> Assessment:
    """Return what a SafetyState says of a tick, as `vpsci_ros.wire.layout.assessment`."""
    return _once("assessment", layout.assessment, safety, tick)


def _once(kind: object, read: Callable[..., T], *given: object) -> T:
    """Return what `read` makes of objects; nodes that give the same ones get the same result, which none changes."""
    latest = _latest.get(kind)
    if latest is None or not all(map(is_, latest[0], given)):
        _latest[kind] = latest = given, read(*given)
    found: T = latest[1]
    return found


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
