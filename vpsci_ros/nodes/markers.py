"""The world as RViz and Foxglove draw it: lane and crosswalk, the vehicle's box, the pedestrians' cylinders.

Little of the markers changes from tick to tick, so each scene is serialized once, of an example, and then the changing
numbers alone are written: markers as objects of Python take 290 us a tick, as long as the rest of the world.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from vpsci_ros.nodes.convert import yaw_quaternion
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.header import WireHeader, whole_words
from vpsci_ros.wire.layout import MAP, PlanarMotion
from vpsci_ros.world import IDLE, RUNNING, Scenario
from vpsci_ros.world.state import EPISODE

MARK = Time(sec=0x5A17_5A17, nanosec=0x1A5C_1A5C)  # the stamp of a message that becomes a template
_HEADER = Header(stamp=MARK, frame_id=MAP)
_STAMP, _NUMBER = struct.Struct("<iI"), struct.Struct("<d")
_MOVING = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")
VEHICLE_HEIGHT, PEDESTRIAN_HEIGHT = 1.44, 1.75  # [m] of the Model 3 and of a person
_GREY, _WHITE = ColorRGBA(r=0.6, g=0.6, b=0.6, a=1.0), ColorRGBA(r=0.95, g=0.95, b=0.95, a=1.0)
_BLUE, _RED = ColorRGBA(r=0.2, g=0.5, b=0.8, a=1.0), ColorRGBA(r=0.85, g=0.2, b=0.15, a=1.0)


def scene_markers(state: NDArray[np.void], scenarios: Mapping[int, Scenario], header: Header) -> MarkerArray:
    """Return the EPISODE[B] records of one episode and the ground under it as markers; without one, a clear scene."""
    record = state[0]
    if record["status"] == IDLE:
        return MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    scenario = scenarios[int(record["scenario"])]
    lane = _line(header, 0, scenario.vehicle.path.points, scenario.vehicle.lane_width, _GREY)
    crossing = _line(header, 1, [*scenario.crosswalk, *scenario.crosswalk[:1]], 0.15, _WHITE)
    vehicle = _solid(header, 2, Marker.CUBE, (VEHICLE_LENGTH, VEHICLE_WIDTH, VEHICLE_HEIGHT), _BLUE)
    _place(vehicle, record["vehicle_x"], record["vehicle_y"], record["vehicle_heading"])
    people = [_pedestrian(header, 3 + n, row) for n, row in enumerate(state)]
    most = max(len(each.parked) for each in scenarios.values())
    parked = [_parked(header, 3 + len(people) + k, *scenario.parked[k : k + 1]) for k in range(most)]
    return MarkerArray(markers=[lane, crossing, vehicle, *people, *parked])


def _pedestrian(header: Header, number: int, record: np.void) -> Marker:
    """Return a pedestrian's cylinder, or, where an episode has fewer of them, a marker that deletes the last one's."""
    size = (2 * PEDESTRIAN_RADIUS, 2 * PEDESTRIAN_RADIUS, PEDESTRIAN_HEIGHT)
    pedestrian = _solid(header, number, Marker.CYLINDER, size, _RED)
    if record["status"] == IDLE:
        pedestrian.action = Marker.DELETE
    _place(pedestrian, record["pedestrian_x"], record["pedestrian_y"], 0.0)
    return pedestrian


def _parked(header: Header, number: int, box: NDArray[np.float64] | None = None) -> Marker:
    """Return a parked vehicle (x, y, heading, length, width); without one, what clears the place of another scene's."""
    if box is None:
        return Marker(header=header, ns="world", id=number, action=Marker.DELETE)
    marker = _solid(header, number, Marker.CUBE, (float(box[3]), float(box[4]), VEHICLE_HEIGHT), _GREY)
    _place(marker, *box[:3])
    return marker


def _solid(header: Header, number: int, kind: int, size: tuple[float, float, float], colour: ColorRGBA) -> Marker:
    scale = Vector3(x=size[0], y=size[1], z=size[2])
    marker = Marker(header=header, ns="world", id=number, type=kind, action=Marker.ADD, scale=scale, color=colour)
    marker.pose.position.z = size[2] / 2
    return marker


