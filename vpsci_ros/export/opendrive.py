"""A scenario's road as an ASAM OpenDRIVE map: the vehicle's lane along its centreline, and the crosswalk over it.

The centreline is a chain of cubics (paramPoly3), which leave and reach each of its points in the direction that the
lane has there, so that positions and headings have no break; like the lane of the world it goes on straight at both
ends. The map holds what the scenario knows: one lane. Whoever wants the whole junction takes the map that it comes from
(option `road`).
"""

import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scenariogeneration import xodr

from vpsci_ros.world import Scenario
from vpsci_ros.world.paths import Path as Lane

PIECE = 2.0  # [m] wanted length of a cubic
BEYOND = 60.0  # [m] of straight road before the centreline and after it, further than anybody drives in an episode
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def write_map(scenario: Scenario, path: Path) -> None:
    """Write the road of a scenario as OpenDRIVE 1.8, in the scenario's own frame (x east, y north, metres)."""
    lane = scenario.vehicle.path
    view = xodr.PlanView()
    s, anchors = BEYOND, []
    view.add_fixed_geometry(xodr.Line(BEYOND), *lane.at(-BEYOND), lane.heading(-BEYOND), 0.0)
    for begin, end in _pieces(lane):
        anchors.append((s, begin))
        cubic, length = _cubic(lane, begin, end)
        view.add_fixed_geometry(cubic, *lane.at(begin), lane.heading(begin), s)
        s += length
    view.add_fixed_geometry(xodr.Line(BEYOND), *lane.at(lane.length), lane.heading(lane.length + BEYOND), s)
    section = xodr.LaneSection(0, xodr.Lane(lane_type=xodr.LaneType.none))
    driving = xodr.Lane(lane_type=xodr.LaneType.driving, a=scenario.vehicle.lane_width)
    driving.add_roadmark(xodr.RoadMark(xodr.RoadMarkType.solid, 0.12, rule=xodr.MarkRule.no_passing))
    section.add_right_lane(driving)
    lanes = xodr.Lanes()
    lanes.add_lanesection(section)
    lanes.add_laneoffset(xodr.LaneOffset(0, 0.5 * scenario.vehicle.lane_width))
    road = xodr.Road(1, view, lanes, name=scenario.name)
    road.add_type(xodr.RoadType.town, 0)
    if len(scenario.crosswalk):
        road.add_object(_crosswalk(scenario, anchors))
    world = xodr.OpenDrive(scenario.name, revMinor="8")
    world.add_road(road)
    world.write_xml(str(path))


def _pieces(lane: Lane) -> Iterator[tuple[float, float]]:
    along = np.linspace(0.0, lane.length, max(1, math.ceil(lane.length / PIECE)) + 1)
    return itertools.pairwise(along.tolist())


def _cubic(lane: Lane, begin: float, end: float) -> tuple[xodr.ParamPoly3, float]:
    """Return the cubic from one arc length of the lane to another, in its own frame, and its length [m]."""
    heading = lane.heading(begin)
    turned = lane.heading(end) - heading
    c, k = math.cos(heading), math.sin(heading)
    u, v = np.array([[c, k], [-k, c]]) @ np.subtract(lane.at(end), lane.at(begin))
    reach = end - begin  # of the tangents, whose parameter runs from 0 to 1
    du, dv = reach * math.cos(turned), reach * math.sin(turned)
    along = (0.0, reach, 3.0 * u - 2.0 * reach - du, reach + du - 2.0 * u)
    across = (0.0, 0.0, 3.0 * v - dv, dv - 2.0 * v)
    length = _length(along, across)
    return xodr.ParamPoly3(*along, *across, prange="normalized", length=length), length


def _length(u: tuple[float, ...], v: tuple[float, ...]) -> float:
    p = 0.5 + 0.5 * _NODES
    du, dv = (q[1] + p * (2.0 * q[2] + 3.0 * p * q[3]) for q in (u, v))
    return float(0.5 * np.hypot(du, dv) @ _WEIGHTS)


def _crosswalk(scenario: Scenario, anchors: list[tuple[float, float]]) -> xodr.Object:
    """Return the crosswalk, its outline in the frame of the lane at the beginning of the nearest cubic.

    :param anchors: arc length [m] in the map and on the lane of each cubic's beginning, where both have one direction.
    """
    lane, middle = scenario.vehicle.path, scenario.crosswalk.mean(axis=0)
    s, along = min(anchors, key=lambda anchor: math.dist(lane.at(anchor[1]), middle))
    heading = lane.heading(along)
    c, k = math.cos(heading), math.sin(heading)
    t = float((middle - lane.at(along)) @ np.array([-k, c]))
    origin = np.array(lane.at(along)) + t * np.array([-k, c])
    corners = (scenario.crosswalk - origin) @ np.array([[c, -k], [k, c]])
    size = np.ptp(corners, axis=0)
    kind = {"Type": xodr.ObjectType.crosswalk, "subtype": "zebra", "id": str(scenario.number), "name": "crosswalk"}
    item = xodr.Object(s, t, **kind, length=size[0], width=size[1], height=0.0)
    outline = xodr.Outline(closed=True, outer=True, id=0)
    for number, (u, v) in enumerate(corners):
        outline.add_corner(xodr.CornerLocal(u, v, 0.0, 0.0, number))
    item.add_outline(outline)
    return item
