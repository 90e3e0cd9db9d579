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
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from scenariogeneration import helpers, xodr

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.movers import road_of
from vpsci_ros.extras.formats.run import Options
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


# ---- A scenario's lane and crosswalk as a Lanelet2 map (.osm), as Autoware and other stacks load it.
#
# The lane is one lanelet, straight on for `BEYOND` at both ends, and the crosswalk another, for pedestrians
# (Poggenhans et al., "Lanelet2: a high-definition map framework", 2018). Points have latitude and longitude about (0,
# 0), which is no real place, and our own metres in `local_x` and `local_y`, which Autoware's local projector takes.


STEP = 1.0  # [m] between points of a border, about
AXIS, SQUARED_ECCENTRICITY = 6_378_137.0, 6.694379990141e-3  # [m], 1: WGS 84's ellipsoid
NORTH = AXIS * (1.0 - SQUARED_ECCENTRICITY)  # [m] a radian northwards at the equator; eastwards it is AXIS


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write SCENARIO.osm for each road of the episodes."""
    names = set()
    for episode in episodes:
        scenario = road_of(episode)
        if scenario.name not in names:
            names.add(scenario.name)
            document(scenario).write(folder / f"{scenario.name}.osm", encoding="utf-8", xml_declaration=True)
    return len(names)


def document(scenario: Scenario) -> "ET.ElementTree[ET.Element]":
    """Return a scenario's lane and crosswalk as a map."""
    osm = _Map()
    lane, half = scenario.vehicle.path, 0.5 * scenario.vehicle.lane_width
    count = math.ceil((lane.length + 2.0 * BEYOND) / STEP)
    along = np.linspace(-BEYOND, lane.length + BEYOND, count + 1)
    left, right = (np.array([lane.beside(s, side) for s in along]) for side in (half, -half))
    drivable = {"subtype": "road", "participant:vehicle": "yes", "speed_limit": "30"}
    osm.lanelet(left, right, {"type": "line_thin", "subtype": "solid"}, drivable)
    if len(scenario.crosswalk):
        sides = _long_sides(scenario.crosswalk)
        walkable = {"subtype": "crosswalk", "participant:pedestrian": "yes", "speed_limit": "10"}
        osm.lanelet(*sides, {"type": "pedestrian_marking"}, walkable)
    return ET.ElementTree(osm.root())


class _Map:
    """Nodes, ways and relations, which OSM has in this order, numbered from 1."""

    def __init__(self) -> None:
        self._parts: dict[str, list[ET.Element]] = {"node": [], "way": [], "relation": []}

    def root(self) -> ET.Element:
        root = ET.Element("osm", version="0.6", generator="vpsci_ros")
        root.append(ET.Element("MetaInfo", format_version="1", map_version="1"))
        root.extend(each for parts in self._parts.values() for each in parts)
        return root

    def lanelet(
        self, left: NDArray[np.float64], right: NDArray[np.float64], border: dict[str, str], tags: dict[str, str]
    ) -> None:
        """Add a lanelet between two borders, float64[N, 2] [m] in the direction of its traffic."""
        one_way = "yes" if tags["subtype"] == "road" else "no"
        relation = self._add("relation", {"type": "lanelet", "location": "urban", "one_way": one_way} | tags)
        for role, points in (("left", left), ("right", right)):
            ET.SubElement(relation, "member", type="way", role=role, ref=self._way(points, border).get("id", ""))

    def _way(self, points: NDArray[np.float64], tags: dict[str, str]) -> ET.Element:
        way = self._add("way", tags)
        for x, y in points.tolist():
            local = {"local_x": f"{x:.4f}", "local_y": f"{y:.4f}", "ele": "0"}
            latitude, longitude = math.degrees(y / NORTH), math.degrees(x / AXIS)
            node = self._add("node", local, lat=f"{latitude:.11f}", lon=f"{longitude:.11f}")
            way.insert(len(way.findall("nd")), ET.Element("nd", ref=node.get("id", "")))
        return way

    def _add(self, kind: str, tags: dict[str, str], **attributes: str) -> ET.Element:
        number = sum(map(len, self._parts.values())) + 1
        found = {"id": str(number), "visible": "true", "version": "1"} | attributes
        element = ET.Element(kind, found)
        for key, value in tags.items():
            ET.SubElement(element, "tag", k=key, v=value)
        self._parts[kind].append(element)
        return element


def _long_sides(outline: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the left and the right side of a crosswalk, float64[2, 2] [m] each, from one kerb to the other.

    They are the sides of the outline's box that is turned as the way across it.
    """
    begin, end = middle_line(outline)
    way = (end - begin) / math.dist(begin, end)
    normal = np.array([-way[1], way[0]])
    across = (outline - begin) @ normal
    ends = np.array([begin, end])
    return ends + across.max() * normal, ends + across.min() * normal
