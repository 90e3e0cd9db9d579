"""Messages to arrays and back: the only place where the layout of a message is known.

Fields of the same name in a message and in a structured array correspond. Numeric sequences of a message are
`array.array`s, which numpy reads without a copy and which skip the element-wise checks of the message setters.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Quaternion
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from std_msgs.msg import Header

from vpsci_msgs.msg import AgentAction, EpisodeEvent, SafetyState, Transition, WorldState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.transitions import TRANSITION
from vpsci_ros.world import EPISODE, EVENT

Array = NDArray[Any]
MAP = "map"
_CODES = {"u1": "B", "u4": "I", "u8": "Q", "f4": "f", "f8": "d"}
_DTYPES = {code: np.dtype(kind) for kind, code in _CODES.items()}
_STATE_FIELDS = [name for name in WorldState.get_fields_and_field_types() if name in (EPISODE.names or ())]
_STATE_CODES = [(name, _CODES[EPISODE[name].str[1:]]) for name in _STATE_FIELDS]
_EVENT_FIELDS = [name for name in EpisodeEvent.get_fields_and_field_types() if name in (EVENT.names or ())]
_TRANSITION_FIELDS = [
    name
    for name, kind in Transition.get_fields_and_field_types().items()
    if kind.startswith("sequence<") and name in (TRANSITION.names or ())
]


def sequence(values: Array) -> array[Any]:
    """Return the values of an array, flattened in row-major order, as a message field takes them."""
    return array(_CODES[values.dtype.str[1:]], values.tobytes())


def values(field: array[Any]) -> Array:
    """Return a numeric message field as an array that shares its memory."""
    return np.frombuffer(field, dtype=_DTYPES[field.typecode])


def stamp(tick: int, period: float) -> Time:
    """Return the simulated time [s] of a tick of `period` seconds."""
    nanoseconds = tick * round(period * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def world_state_message(
    state: Array, policy_frame: Array, tick: int, period: float, into: WorldState | None = None
) -> WorldState:
    """Return EPISODE[B] records at `tick` as a message.

    :param into: a message to fill instead of a new one, for a publisher that keeps none: making one takes a third of
        the time.
    """
    message = into or WorldState()
    message.header = Header(stamp=stamp(tick, period), frame_id=MAP)
    message.tick, message.dt = tick, period
    for name, code in _STATE_CODES:
        setattr(message, name, array(code, state[name].tobytes()))
    message.policy_frame = array("B", policy_frame.tobytes())
    return message


def world_state_arrays(message: WorldState) -> tuple[Array, Array]:
    """Return the EPISODE[B] records that a message holds (fields it lacks are 0) and its policy frames (bool[B]).

    :raises InvalidInput: the arrays differ in length.
    """
    state = np.zeros(len(message.scenario), EPISODE)
    for name in _STATE_FIELDS:
        state[name] = checked(getattr(message, name), len(state), "/world/state", name)
    return state, checked(message.policy_frame, len(state), "/world/state", "policy_frame").astype(bool)


def safety_message(header: Header, tick: int, curvttc: Array, distance: Array, critical: Array) -> SafetyState:
    """Return CurvTTC [s], distance [m] (float64[B]) and critical (bool[B]) at `tick` as a SafetyState."""
    return SafetyState(
        header=header,
        tick=tick,
        curvttc=sequence(curvttc),
        distance=sequence(distance),
        critical=array("B", critical.tobytes()),
    )


def action_message(header: Header, tick: int, action: Array, policy_version: int) -> AgentAction:
    """Return accelerations [m/s2], [B, 2] as (longitudinal, lateral), as a message."""
    columns = action.astype(np.float64)
    return AgentAction(
        header=header,
        tick=tick,
        longitudinal=sequence(columns[:, 0]),
        lateral=sequence(columns[:, 1]),
        policy_version=policy_version,
    )


def action_array(message: AgentAction, batch: int, topic: str) -> Array:
    """Return the accelerations [m/s2] of a message as float64[B, 2].

    :raises InvalidInput: not one pair of finite numbers per episode.
    """
    along = checked(message.longitudinal, batch, topic, "longitudinal")
    action = np.stack([along, checked(message.lateral, batch, topic, "lateral")], axis=1)
    if not np.isfinite(action).all():
        slot = int(np.argwhere(~np.isfinite(action))[0, 0])
        raise InvalidInput(
            f"{topic}, tick {message.tick}: expected finite accelerations, got {action[slot]} in slot {slot}"
        )
    return action


def event_message(events: Array, tick: int, period: float) -> EpisodeEvent:
    """Return EVENT[n] records of one tick as a message."""
    message = EpisodeEvent(header=Header(stamp=stamp(tick, period), frame_id=MAP), tick=tick)
    for name in _EVENT_FIELDS:
        setattr(message, name, sequence(events[name]))
    return message


def transition_message(rows: Array, tick: int, period: float) -> Transition:
    """Return TRANSITION[n] records, n > 0, numbered without gaps, as a message."""
    message = Transition(
        header=Header(stamp=stamp(tick, period), frame_id=MAP),
        first_number=int(rows["number"][0]),
        vehicle_policy_version=int(rows["vehicle_policy_version"][-1]),
        pedestrian_policy_version=int(rows["pedestrian_policy_version"][-1]),
    )
    for name in _TRANSITION_FIELDS:
        setattr(message, name, sequence(rows[name]))
    return message


def transition_arrays(message: Transition) -> Array:
    """Return the TRANSITION[n] records that a message holds.

    :raises InvalidInput: the arrays differ in length.
    """
    rows = np.zeros(len(message.scenario), TRANSITION)
    for name in _TRANSITION_FIELDS:
        shape = rows[name].shape
        rows[name] = checked(getattr(message, name), rows[name].size, "/replay", name).reshape(shape)
    rows["number"] = message.first_number + np.arange(len(rows), dtype=np.uint64)
    rows["vehicle_policy_version"] = message.vehicle_policy_version
    rows["pedestrian_policy_version"] = message.pedestrian_policy_version
    return rows


def odometry_messages(record: np.void, header: Header) -> tuple[Odometry, Odometry]:
    """Return vehicle and pedestrian of one EPISODE record as odometry; twists are in the child frames (REP 105)."""
    vehicle = Odometry(header=header, child_frame_id="vehicle/base_link")
    pedestrian = Odometry(header=header, child_frame_id="pedestrian/base_link")
    vehicle.pose.pose.position = Point(x=float(record["vehicle_x"]), y=float(record["vehicle_y"]))
    vehicle.pose.pose.orientation = yaw_quaternion(float(record["vehicle_heading"]))
    vehicle.twist.twist.linear.x = float(record["vehicle_speed"])
    vehicle.twist.twist.angular.z = float(record["vehicle_speed"] * record["vehicle_curvature"])
    vx, vy = float(record["pedestrian_vx"]), float(record["pedestrian_vy"])
    pedestrian.pose.pose.position = Point(x=float(record["pedestrian_x"]), y=float(record["pedestrian_y"]))
    pedestrian.pose.pose.orientation = yaw_quaternion(float(np.arctan2(vy, vx)))
    pedestrian.twist.twist.linear.x = float(np.hypot(vx, vy))
    return vehicle, pedestrian


def yaw_quaternion(yaw: float) -> Quaternion:
    """Return the rotation by `yaw` [rad] about z."""
    return Quaternion(z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))


def diagnostics_message(node: str, text: str, pairs: Iterable[tuple[str, Any]], at: Time) -> DiagnosticArray:
    """Return the state of one node as a DiagnosticArray with level OK."""
    status = DiagnosticStatus(level=DiagnosticStatus.OK, name=node, message=text, hardware_id="vpsci_ros")
    status.values = [KeyValue(key=key, value=str(value)) for key, value in pairs]
    return DiagnosticArray(header=Header(stamp=at), status=[status])


def checked(field: array[Any], length: int, topic: str, name: str) -> Array:
    """Return a numeric message field as an array.

    :raises InvalidInput: it does not have `length` entries.
    """
    if len(field) != length:
        raise InvalidInput(
            f"{topic}: expected {length} entries in {name}, got {len(field)}; are two graphs in one domain?"
        )
    return values(field)
