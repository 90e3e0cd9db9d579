"""The exported road as CARLA's own client reads it: crosswalk, lane, topology and reference, without a server."""

import numpy as np
import pytest

from vpsci_ros.world.scenario import load_scenario

carla = pytest.importorskip("carla", reason="pip install 'vpsci_ros[carla]'")
pytest.importorskip("scenariogeneration", reason="pip install 'vpsci_ros[formats]'")

SCENARIOS = [load_scenario(number) for number in (1, 4, 102)]


@pytest.fixture(params=SCENARIOS, ids=lambda scenario: scenario.name)
def exported(request, tmp_path):
    """Return a scenario with the text of its exported road."""
    from vpsci_ros.extras.formats.opendrive import write_map

    write_map(request.param, tmp_path / "road.xodr")
    return request.param, (tmp_path / "road.xodr").read_text(encoding="utf-8")


def test_the_client_finds_crosswalk_topology_and_lane_where_the_scenario_has_them(exported):
    scenario, text = exported
    road = carla.Map(scenario.name, text)
    corners = np.array([[corner.x, -corner.y] for corner in road.get_crosswalks()])
    assert np.abs(corners - scenario.crosswalk).max() < 0.01
    ((entry, leaving),) = road.get_topology()
    lane = scenario.vehicle.path
    for waypoint, beyond in ((entry, -60.0), (leaving, lane.length + 60.0)):
        at = waypoint.transform.location
        assert lane.locate(at.x, -at.y) == pytest.approx((beyond, 0.0), abs=0.05)
    found = [waypoint.transform for waypoint in road.generate_waypoints(2.0)]
    places = [lane.locate(each.location.x, -each.location.y) for each in found]
    assert max(abs(left) for _, left in places) < 0.02
    turned = [lane.heading(s) + np.radians(each.rotation.yaw) for (s, _), each in zip(places, found, strict=True)]
    assert np.abs(np.angle(np.exp(1j * np.array(turned)))).max() < np.radians(2.0)
