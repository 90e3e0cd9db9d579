"""Conversion of arrays to ROS messages; `vpsci_ros.wire.layout` defines their content.

Numeric sequences of a message are `array.array`s, which skip the element-wise checks of the message setters.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from vpsci_msgs.msg import Transition
from vpsci_ros.documents import parse_json, require_form
from vpsci_ros.nodes.node_config import section_classes
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.parameters import pick
from vpsci_ros.wire import layout
from vpsci_ros.wire.header import tick_header
from vpsci_ros.wire.layout import MAP
from vpsci_ros.world.kinematics import WHEELBASE

Array = NDArray[Any]
T = TypeVar("T")
_CODES = {np.dtype(kind).char: code for kind, code in (("u1", "B"), ("u4", "I"), ("u8", "Q"), ("f4", "f"), ("f8", "d"))}

PARAMETERS = "parameters"  # key of a node's parameters in its report

_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "vx", "vy")] + [("id", "<u4")])
_POINT_FIELDS = [
    PointField(name=name, offset=4 * k, datatype=PointField.UINT32 if name == "id" else PointField.FLOAT32, count=1)
    for k, name in enumerate(_POINT.names or ())
]


def sequence(values: Array) -> array[Any]:
    """Return an array of u1, u4, u8, f4 or f8 as a flat `array.array` in row-major order, for a message's sequence."""
    return array(_CODES[values.dtype.char], values.tobytes())


def filled(message: T, fields: Mapping[str, Any]) -> T:
    """Set these fields of `message` and return it; NumPy arrays become `array.array`s."""
    for name, value in fields.items():
        setattr(message, name, sequence(value) if isinstance(value, np.ndarray) else value)
    return message


def stamp(tick: int, period: float) -> Time:
    """Return the simulated time of a tick of `period` seconds as a ROS time."""
    header = tick_header(tick, period)
    return Time(sec=header.seconds, nanosec=header.nanoseconds)


def transition_message(rows: Array, tick: int, period: float) -> Transition:
    """Return TRANSITION[n] records, n > 0, numbered without gaps, as a message."""
    header = Header(stamp=stamp(tick, period), frame_id=MAP)
    return filled(Transition(header=header), layout.transition_fields(rows))


def objects_message(objects: Array, at: Time) -> PointCloud2:
    """Return OBJECT[n], objects of `vpsci_ros.world.perception` seen at `at`, as a PointCloud2 of n points.

    A point has its place [m] (z: 0) and velocity [m/s] in the map, and the number of its track.
    """
    points = np.zeros(len(objects), _POINT)
    for name, source in (("x", "x"), ("y", "y"), ("vx", "vx"), ("vy", "vy"), ("id", "track")):
        points[name] = objects[source]
    size = {"height": 1, "width": len(points), "point_step": _POINT.itemsize, "row_step": points.nbytes}
    cloud = PointCloud2(header=Header(stamp=at, frame_id=MAP), fields=_POINT_FIELDS, is_dense=True, **size)
    cloud.data.frombytes(points.tobytes())
    return cloud


def fixed_transforms(prefix: str = "") -> TFMessage:
    """Return the static transform from the vehicle's base_link to its rear axle, which other tools use as origin."""
    header = Header(frame_id=f"{prefix}vehicle/base_link")
    axle = TransformStamped(header=header, child_frame_id=f"{prefix}vehicle/rear_axle")
    axle.transform.translation.x = -0.5 * WHEELBASE
    axle.transform.rotation.w = 1.0
    return TFMessage(transforms=[axle])


def diagnostics_message(
    node: str, reported: NodeStatus, at: Time, parameters: Mapping[str, Any] | None = None
) -> DiagnosticArray:
    """Return a node's report: ERROR if it refused messages or found a second publisher, WARN if it waits, else OK.

    :param parameters: of the node, which `parameters_in` finds in the message.
    """
    wrong, waits = reported.refused or reported.second_publishers, reported.awaited or reported.state == "waiting"
    level = DiagnosticStatus.ERROR if wrong else DiagnosticStatus.WARN if waits else DiagnosticStatus.OK
    status = DiagnosticStatus(level=level, name=node, message=reported.state, hardware_id="vpsci_ros")
    pairs = reported.pairs() | ({} if parameters is None else {PARAMETERS: json.dumps(dict(parameters))})
    status.values = [KeyValue(key=key, value=str(value)) for key, value in pairs.items()]
    return DiagnosticArray(header=Header(stamp=at), status=[status])


def parameters_in(message: Any, nodes: Collection[str], prefix: str) -> dict[str, dict[str, Any]]:
    """Return node -> parameters, for those of `nodes` whose parameters a DiagnosticArray has.

    :param prefix: of the names of the graph's nodes, such as "left/", or nothing.
    :raises InvalidInput: they are no parameters of these nodes.
    """
    found: dict[str, dict[str, Any]] = {}
    wanted = {f"{prefix}{node}": node for node in nodes}
    for status in message.status:
        values = {pair.key: pair.value for pair in status.values}
        if status.name in wanted and PARAMETERS in values:
            node, where = wanted[status.name], f"/diagnostics: parameters of {status.name}"
            given = parse_json(values[PARAMETERS], where)
            require_form(given, dict, where)
            for kind in section_classes(node, given):
                pick(kind, given, where)
            found[node] = given
    return found
