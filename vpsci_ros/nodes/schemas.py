"""Definitions and hashes of the message types, as bags embed them."""

from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

import vpsci_msgs
from vpsci_ros.errors import VpsciError


@cache
def typestore() -> Typestore:
    """Return ROS 2's message types together with those of `vpsci_msgs`, read from where the package is installed.

    :raises VpsciError: the .msg files are not installed beside the Python package.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for prefix in Path(vpsci_msgs.__file__).parents:
        folder = prefix / "share" / "vpsci_msgs" / "msg"
        if folder.is_dir():
            for path in sorted(folder.glob("*.msg")):
                store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"vpsci_msgs/msg/{path.stem}"))
            return store
    raise VpsciError(f"{vpsci_msgs.__file__}: no share/vpsci_msgs/msg above it; build vpsci_msgs again (make setup)")


def describe(message_class: Any) -> tuple[str, str, str]:
    """Return (type name, definition with all types it needs, RIHS01 hash) of a message class."""
    package = message_class.__module__.split(".")[0]
    name = f"{package}/msg/{message_class.__name__}"
    definition, _ = typestore().generate_msgdef(name, ros_version=2)
    return name, definition, typestore().hash_rihs01(name)
