"""Maps read back by Lanelet2's own library: lane and crosswalk where the scenario has them, and a route through."""

import math

import numpy as np
import pytest

from vpsci_ros.extras.formats.lanelet2 import document
from vpsci_ros.world.scenario import load_scenario

lanelet2 = pytest.importorskip("lanelet2", reason="pip install 'vpsci_ros[test]'")
SCENARIOS = [load_scenario(number) for number in (1, 4, 102)]


def read(path):
    import lanelet2.io
    import lanelet2.projection

    origin = lanelet2.io.Origin(0.0, 0.0)
    return lanelet2.io.load(str(path), lanelet2.projection.LocalCartesianProjector(origin))


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_lanelet2_reads_a_lane_of_our_width_along_our_lane_and_our_crosswalk(scenario, tmp_path):
    import lanelet2.traffic_rules

    document(scenario).write(tmp_path / "map.osm")
    by_kind = {each.attributes["subtype"]: each for each in read(tmp_path / "map.osm").laneletLayer}
    assert set(by_kind) == {"road", "crosswalk"}
    road, lane = by_kind["road"], scenario.vehicle.path
    for bound, side in ((road.leftBound, 0.5), (road.rightBound, -0.5)):
        found = np.array([lane.locate(point.x, point.y) for point in bound])
        assert np.abs(found[:, 1] - side * scenario.vehicle.lane_width).max() < 0.05
        assert found[0, 0] < -59.0
        assert found[-1, 0] > lane.length + 59.0
        places = [(float(p.attributes["local_x"]), float(p.attributes["local_y"])) for p in bound]
        assert max(math.dist(a, (p.x, p.y)) for a, p in zip(places, bound, strict=True)) < 0.01
    corners = [(p.x, p.y) for bound in (by_kind["crosswalk"].leftBound, by_kind["crosswalk"].rightBound) for p in bound]
    for corner in scenario.crosswalk:
        assert min(math.dist(corner, other) for other in corners) < 1.2, "a box about an outline with slanting ends"
    rules = lanelet2.traffic_rules
    for who, subtype in ((rules.Participants.Vehicle, "road"), (rules.Participants.Pedestrian, "crosswalk")):
        allowed = rules.create(rules.Locations.Germany, who)
        assert {kind for kind, each in by_kind.items() if allowed.canPass(each)} == {subtype}
    assert rules.create(rules.Locations.Germany, rules.Participants.Vehicle).isOneWay(road)