def _place(marker: Marker, x: Any, y: Any, heading: Any) -> None:
    marker.pose.position.x, marker.pose.position.y = float(x), float(y)
    marker.pose.orientation = yaw_quaternion(float(heading))


def _line(header: Header, number: int, points: Iterable[Any], width: float, colour: ColorRGBA) -> Marker:
    scale = Vector3(x=width)
    marker = Marker(
        header=header, ns="world", id=number, type=Marker.LINE_STRIP, action=Marker.ADD, scale=scale, color=colour
    )
    marker.pose.orientation.w = 1.0
    marker.points = [Point(x=float(x), y=float(y), z=-0.01) for x, y in points]
    return marker


class SceneMarkers:
    """The markers of one episode at a time.

    :param scenarios: by number, all that may come.
    """

    def __init__(self, scenarios: Mapping[int, Scenario]) -> None:
        self._scenarios = scenarios
        self._templates: dict[tuple[int, bytes], Template] = {}

    def written(self, state: NDArray[np.void], movers: Sequence[PlanarMotion], header: WireHeader) -> bytes:
        """Return the serialized MarkerArray of EPISODE[B] records; `movers`: the vehicle and each pedestrian."""
        idle = state["status"] == IDLE
        key = int(state["scenario"][0]), idle.tobytes()
        if key not in self._templates:
            self._templates[key] = self._scene(key[0], idle)
        vehicle, *people = movers
        changing = [vehicle.x, vehicle.y, *vehicle.quaternion, *(number for each in people for number in each[:2])]
        return self._templates[key].filled(header, [] if idle[0] else changing)

    def _scene(self, scenario: int, idle: NDArray[np.bool_]) -> "Template":
        example = np.zeros(len(idle), EPISODE)
        example["scenario"], example["status"] = scenario, np.where(idle, IDLE, RUNNING)
        for k, name in enumerate(_MOVING):
            example[name] = 0.7182818284590452 + 0.1 * k + np.arange(len(idle)) / 3.0
        message = scene_markers(example, self._scenarios, _HEADER)
        numbers: list[float] = []
        if not idle[0]:
            first = example[0]
            x, y, yaw = (float(first[name]) for name in _MOVING[:3])
            numbers = [x, y, *PlanarMotion(x, y, yaw, 0.0, 0.0).quaternion]
            for record in example:
                numbers += float(record["pedestrian_x"]), float(record["pedestrian_y"])
        return Template("visualization_msgs/msg/MarkerArray", message, numbers)


class Template:
    """A serialized message to be filled with another stamp, wherever it has `MARK`, and other numbers.

    :param kind: its type, such as "nav_msgs/msg/Odometry".
    :param message: an example.
    :param numbers: float64 numbers of the example that change, such as nothing else in it has.
    """

    def __init__(self, kind: str, message: Any, numbers: Sequence[float]) -> None:
        data = whole_words(rewritten(kind, serialize_message(message), kind)[1])
        marks = [_STAMP.pack(MARK.sec, MARK.nanosec), *map(_NUMBER.pack, numbers)]
        places = sorted((at, k) for k, mark in enumerate(marks) for at in _places(data, mark))
        self._constant: list[bytes] = []
        layout, order, end = "<", [], 0
        for at, k in [*places, (len(data), -1)]:  # what stands between two places, and what at the second one
            layout += f"{at - end}s" + ("" if k < 0 else "d" if k else "iI")
            order += [2 + len(numbers) + len(self._constant), *([] if k < 0 else [1 + k] if k else [0, 1])]
            self._constant.append(data[end:at])
            end = at + 8
        self._pack, self._in_order = struct.Struct(layout).pack, itemgetter(*order)

    def filled(self, header: WireHeader, numbers: Sequence[float]) -> bytes:
        """Return the message with this stamp and these numbers in place of those of the example, in their order."""
        values = (header.seconds, header.nanoseconds, *numbers, *self._constant)
        return self._pack(*self._in_order(values))


def _places(data: bytes, mark: bytes) -> list[int]:
    """Return where a mark stands in a message, which has it at least once."""
    found = [at for at in range(len(data)) if data.startswith(mark, at)]
    assert found, "the example does not have one of its numbers"
    return found
