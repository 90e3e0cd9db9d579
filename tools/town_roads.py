"""Write params/scenarios/roads.json: the roads around the shipped scenarios, from the map they were taken from.

Needs shapely (in `make setup`'s environment) and Town10HD.xodr of the CARLA project:

    python tools/town_roads.py Town10HD.xodr
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from shapely import LineString, MultiPolygon, Polygon, box, make_valid, unary_union

from vpsci_ros.world import load_scenarios
from vpsci_ros.world.opendrive import OpenDriveMap
from vpsci_ros.world.scenario import further_files, scenario_files

SOURCE = (
    "Town10HD.xodr of the CARLA project, MIT licence, Copyright (c) 2017-2020 Computer Vision Center (CVC) at the "
    "Universitat Autonoma de Barcelona"
)
MARGIN = 12.0  # [m] around lanes and walking routes
TOLERANCE = 0.04  # [m] by which a simplified line may be off
STEP = 0.5  # [m] from one point of a road to the next
GAP = 0.15  # [m] gaps between neighbouring roads that are closed
SMALLEST = 44.0  # [m2] of an island; smaller ones are gaps between the lanes of a junction
DRIVEN = {"driving", "shoulder"}
MARKS = {"broken", "solid", "solid solid"}


def sides(town: OpenDriveMap, number: str) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Yield type, kind of mark, inner and outer border, float64[N, 2], of each lane, from the centre outwards."""
    road = town._road(number)
    s = np.linspace(0.0, float(road.get("length", 0)), max(2, int(float(road.get("length", 0)) / STEP) + 1))
    offset = town._lane_offset(road, s)
    for way in (1, -1):
        lanes = {int(lane.get("id", 0)): lane for lane in road.iter("lane")}
        inner = np.zeros_like(s)
        for lane in sorted((each for each in lanes if each * way > 0), key=abs):
            outer = inner + town._width(road, [lane], s)
            borders = [town._points(road, s, offset + way * t) for t in (inner, outer)]
            mark = lanes[lane].find("roadMark")
            yield lanes[lane].get("type", ""), "" if mark is None else mark.get("type", ""), borders[0], borders[1]
            inner = outer
    centre = next(lane for lane in road.iter("lane") if lane.get("id") == "0").find("roadMark")
    line = town._points(road, s, offset)
    yield "centre", "" if centre is None else centre.get("type", ""), line, line


def rounded(line: np.ndarray) -> list[list[float]]:
    """Return points as lists of numbers to the centimetre."""
    return [[round(float(x), 2), round(float(y), 2)] for x, y in line]


def main() -> None:
    """Read the map and write the file."""
    town, surfaces, marks = OpenDriveMap(sys.argv[1]), [], []
    for number, road in town._roads.items():
        for kind, mark, inner, outer in sides(town, number):
            if kind in DRIVEN and np.hypot(*(outer - inner).T).max() > 0.05:
                surfaces.append(make_valid(Polygon(np.concatenate([inner, outer[::-1]]))))
            if road.get("junction") == "-1" and mark in MARKS and kind in {"driving", "centre"}:
                marks.append(LineString(outer))
    whole = unary_union(surfaces).buffer(GAP, join_style="mitre").buffer(-GAP, join_style="mitre")
    scenarios = load_scenarios([*scenario_files(), *further_files()])
    points = np.concatenate([p for s in scenarios for p in (s.vehicle.path.points, s.pedestrian.path.points)])
    area = box(*(points.min(axis=0) - MARGIN), *(points.max(axis=0) + MARGIN))
    cut = whole.intersection(area).simplify(TOLERANCE)
    parts = cut.geoms if isinstance(cut, MultiPolygon) else [cut]
    rings = [part.exterior for part in parts] + [hole for part in parts for hole in part.interiors]
    lines = [line.intersection(area).simplify(TOLERANCE) for line in marks if line.intersects(area)]
    found = {
        "source": SOURCE,
        "scenarios": [scenario.name for scenario in scenarios],
        "kerbs": [rounded(np.array(ring.coords)[:-1]) for ring in rings if Polygon(ring).area > SMALLEST],
        "marks": [rounded(np.array(line.coords)) for line in lines if line.length > 1.0],
    }
    text = ",\n".join(f"{json.dumps(name)}:{json.dumps(value, separators=(',', ':'))}" for name, value in found.items())
    Path("params/scenarios/roads.json").write_text(f"{{{text}}}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
