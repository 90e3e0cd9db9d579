"""The layout of the node graph's messages, without ROS: their arrays, and the records made from them.

`msg_defs/` defines the messages. Fields of the same name in a message and in a structured array correspond. A message
here is any object with those fields: one of rclpy, whose sequences are `array.array`s, or one of `decode`, whose
sequences are numpy arrays. Functions `..._fields` return a message's fields by name, for those that write it.
"""

from __future__ import annotations

import math
from array import array
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import messages_dir
from vpsci_ros.world.state import EPISODE, EVENT, OUTCOME_NAMES, SAFE_STOP, STARTED
from vpsci_ros.world.tick import Assessment, Tick, has_nan
from vpsci_ros.world.transition import TRANSITION

Array = NDArray[Any]
MAP = "map"
WORLD, SAFETY, EVENTS = "/world/state", "/safety/state", "/episode/event"
TYPES = {
    WORLD: "vpsci_msgs/msg/WorldState",
    SAFETY: "vpsci_msgs/msg/SafetyState",
    "/vehicle/action": "vpsci_msgs/msg/AgentAction",
    "/pedestrian/action": "vpsci_msgs/msg/AgentAction",
    "/vehicle/odometry": "nav_msgs/msg/Odometry",
    "/pedestrian/odometry": "nav_msgs/msg/Odometry",
    "/pedestrians/odometry": "nav_msgs/msg/Odometry",
}
"""Topic -> type, of the bags that are written without ROS; `vpsci_ros.nodes.topics` lists all topics."""


@cache
def own_definition(message: str) -> str:
    """Return the text of the .msg file of a message of vpsci_msgs, such as "WorldState"."""
    return (messages_dir() / f"{message}.msg").read_text(encoding="utf-8")


def sequences(definition: str) -> dict[str, str]:
    """Return the sequences of numbers in a message definition, in its order: name -> type, such as "float64".

    :param definition: may be that of a bag, to which definitions of nested messages are appended after a line of "=".
    """
    lines = (line.partition("#")[0] for line in definition.partition("\n====")[0].splitlines())
    fields = [line.split()[:2] for line in lines if "[]" in line]
    return {name: kind.removesuffix("[]") for kind, name in fields}


def _shapes(message: str, record: np.dtype[Any]) -> dict[str, tuple[int, ...]]:
    """Return the shape in one record of each sequence of a message that is also a field of the record."""
    return {name: record[name].shape for name in sequences(own_definition(message)) if name in (record.names or ())}


_STATE = _shapes("WorldState", EPISODE)
_EVENT = _shapes("EpisodeEvent", EVENT)
_TRANSITION = _shapes("Transition", TRANSITION)
_AFTER = {name: _TRANSITION.pop(name) for name in tuple(_TRANSITION) if name.startswith("next_")}
"""Fields that a message has only for the last step of a history; earlier steps find them in the next transition."""
_DTYPES = {code: np.dtype(code) for code in "BIQfd"}
_VERSIONS = ("vehicle_policy_version", "pedestrian_policy_version")


def world_state_fields(state: Array, policy_frame: Array) -> dict[str, Array]:
    """Return the sequences of a WorldState of EPISODE[B] records; `policy_frame`, bool[B]: where policies may act."""
    return {name: state[name] for name in _STATE} | {"policy_frame": policy_frame.astype(np.uint8)}


def event_fields(events: Array) -> dict[str, Array]:
    """Return the sequences of an EpisodeEvent of EVENT[n] records."""
    return {name: events[name] for name in _EVENT}


def transition_fields(rows: Array) -> dict[str, Any]:
    """Return the fields of a Transition of TRANSITION[n] records, n > 0, numbered without gaps."""
    versions = {name: int(rows[name][-1]) for name in _VERSIONS}
    after = rows[rows["last"] != 0]
    fields = {name: rows[name] for name in _TRANSITION} | {name: after[name] for name in _AFTER}
    return fields | versions | {"first_number": int(rows["number"][0])}


class PlanarMotion(NamedTuple):
    """An agent's odometry in the plane, as `nav_msgs/Odometry` has it: the twist is in the child frame (REP 105)."""

    x: float  # [m]
    y: float  # [m]
    yaw: float  # [rad] of a pedestrian: of its velocity
    speed: float  # [m/s]
    yaw_rate: float  # [rad/s]

    @property
    def quaternion(self) -> tuple[float, float]:
        """Z and w of the rotation by `yaw` about z."""
        return float(np.sin(self.yaw / 2)), float(np.cos(self.yaw / 2))


