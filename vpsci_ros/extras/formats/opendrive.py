"""A scenario's road as an ASAM OpenDRIVE map: the vehicle's lane along its centreline, and the crosswalk over it.

The reference line is the lane's left border, a chain of cubics (paramPoly3), which leave and reach each of its points
in the direction that the lane has there, so that positions and headings have no break; like the lane of the world it
goes on straight at both ends. The map holds what the scenario knows: one lane. Whoever wants the whole junction takes
the map that it comes from (option `road`).

The standard leaves a choice in four things, which are as CARLA's client reads them (0.9.15, 0.9.16): there is no lane
offset, which it would add to the place of objects; an object's outline stands in the object itself; the map has a
geographic reference; and the road is a little longer than its length in float32, see `_longer_than_its_float32`.
"""

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scenariogeneration import helpers, xodr

from vpsci_ros.world import Scenario
from vpsci_ros.world.opendrive import middle_line
from vpsci_ros.world.paths import Path as Lane

BEYOND = 60.0  # [m] of straight road before the centreline and after it, further than anybody drives in an episode


PIECE = 2.0  # [m] wanted length of a cubic
FINE = 0.05  # [m] to which it is found where the crosswalk lies
GEO_REFERENCE = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
"""A plane that touches the earth at latitude and longitude 0, which is no real place; CARLA's Town10HD has the same."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def write_map(scenario: Scenario, path: Path) -> None:
    """Write the road of a scenario as OpenDRIVE 1.8, in the scenario's own frame (x east, y north, metres)."""
    lane, half = scenario.vehicle.path, 0.5 * scenario.vehicle.lane_width
    view = xodr.PlanView()
    s, crossed, at = BEYOND, _where_crossed(scenario), BEYOND
    view.add_fixed_geometry(xodr.Line(BEYOND), *lane.beside(-BEYOND, half), lane.heading(-BEYOND), 0.0)
    for begin, end in _pieces(lane, crossed):
        at = s if begin == crossed else at
        cubic, length = _cubic(lane, half, begin, end)
        view.add_fixed_geometry(cubic, *lane.beside(begin, half), lane.heading(begin), s)
        s += length
    beyond = _longer_than_its_float32(s + BEYOND) - s
    view.add_fixed_geometry(xodr.Line(beyond), *lane.beside(lane.length, half), lane.heading(lane.length + BEYOND), s)
    section = xodr.LaneSection(0, xodr.Lane(lane_type=xodr.LaneType.none))
    driving = xodr.Lane(lane_type=xodr.LaneType.driving, a=scenario.vehicle.lane_width)
    driving.add_roadmark(xodr.RoadMark(xodr.RoadMarkType.solid, 0.12, rule=xodr.MarkRule.no_passing))
    section.add_right_lane(driving)
    lanes = xodr.Lanes()
    lanes.add_lanesection(section)
    road = xodr.Road(1, view, lanes, name=scenario.name)
    road.add_type(xodr.RoadType.town, 0)
    if len(scenario.crosswalk):
        road.add_object(_crosswalk(scenario, at, crossed))
    world = xodr.OpenDrive(scenario.name, revMinor="8", geo_reference=GEO_REFERENCE)
    world.add_road(road)
    helpers.printToFile(_as_carla_reads_it(world.get_element(), scenario), str(path))


def _longer_than_its_float32(length: float) -> float:
    """Return a length that is hardly greater than `length` [m], and greater than itself in float32.

    CARLA's client takes the end of a lane for the place at its length in float32, and gives a map no topology where
    that is not within the road.
    """
    return float(np.nextafter(np.float32(length), np.float32(np.inf))) + 1e-6


def _as_carla_reads_it(root: ET.Element, scenario: Scenario) -> ET.Element:
    """Return a map with the header's bounds [m], and with each outline in its object itself."""
    lane = scenario.vehicle.path
    ends = [lane.at(-BEYOND), lane.at(lane.length + BEYOND)]
    points = np.concatenate([lane.points, ends, scenario.crosswalk])
    east, north = points.max(axis=0) + 0.5 * scenario.vehicle.lane_width
    west, south = points.min(axis=0) - 0.5 * scenario.vehicle.lane_width
    bounds = {"north": north, "south": south, "east": east, "west": west}
    for header in root.iter("header"):
        header.attrib |= {side: f"{value:.3f}" for side, value in bounds.items()}
    for item in root.iter("object"):
        for outlines in item.findall("outlines"):
            item.extend(outlines)
            item.remove(outlines)
    return root


