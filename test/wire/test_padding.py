"""What a serialized message leaves out between its fields is zero in a bag: exactly those bytes, and no other."""

from typing import Any

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import known_types
from vpsci_ros.wire.padding import zeroed

TYPES = known_types()


def made(kind: str, rng: np.random.Generator) -> Any:
    """Return a message of a type with random numbers, and strings and sequences of random length."""
    return TYPES.types[kind](**{name: value(about, rng) for name, about in TYPES.fielddefs[kind][1]})


def value(about: Any, rng: np.random.Generator) -> Any:
    node, inside = about
    if node == 2:
        return made(inside, rng)
    if node == 1:
        return scalar(inside[0], rng)
    inner, length = inside
    count = length if node == 3 else int(rng.integers(0, 4))
    if inner[0] == 1 and inner[1][0] != "string":
        return np.array(
            [scalar(inner[1][0], rng) for _ in range(count)], {"bool": "?", "byte": "u1"}.get(inner[1][0], inner[1][0])
        )
    return [value(inner, rng) for _ in range(count)]


def scalar(kind: str, rng: np.random.Generator) -> Any:
    if kind == "string":
        return "x" * int(rng.integers(0, 9))
    if kind == "bool":
        return bool(rng.integers(0, 2))
    return float(rng.integers(1, 99)) if kind.startswith("float") else int(rng.integers(1, 99))


KINDS = [
    *("vpsci_msgs/msg/WorldState", "vpsci_msgs/msg/EpisodeEvent", "vpsci_msgs/msg/Transition"),
    *("nav_msgs/msg/Odometry", "visualization_msgs/msg/MarkerArray", "diagnostic_msgs/msg/DiagnosticArray"),
    *("rosgraph_msgs/msg/Clock", "geometry_msgs/msg/AccelStamped", "tf2_msgs/msg/TFMessage"),
]
NEVER_PADDED = ("rosgraph_msgs/msg/Clock", "vpsci_msgs/msg/Transition")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_exactly_the_bytes_that_say_nothing_become_zero(kind: str, seed: int) -> None:
    clean = bytes(TYPES.serialize_cdr(made(kind, np.random.default_rng(seed)), kind))
    assert zeroed(kind, clean, "/topic") == clean
    silent = 0
    for at in range(4, len(clean)):
        dirty = bytearray(clean)
        dirty[at] ^= 0xFF
        try:
            says_nothing = bytes(TYPES.serialize_cdr(TYPES.deserialize_cdr(bytes(dirty), kind), kind)) == clean
        except Exception:  # noqa: BLE001 - whatever a decoder makes of an impossible length
            says_nothing = False
        if says_nothing and clean[at] == 0:  # any other byte but 0 is true as well
            assert zeroed(kind, bytes(dirty), "/topic") == clean, f"byte {at}"
            silent += 1
    assert silent or kind in NEVER_PADDED


def test_bytes_behind_the_last_field_become_zero_too() -> None:
    clean = bytes(TYPES.serialize_cdr(made("std_msgs/msg/String", np.random.default_rng(1)), "std_msgs/msg/String"))
    assert zeroed("std_msgs/msg/String", clean + b"\xaa\xbb", "/topic") == clean + b"\0\0"


def test_a_message_that_is_shorter_than_it_says_is_refused_at_once() -> None:
    kind = "visualization_msgs/msg/MarkerArray"
    with pytest.raises(InvalidInput, match=f"/markers: expected a {kind} of"):
        zeroed(kind, b"\0\1\0\0\xff\xff\xff\xff", "/markers")
    with pytest.raises(InvalidInput, match="little-endian CDR, got a message that begins with 0000"):
        zeroed(kind, b"\0\0\0\0\0\0\0\0", "/markers")
