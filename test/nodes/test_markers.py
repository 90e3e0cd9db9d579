"""What RViz and Foxglove draw is where the world says it is."""

import numpy as np
import pytest
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.world import EPISODE, RUNNING, load_scenario


@pytest.fixture
def record() -> np.ndarray:
    state = np.zeros(1, EPISODE)
    state["status"], state["scenario"] = RUNNING, 1
    state["vehicle_x"], state["vehicle_y"], state["vehicle_heading"] = -103.0, -50.0, np.pi / 2
    state["pedestrian_x"], state["pedestrian_y"] = -93.0, -30.0
    return state


def test_both_agents_are_drawn_at_their_places_and_sizes(record: np.ndarray) -> None:
    scenario = load_scenario(1)
    lane, crosswalk, vehicle, pedestrian = scene_markers(record, {1: scenario}, Header(frame_id="map")).markers
    assert (vehicle.pose.position.x, vehicle.pose.position.y) == (-103.0, -50.0)
    assert (vehicle.scale.x, vehicle.scale.y) == (4.69, 1.85)
    assert vehicle.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
    assert (pedestrian.pose.position.x, pedestrian.pose.position.y) == (-93.0, -30.0)
    assert pedestrian.scale.x == pytest.approx(0.6)
    assert lane.scale.x == scenario.vehicle.lane_width
    assert len(lane.points) == len(scenario.vehicle.path.points)
    assert crosswalk.points[0] == crosswalk.points[-1]
    assert {marker.header.frame_id for marker in (lane, crosswalk, vehicle, pedestrian)} == {"map"}


def test_an_idle_slot_clears_the_scene(record: np.ndarray) -> None:
    record["status"] = 0
    (marker,) = scene_markers(record, {}, Header(frame_id="map")).markers
    assert marker.action == Marker.DELETEALL