def _where_crossed(scenario: Scenario) -> float:
    """Return the arc length of the lane [m] at whose left border the middle line of the crosswalk is nearest."""
    lane, half = scenario.vehicle.path, 0.5 * scenario.vehicle.lane_width
    if not len(scenario.crosswalk):
        return 0.0
    begin, end = middle_line(scenario.crosswalk)
    along = np.arange(0.0, lane.length - PIECE, FINE)
    border = np.array([lane.beside(s, half) for s in along]) - begin
    share = np.clip(border @ (end - begin) / ((end - begin) @ (end - begin)), 0.0, 1.0)
    return float(along[np.hypot(*(border - share[:, None] * (end - begin)).T).argmin()])


def _pieces(lane: Lane, crossed: float) -> Iterator[tuple[float, float]]:
    """Yield the arc lengths [m] of the lane from which and to which cubics go; one begins where it is crossed."""
    whole = np.linspace(0.0, lane.length, max(1, math.ceil(lane.length / PIECE)) + 1)
    apart = whole[np.abs(whole - crossed) > 0.25 * PIECE]
    return itertools.pairwise(sorted({0.0, lane.length, crossed, *apart.tolist()}))


def _cubic(lane: Lane, left: float, begin: float, end: float) -> tuple[xodr.ParamPoly3, float]:
    """Return the cubic `left` [m] beside the lane from one arc length to another, in its own frame, and its length [m].

    Its tangents are those of the arc of a circle with the same ends and directions.
    """
    heading = lane.heading(begin)
    turned = (lane.heading(end) - heading + math.pi) % (2.0 * math.pi) - math.pi
    c, k = math.cos(heading), math.sin(heading)
    u, v = np.array([[c, k], [-k, c]]) @ np.subtract(lane.beside(end, left), lane.beside(begin, left))
    reach = math.hypot(u, v) / np.sinc(turned / (2.0 * math.pi))  # of the tangents, whose parameter runs from 0 to 1
    du, dv = reach * math.cos(turned), reach * math.sin(turned)
    along = (0.0, reach, 3.0 * u - 2.0 * reach - du, reach + du - 2.0 * u)
    across = (0.0, 0.0, 3.0 * v - dv, dv - 2.0 * v)
    length = _length(along, across)
    return xodr.ParamPoly3(*along, *across, prange="normalized", length=length), length


def _length(u: tuple[float, ...], v: tuple[float, ...]) -> float:
    p = 0.5 + 0.5 * _NODES
    du, dv = (q[1] + p * (2.0 * q[2] + 3.0 * p * q[3]) for q in (u, v))
    return float(0.5 * np.hypot(du, dv) @ _WEIGHTS)


class _OnlyObject(xodr.Object):  # type: ignore[misc]
    """The only object of a map: it keeps its id, which the library would change after another map in this process."""

    def _update_id(self) -> None:
        """Keep the id."""


def _crosswalk(scenario: Scenario, s: float, crossed: float) -> xodr.Object:
    """Return the crosswalk, in a frame on the reference line that is turned as the way across it.

    So CARLA 0.9.15, which turns an object's `t`, mirrors its outline at its longitudinal axis and moves it by a metre
    along it (0.9.16 does none of this), has it hardly elsewhere.

    :param s, crossed: arc length [m] in the map and on the lane where it is crossed.
    """
    lane = scenario.vehicle.path
    begin, end = middle_line(scenario.crosswalk)
    across = math.atan2(*(end - begin)[::-1])
    c, k = math.cos(across), math.sin(across)
    border = np.array(lane.beside(crossed, 0.5 * scenario.vehicle.lane_width))
    corners = (scenario.crosswalk - border) @ np.array([[c, -k], [k, c]])
    size = np.ptp(corners, axis=0)
    kind = {"Type": xodr.ObjectType.crosswalk, "subtype": "zebra", "id": str(scenario.number), "name": "crosswalk"}
    item = _OnlyObject(s, 0.0, **kind, hdg=across - lane.heading(crossed), length=size[0], width=size[1], height=0.0)
    outline = xodr.Outline(closed=True, outer=True, id=0)
    for number, (u, v) in enumerate(corners):
        outline.add_corner(xodr.CornerLocal(u, v, 0.0, 0.0, number))
    item.add_outline(outline)
    return item