def motion_of(record: np.void, agent: str) -> PlanarMotion:
    """Return the motion of "vehicle" or "pedestrian" in an EPISODE record."""
    x, y = float(record[f"{agent}_x"]), float(record[f"{agent}_y"])
    if agent == "vehicle":
        speed = record["vehicle_speed"]
        yaw, yaw_rate = float(record["vehicle_heading"]), float(speed * record["vehicle_curvature"])
        return PlanarMotion(x, y, yaw, float(speed), yaw_rate)
    vx, vy = float(record["pedestrian_vx"]), float(record["pedestrian_vy"])
    return PlanarMotion(x, y, float(np.arctan2(vy, vx)), float(np.hypot(vx, vy)), 0.0)


def values(field: array[Any] | Array) -> Array:
    """Return a numeric field of a message as a numpy array that shares the field's memory."""
    return field if isinstance(field, np.ndarray) else np.frombuffer(field, _DTYPES[field.typecode])


def checked(field: array[Any] | Array, length: int, where: str, name: str) -> Array:
    """Return a numeric field of a message as a numpy array of `length` entries.

    :raises InvalidInput: it does not have `length` entries.
    """
    if len(field) != length:
        raise InvalidInput(
            f"{where}: expected {length} entries in {name}, got {len(field)}; are two graphs in one domain, or is the "
            "bag damaged?"
        )
    return values(field)


def safety_state(message: Any, batch: int, where: str = SAFETY) -> tuple[Array, Array, Array]:
    """Return CurvTTC [s] and distance [m], float64[B], and critical, uint8[B], of a SafetyState.

    :raises InvalidInput: not one of each per episode, or a CurvTTC or a distance that is not a number.
    """
    curvttc, distance, critical = (
        checked(getattr(message, name), batch, where, name) for name in ("curvttc", "distance", "critical")
    )
    for name, numbers in (("curvttc", curvttc), ("distance", distance)):
        if has_nan(numbers):
            slot = int(np.argmax(np.isnan(numbers)))
            raise InvalidInput(f"{where}: {name} of slot {slot} is not a number; does another program publish it?")
    return curvttc, distance, critical


def assessment(message: Any, tick: Tick) -> Assessment:
    """Return the assessment of a tick from a SafetyState; errors as `safety_state`."""
    return tick.assessed(*safety_state(message, len(tick.state)))


def action(message: Any, batch: int, where: str) -> Array:
    """Return the accelerations [m/s2] of an AgentAction, longitudinal and lateral, as float64[B, 2].

    :raises InvalidInput: not one pair of numbers per slot.
    """
    pairs = np.empty((batch, 2))
    for column, name in enumerate(("longitudinal", "lateral")):
        pairs[:, column] = checked(getattr(message, name), batch, where, name)
    return pairs


def events(message: Any, where: str = EVENTS) -> Array:
    """Return the EVENT[n] records of an EpisodeEvent.

    :raises InvalidInput: the arrays differ in length, or one is missing, or an unknown kind or outcome.
    """
    rows = _records(message, _EVENT, np.zeros(len(getattr(message, "kind", ())), EVENT), where)
    require_codes(rows["kind"], SAFE_STOP, f"{where}: kind", least=STARTED)
    require_codes(rows["outcome"], len(OUTCOME_NAMES) - 1, f"{where}: outcome")
    return rows


def transitions(message: Any, where: str = "/replay") -> Array:
    """Return the TRANSITION[n] records of a Transition.

    :raises InvalidInput: the arrays differ in length, or one is missing.
    """
    rows = _records(message, _TRANSITION, np.zeros(len(getattr(message, "scenario", ())), TRANSITION), where)
    last = rows["last"] != 0
    rows[last] = _records(message, _AFTER, rows[last], where)
    rows["number"] = message.first_number + np.arange(len(rows), dtype=np.uint64)
    for name in _VERSIONS:
        rows[name] = getattr(message, name)
    return rows


def _records(message: Any, shapes: dict[str, tuple[int, ...]], into: Array, where: str) -> Array:
    """Fill records' fields, by name -> shape in one record, from the sequences of a message; return the records.

    :raises InvalidInput: a sequence is missing, or has another length than the records need.
    """
    for name, shape in shapes.items():
        field = getattr(message, name, None)
        if field is None:
            raise InvalidInput(f"{where} has no field {name}; it is of another version")
        into[name] = checked(field, len(into) * math.prod(shape), where, name).reshape(-1, *shape)
    return into


def require_codes(codes: NDArray[np.uint8], most: int, where: str, least: int = 0) -> None:
    """Refuse codes that are not from `least` to `most`; `where` opens the error message."""
    bad = (codes < least) | (codes > most)
    if bad.any():
        raise InvalidInput(
            f"{where}: expected codes from {least} to {most}, got {int(codes[bad][0])}; "
            "does another program publish it?"
        )
