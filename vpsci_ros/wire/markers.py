"""The world as RViz and Foxglove draw it, as a serialized `visualization_msgs/MarkerArray`.

Lane and crosswalk are lines, vehicles are boxes, pedestrians are cylinders. The bytes are those that ROS 2 makes of
the message; with markers as objects of Python a tick takes a millisecond longer.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.wire.header import LITTLE_ENDIAN, WireHeader, padded, with_header, with_text
from vpsci_ros.wire.layout import PlanarMotion
from vpsci_ros.world import IDLE, Scenario

VEHICLE_HEIGHT, PEDESTRIAN_HEIGHT = 1.44, 1.75  # [m] of the Model 3 and of a person
Colour = tuple[float, float, float, float]  # red, green, blue, opacity
_GREY, _WHITE = (0.6, 0.6, 0.6, 1.0), (0.95, 0.95, 0.95, 1.0)
_BLUE, _RED = (0.2, 0.5, 0.8, 1.0), (0.85, 0.2, 0.15, 1.0)
_CUBE, _CYLINDER, _LINE_STRIP = 1, 3, 4  # types of a Marker
_ADD, _DELETE, _DELETE_ALL = 0, 2, 3  # its actions
_COUNT = struct.Struct("<I")
_WHICH = struct.Struct("<iii")  # number, type, action
_BODY = struct.Struct("<7d3d4fiI?")  # pose, size, colour, lifetime (for ever), whether it moves with its frame (no)
_NO_TEXT = struct.pack("<I4x", 1)
_REST = b"".join(
    (bytes(4), _NO_TEXT, bytes(8), _NO_TEXT, _NO_TEXT, bytes(8), _NO_TEXT, _NO_TEXT, _NO_TEXT, bytes(4), bytes(1))
)
"""Fields behind the points, all empty: colours, texture, its image, coordinates, text, mesh and its file."""


class Marker(NamedTuple):
    """One marker of the scene.

    :ivar number: by which a later marker replaces it.
    :ivar pose: x, y, z [m], and z and w of the rotation about z.
    :ivar size: along x, y and z [m]; of a line its width alone.
    :ivar points: float64[n, 2] [m] of a line.
    """

    number: int
    kind: int = 0
    action: int = _ADD
    pose: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 1.0)
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    colour: Colour = (0.0, 0.0, 0.0, 0.0)
    points: NDArray[np.float64] = np.empty((0, 2))


def write_markers(
    state: NDArray[np.void], movers: Sequence[PlanarMotion], scenarios: Mapping[int, Scenario], header: WireHeader
) -> bytes:
    """Return the serialized MarkerArray of an episode, its lane and crosswalk; of an idle slot, one that clears all.

    :param state: EPISODE[B], a record for each pedestrian.
    :param movers: the vehicle and each pedestrian.
    :param scenarios: by number, all that the world may simulate.
    """
    if state[0]["status"] == IDLE:
        return _written([Marker(0, action=_DELETE_ALL)], header, name="")
    scenario = scenarios[int(state[0]["scenario"])]
    vehicle, *people = movers
    crosswalk = np.concatenate([scenario.crosswalk, scenario.crosswalk[:1]])
    markers = [
        _line(0, scenario.vehicle.path.points, scenario.vehicle.lane_width, _GREY),
        _line(1, crosswalk, 0.15, _WHITE),
        _box(2, vehicle, (VEHICLE_LENGTH, VEHICLE_WIDTH), _BLUE),
    ]
    for record, each in zip(state, people, strict=True):
        action = _DELETE if record["status"] == IDLE else _ADD  # the last episode may have had more pedestrians
        markers.append(_pedestrian(len(markers), each, action))
    for x, y, heading, length, width in scenario.parked:
        markers.append(_box(len(markers), PlanarMotion(x, y, heading, 0.0, 0.0), (length, width), _GREY))
    most = 3 + len(people) + max(len(each.parked) for each in scenarios.values())
    markers += [Marker(number, action=_DELETE) for number in range(len(markers), most)]  # of another scenario
    return _written(markers, header)


def _line(number: int, points: NDArray[np.float64], width: float, colour: Colour) -> Marker:
    return Marker(number, _LINE_STRIP, size=(width, 0.0, 0.0), colour=colour, points=points)


def _box(number: int, place: PlanarMotion, size: tuple[float, float], colour: Colour) -> Marker:
    pose = place.x, place.y, 0.5 * VEHICLE_HEIGHT, *place.quaternion
    return Marker(number, _CUBE, pose=pose, size=(*size, VEHICLE_HEIGHT), colour=colour)


def _pedestrian(number: int, place: PlanarMotion, action: int) -> Marker:
    pose = place.x, place.y, 0.5 * PEDESTRIAN_HEIGHT, 0.0, 1.0
    size = 2 * PEDESTRIAN_RADIUS, 2 * PEDESTRIAN_RADIUS, PEDESTRIAN_HEIGHT
    return Marker(number, _CYLINDER, action, pose, size, _RED)


def _written(markers: Sequence[Marker], header: WireHeader, name: str = "world") -> bytes:
    """Return the serialized MarkerArray of markers of a namespace, all with this header."""
    data = LITTLE_ENDIAN + b"\0\0" + _COUNT.pack(len(markers))
    for marker in markers:
        data = padded(with_text(with_header(data, header), name), 4)
        data = padded(data + _WHICH.pack(marker.number, marker.kind, marker.action), 8)
        x, y, z, *rotation = marker.pose
        data += _BODY.pack(x, y, z, 0.0, 0.0, *rotation, *marker.size, *marker.colour, 0, 0, False)
        data = padded(data, 4) + _COUNT.pack(len(marker.points))
        if len(marker.points):
            points = np.full((len(marker.points), 3), -0.01)  # [m] below the agents
            points[:, :2] = marker.points
            data = padded(data, 8) + points.tobytes()
        data += _REST
    return padded(data, 4)
