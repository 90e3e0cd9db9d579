"""Conversion of serialized messages to objects, by the definitions in the bag, or else of ROS 2 and vpsci_msgs."""

from functools import cache, lru_cache
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import messages_dir


class RawMessage(NamedTuple):
    """A serialized message with its topic, type, definition and log time.

    :ivar type: "vpsci_msgs/msg/WorldState".
    :ivar encoding: of `data`; "cdr" is what ROS 2 writes.
    :ivar definition, form: the type's definition and its language ("ros2msg"), both empty where the file has none.
    :ivar time: log time [ns].
    """

    topic: str
    type: str
    encoding: str
    definition: str
    form: str
    time: int
    data: bytes


def decode(raw: RawMessage, where: object) -> Any:
    """Return a message as an object whose numeric sequences are arrays; `where` opens the error messages.

    :raises InvalidInput: another encoding than CDR, or a definition or message that cannot be read.
    """
    require_cdr(raw, where)
    if raw.form != "ros2msg" and raw.type not in known_types().fielddefs:
        raise InvalidInput(
            f"{where}: no definition of {raw.type} ({raw.topic}) in the bag, and none is known; record with"
            " --storage mcap, which stores definitions"
        )
    try:
        types = _defined(raw.type, raw.definition) if raw.form == "ros2msg" else known_types()
        return types.deserialize_cdr(raw.data, raw.type)
    except Exception as error:  # noqa: BLE001  rosbags raises errors of many types
        raise InvalidInput(f"{where}: {raw.type} at {raw.time} ns on {raw.topic} is not readable: {error}") from None


@lru_cache(maxsize=64)
def _defined(kind: str, definition: str) -> Typestore:
    """Return the types that the definition of a type in a bag defines."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, kind))
    return store


def require_cdr(raw: RawMessage, where: object) -> None:
    """Refuse a message whose encoding is not CDR, that of ROS 2; `where` opens the error message."""
    if raw.encoding != "cdr":
        raise InvalidInput(
            f"{where}: {raw.topic} holds {raw.encoding} described by {raw.form or 'nothing'}; expected ROS 2's cdr"
        )


def parsed(kind: str, data: bytes, where: str) -> Any:
    """Return the message object of serialized `data` of a type such as "nav_msgs/msg/Odometry".

    :raises InvalidInput: the bytes are no such message.
    """
    try:
        return known_types().deserialize_cdr(data, kind)
    except Exception as error:  # noqa: BLE001  rosbags raises errors of many types
        raise InvalidInput(f"{where}: {len(data)} bytes that are no {kind}: {error}") from None


def rewritten(kind: str, data: bytes, where: str) -> tuple[Any, bytes]:
    """Return the message object of serialized `data`, and its bytes serialized again; see `parsed`.

    A serializer skips the gaps between fields, so that what lay in the memory there goes over the wire; here they are
    zero, and the same message is the same bytes.

    :raises InvalidInput: the bytes are no such message.
    """
    message = parsed(kind, data, where)
    return message, bytes(known_types().serialize_cdr(message, kind))


@cache
def known_types() -> Typestore:
    """Return the types of ROS 2 Jazzy and of vpsci_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(messages_dir().glob("*.msg")):
        store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"vpsci_msgs/msg/{path.stem}"))
    return store


def describe(kind: str) -> tuple[str, str]:
    """Return the definition of a type such as "nav_msgs/msg/Odometry", with the types in it, and its RIHS01 hash."""
    return known_types().generate_msgdef(kind, ros_version=2)[0], known_types().hash_rihs01(kind)
