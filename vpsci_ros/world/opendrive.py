"""Routes and crosswalks of an OpenDRIVE map, for scenarios at your own intersection.

The reader covers lines, arcs, spirals, parametric cubics, lane offsets, lane widths and objects with local corners of
OpenDRIVE 1.4 to 1.8 (https://www.asam.net/standards/detail/opendrive/). Elevation is ignored. The frame is the map's:
x east, y north, metres.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import reason, require_form, require_regular, shown
from vpsci_ros.errors import InvalidInput

Floats: TypeAlias = NDArray[np.float64]
LARGEST = 1e9  # of a number in a map, which is in metres or radians
LONGEST_ROAD, LONGEST_ROUTE = 1e5, 2e5  # [m]
LARGEST_FILE, MOST_ELEMENTS = 2**28, 2**22  # [bytes]; a map of a whole town has some 10 MB
MOST_CORNERS = 1000  # of an outline
LARGEST_GAP = 0.5  # [m] between the end of a lane and the beginning of the next one on a route
BEYOND = 3.0  # [m] that a walking route goes on beyond either end of its crosswalk
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


class _Elements(ET.TreeBuilder):
    """Tree builder that refuses more than `MOST_ELEMENTS` elements, and document types, whose entities may be huge."""

    def __init__(self) -> None:
        super().__init__()
        self._left = MOST_ELEMENTS

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError(f"a document type ({name}), which OpenDRIVE does not have")

    def start(self, tag: str, attributes: dict[str, str]) -> ET.Element:
        self._left -= 1
        if self._left < 0:
            raise ValueError(f"more than {MOST_ELEMENTS:,} elements")
        return super().start(tag, attributes)


class OpenDriveMap:
    """The roads, lanes and objects of an OpenDRIVE file.

    :raises InvalidInput: unreadable XML, too large, or not an OpenDRIVE file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_regular(self.path, LARGEST_FILE)
        try:
            root = ET.parse(self.path, ET.XMLParser(target=_Elements())).getroot()
        except OSError as error:
            raise InvalidInput(f"{path}: cannot be read: {error.strerror}") from error
        except (
            ET.ParseError,
            ValueError,
            LookupError,
        ) as error:  # the latter two of an unknown encoding, or `_Elements`
            text = reason(error)
            raise InvalidInput(f"{path}: expected an OpenDRIVE file, got XML that does not parse: {text}") from None
        if root.tag != "OpenDRIVE":
            raise InvalidInput(f"{path}: expected an OpenDRIVE file, got XML with root element {root.tag!r}")
        self._roads = {road.get("id", ""): road for road in root.iter("road")}

    def route(self, lanes: Sequence[tuple[str | int, int]], step: float = 1.0) -> tuple[Floats, float]:
        """Return the centreline of consecutive lanes, float64[N, 2] [m], and the width [m] of the first one.

        The width is that at the start of the first lane's road.

        :param lanes: (road id, lane id); a lane with a positive id is driven against its road's reference line.
        :param step: distance between points [m], about.
        :raises InvalidInput: no lane, two lanes that do not join, a route longer than `LONGEST_ROUTE`, or as
            `lane_centre`.
        """
        if not lanes:
            raise InvalidInput(f"{self.path}: expected at least one [road, lane], got none")
        pieces: list[Floats] = []
        length = 0.0
        for road, lane in lanes:
            piece = self.lane_centre(road, lane, step)
            length += step * len(piece)
            if length > LONGEST_ROUTE:
                raise InvalidInput(f"{self.path}: the lanes of a route are longer than {LONGEST_ROUTE:g} m; name fewer")
            if pieces:
                gap = math.dist(pieces[-1][-1], piece[0])
                if gap > LARGEST_GAP:
                    raise InvalidInput(
                        f"{self.path}: lane {lane} of road {road} begins {gap:.1f} m from the end of the one before, "
                        "name the lanes in the order of driving, without a gap"
                    )
            pieces.append(piece[1:] if pieces else piece)  # both have the point where they join
        road, lane = lanes[0]
        return np.concatenate(pieces), float(self._width(self._road(road), [lane], np.zeros(1))[0])

    def lane_centre(self, road_id: str | int, lane: int, step: float = 1.0) -> Floats:
        """Return the centre of a lane in the direction in which it is driven, float64[N, 2] [m].

        :raises InvalidInput: an unknown road or lane, lane 0, a road longer than `LONGEST_ROAD`, a reference line of an
            unknown kind, or an attribute that is not a number.
        """
        road = self._road(road_id)
        length = _number(road, "length")
        if not 0.0 < length <= LONGEST_ROAD:
            raise InvalidInput(f"{self.path}: road {road_id}: expected a length to {LONGEST_ROAD:g} m, got {length:g}")
        if lane == 0:
            raise InvalidInput(f"{self.path}: lane 0 of road {road_id} is its centre line; name one beside it")
        s = np.linspace(0.0, length, max(2, math.ceil(length / step) + 1))
        t = self._lane_offset(road, s) + math.copysign(1.0, lane) * self._centre_distance(road, lane, s)
        points = self._points(road, s, t)
        return points if lane < 0 else points[::-1].copy()

    def crosswalk(self, object_id: str | int) -> Floats:
        """Return the outline of an object, float64[K, 2] [m], without a repeated last corner.

        :raises InvalidInput: no such object, or one without 3 to `MOST_CORNERS` local corners.
        """
        for road in self._roads.values():
            for item in road.iterfind("objects/object"):
                if item.get("id") == str(object_id):
                    return self._outline(road, item)
        known = ", ".join(self.crosswalks()) or "none"
        raise InvalidInput(f"{self.path}: no object {object_id}; crosswalks of this map: {known}")

    def crosswalks(self) -> list[str]:
        """Return the ids of the objects that are crosswalks."""
        items = (item for road in self._roads.values() for item in road.iterfind("objects/object"))
        return [item.get("id", "") for item in items if item.get("type") == "crosswalk"]

    def _road(self, road_id: str | int) -> ET.Element:
        if str(road_id) not in self._roads:
            raise InvalidInput(f"{self.path}: no road {road_id}; this map has {len(self._roads)} roads")
        return self._roads[str(road_id)]

    def _outline(self, road: ET.Element, item: ET.Element) -> Floats:
        corners = [[_number(c, "u"), _number(c, "v")] for c in item.iter("cornerLocal")]
        if not 3 <= len(corners) <= MOST_CORNERS:
            raise InvalidInput(
                f"{self.path}: object {item.get('id')} has no outline of 3 to {MOST_CORNERS:,} local corners, but "
                f"{len(corners):,}"
            )
        s, t = np.array([_number(item, "s")]), np.array([_number(item, "t")])
        origin = self._points(road, s, t)[0]
        turn = float(self._reference(road, s)[2][0]) + _number(item, "hdg")
        c, k = math.cos(turn), math.sin(turn)
        outline = origin + np.array(corners) @ np.array([[c, k], [-k, c]])
        return outline[:-1] if np.allclose(outline[0], outline[-1]) else outline

    def _points(self, road: ET.Element, s: Floats, t: Floats) -> Floats:
        x, y, heading = self._reference(road, s)
        return np.stack([x - t * np.sin(heading), y + t * np.cos(heading)], axis=1)

    def _reference(self, road: ET.Element, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x, y [m] and heading [rad] of a road's reference line at `s`."""
        x, y, heading = np.empty_like(s), np.empty_like(s), np.empty_like(s)
        pieces = sorted(road.iterfind("planView/geometry"), key=lambda g: _number(g, "s"))
        if not pieces:
            raise InvalidInput(f"{self.path}: road {road.get('id')} has no reference line")
        begins = [_number(geometry, "s") for geometry in pieces]
        for geometry, begin, here in zip(pieces, begins, _within(begins, s), strict=True):
            if here.start < here.stop:
                along = s[here] - begin
                x[here], y[here], heading[here] = _evaluate(geometry, along, f"{self.path}: road {road.get('id')}")
        return x, y, heading

    def _lane_offset(self, road: ET.Element, s: Floats) -> Floats:
        return _cubic(road.findall("lanes/laneOffset"), "s", s)

    def _centre_distance(self, road: ET.Element, lane: int, s: Floats) -> Floats:
        """Return the distance [m] of a lane's centre from the centre lane, without its sign."""
        side = int(math.copysign(1, lane))
        return self._width(road, range(side, lane, side), s) + 0.5 * self._width(road, [lane], s)

    def _width(self, road: ET.Element, lanes: Sequence[int], s: Floats) -> Floats:
        """Return the width [m] of lanes together."""
        sections = sorted(road.iterfind("lanes/laneSection"), key=lambda section: _number(section, "s"))
        begins = [_number(section, "s") for section in sections]
        width = np.zeros_like(s)
        for section, begin, here in zip(sections, begins, _within(begins, s), strict=True):
            if not lanes or here.start == here.stop:
                continue
            found = {item.get("id", ""): item for item in reversed(list(section.iter("lane")))}  # the first of each
            for lane in lanes:
                if str(lane) not in found:
                    ids = ", ".join(reversed(found))
                    raise InvalidInput(
                        f"{self.path}: road {road.get('id')} has no lane {lane} at every place; lanes: {ids[:200]}"
                    )
                width[here] += _cubic(found[str(lane)].findall("width"), "sOffset", s[here] - begin)
        return width


def _within(begins: Sequence[float], s: Floats) -> list[slice]:
    """Return the slice of the places `s`, in rising order, that lies in each piece of a road, by where pieces begin."""
    edges = np.searchsorted(s, begins[1:], side="left").tolist()
    return [slice(*ends) for ends in zip([0, *edges], [*edges, len(s)], strict=True)] if begins else []


def expand(document: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a scenario document with coordinates in place of `opendrive`, `vehicle.lanes` and `pedestrian.crosswalk`.

    The map's path is taken from the folder of the scenario file. The walking route is the crosswalk's middle line,
    longer by `BEYOND` at both ends, walked from its other end with `reverse: true`; the goal, unless given, is half a
    metre beyond the far edge.

    :param where: path of the scenario file, which opens each message.
    :raises InvalidInput: a key is missing or wrong, or as `OpenDriveMap` and its methods.
    """
    require_form(document, {"vehicle": dict, "pedestrian": dict, "opendrive": str}, where)
    vehicle, pedestrian = dict(document["vehicle"]), dict(document["pedestrian"])
    if "lanes" not in vehicle or "crosswalk" not in pedestrian:
        raise InvalidInput(
            f"{where}: with opendrive, give vehicle.lanes ([[road, lane], ...]) and pedestrian.crosswalk (id)"
        )
    road_map = OpenDriveMap(Path(where).parent / str(document["opendrive"]))
    lanes = vehicle.pop("lanes")
    if not isinstance(lanes, list) or not all(isinstance(p, list) and len(p) == 2 and type(p[1]) is int for p in lanes):
        raise InvalidInput(
            f"{where}, vehicle: lanes must be [[road, lane], ...] in the order of driving, got {shown(lanes)}"
        )
    centreline, lane_width = road_map.route([(road, lane) for road, lane in lanes], 2.0)
    outline = road_map.crosswalk(pedestrian.pop("crosswalk"))
    begin, end = middle_line(outline)
    if pedestrian.pop("reverse", False):
        begin, end = end, begin
    along = (end - begin) / math.dist(begin, end)
    pedestrian["route"] = [(begin - BEYOND * along).tolist(), (end + BEYOND * along).tolist()]
    pedestrian.setdefault("goal", round(BEYOND + math.dist(begin, end) + 0.5, 2))
    vehicle |= {"centreline": centreline.tolist(), "lane_width": vehicle.get("lane_width", lane_width)}
    rest = {key: value for key, value in document.items() if key != "opendrive"}
    return rest | {"vehicle": vehicle, "pedestrian": pedestrian, "crosswalk": outline.tolist()}


def middle_line(outline: Floats) -> tuple[Floats, Floats]:
    """Return the ends of a long outline's middle line, float64[2] [m] each, the end further to the south-west first."""
    centre = outline.mean(axis=0)
    _, _, axes = np.linalg.svd(outline - centre)
    along = axes[0] if axes[0] @ np.array([1.0, 1.0]) >= 0.0 else -axes[0]
    reach = (outline - centre) @ along
    return centre + reach.min() * along, centre + reach.max() * along


def _evaluate(geometry: ET.Element, s: Floats, where: str) -> tuple[Floats, Floats, Floats]:
    """Return x, y, heading at arc lengths `s` of one piece of a reference line."""
    heading = _number(geometry, "hdg")
    kind = next(iter(geometry), None)
    if kind is not None and kind.tag in ("line", "arc", "spiral"):
        begin = _number(kind, "curvature" if kind.tag == "arc" else "curvStart", 0.0)
        end = _number(kind, "curvEnd", begin)
        u, v, turn = _clothoid(s, begin, (end - begin) / _length(geometry))
    elif kind is not None and kind.tag == "paramPoly3":
        p = s / _length(geometry) if kind.get("pRange", "normalized") == "normalized" else s
        coordinates = [[_number(kind, f"{k}{axis}", 0.0) for k in "abcd"] for axis in "UV"]
        u, v = (a + p * (b + p * (c + p * d)) for a, b, c, d in coordinates)
        du, dv = (b + p * (2 * c + p * 3 * d) for _, b, c, d in coordinates)
        turn = np.arctan2(dv, du)
    else:
        tag = "nothing" if kind is None else kind.tag
        raise InvalidInput(f"{where}: expected line, arc, spiral or paramPoly3 as reference line, got {tag}")
    c, k = math.cos(heading), math.sin(heading)
    return _number(geometry, "x") + c * u - k * v, _number(geometry, "y") + k * u + c * v, heading + turn


def _clothoid(s: Floats, curvature: float, rate: float) -> tuple[Floats, Floats, Floats]:
    """Return local x, y and turned angle after arc length `s` with curvature(s) = curvature + rate s."""
    nodes = 0.5 * s[:, None] * (1.0 + _NODES)
    angle = nodes * (curvature + 0.5 * rate * nodes)
    u, v = (0.5 * s * (f(angle) @ _WEIGHTS) for f in (np.cos, np.sin))
    return u, v, s * (curvature + 0.5 * rate * s)


def _cubic(records: Sequence[ET.Element], key: str, s: Floats) -> Floats:
    """Return a piecewise cubic a + b ds + c ds2 + d ds3 at `s`; 0 where there are no records."""
    if not records:
        return np.zeros_like(s)
    records = sorted(records, key=lambda r: _number(r, key))
    begins = np.array([_number(r, key) for r in records])
    which = np.maximum(np.searchsorted(begins, s, side="right") - 1, 0)
    a, b, c, d = (np.array([_number(r, name) for r in records])[which] for name in "abcd")
    ds = s - begins[which]
    return np.asarray(a + ds * (b + ds * (c + ds * d)))


def _length(geometry: ET.Element) -> float:
    length = _number(geometry, "length")
    if length <= 0.0:
        raise InvalidInput(f"OpenDRIVE element {geometry.tag}: expected a length above 0, got {length:g}")
    return length


def _number(element: ET.Element, key: str, otherwise: float | None = None) -> float:
    """Return an attribute as a number; where it is missing, `otherwise` (None: the attribute has to be there)."""
    text = element.get(key)
    if text is None and otherwise is not None:
        return otherwise
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST:
        raise InvalidInput(f"OpenDRIVE element {element.tag}: expected a number in {key!r}, got {shown(text)}")
    return value
