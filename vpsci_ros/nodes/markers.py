"""The world as RViz and Foxglove draw it: lane and crosswalk, the vehicle's box, the pedestrians' cylinders."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from vpsci_ros.nodes.convert import yaw_quaternion
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import Scenario
from vpsci_ros.world.state import IDLE

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
