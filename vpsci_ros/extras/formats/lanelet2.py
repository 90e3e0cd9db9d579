"""A scenario's lane and crosswalk as a Lanelet2 map (.osm), as Autoware and other stacks load it.

The lane is one lanelet, straight on for `BEYOND` at both ends, and the crosswalk another, for pedestrians
(Poggenhans et al., "Lanelet2: a high-definition map framework", 2018). Points have latitude and longitude about (0,
0), which is no real place, and our own metres in `local_x` and `local_y`, which Autoware's local projector takes.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import road_of
from vpsci_ros.extras.formats.opendrive import BEYOND
from vpsci_ros.world import Scenario
from vpsci_ros.world.opendrive import middle_line

STEP = 1.0  # [m] between points of a border, about
AXIS, SQUARED_ECCENTRICITY = 6_378_137.0, 6.694379990141e-3  # [m], 1: WGS 84's ellipsoid
NORTH = AXIS * (1.0 - SQUARED_ECCENTRICITY)  # [m] a radian northwards at the equator; eastwards it is AXIS


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write SCENARIO.osm for each scenario of the episodes, and return the number of files."""
    names = set()
    for episode in episodes:
        scenario = road_of(episode)
        if scenario.name not in names:
            names.add(scenario.name)
            document(scenario).write(folder / f"{scenario.name}.osm", encoding="utf-8", xml_declaration=True)
    return len(names)


def document(scenario: Scenario) -> "ET.ElementTree[ET.Element]":
    """Return a scenario's lane and crosswalk as a Lanelet2 map."""
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
