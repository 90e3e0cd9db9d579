"""What RViz and Foxglove draw is where the world says it is."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.layout import motion_of
from vpsci_ros.wire.markers import write_markers
from vpsci_ros.world import EPISODE, IDLE, RUNNING, Scenario, load_scenario, load_scenarios


@pytest.fixture
def record() -> np.ndarray:
    state = np.zeros(1, EPISODE)
    state["status"], state["scenario"] = RUNNING, 1
    state["vehicle_x"], state["vehicle_y"], state["vehicle_heading"] = -103.0, -50.0, np.pi / 2
    state["pedestrian_x"], state["pedestrian_y"] = -93.0, -30.0
    return state


def drawn(state: np.ndarray, *scenarios: Scenario) -> list[Marker]:
    movers = [motion_of(state[0], "vehicle"), *(motion_of(each, "pedestrian") for each in state)]
    numbered = {scenario.number: scenario for scenario in scenarios}
    return deserialize_message(write_markers(state, movers, numbered, WireHeader(0, 0, "map")), MarkerArray).markers


def test_both_agents_are_drawn_at_their_places_and_sizes(record: np.ndarray) -> None:
    scenario = load_scenario(1)
    lane, crosswalk, vehicle, pedestrian = drawn(record, scenario)
    assert (vehicle.pose.position.x, vehicle.pose.position.y) == (-103.0, -50.0)
    assert (vehicle.scale.x, vehicle.scale.y) == (4.69, 1.85)
    assert vehicle.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
    assert (pedestrian.pose.position.x, pedestrian.pose.position.y) == (-93.0, -30.0)
    assert pedestrian.scale.x == pytest.approx(0.6)
    assert [each.type for each in (lane, vehicle, pedestrian)] == [Marker.LINE_STRIP, Marker.CUBE, Marker.CYLINDER]
    assert lane.scale.x == scenario.vehicle.lane_width
    assert [(point.x, point.y) for point in lane.points] == [*map(tuple, scenario.vehicle.path.points)]
    assert crosswalk.points[0] == crosswalk.points[-1]
    assert {(marker.header.frame_id, marker.color.a) for marker in (lane, crosswalk, vehicle, pedestrian)} == {
        ("map", 1.0)
    }


def test_an_idle_slot_clears_the_scene(record: np.ndarray) -> None:
    record["status"] = IDLE
    (marker,) = drawn(record)
    assert marker.action == Marker.DELETEALL


def test_a_pedestrian_and_parked_vehicles_that_an_episode_lacks_are_deleted(record: np.ndarray) -> None:
    state = np.concatenate([record, record])
    state["status"][1] = IDLE
    first, second = load_scenarios([1, 2])
    parked = np.array([[1.0, 2.0, np.pi / 2, 4.0, 1.8], [9.0, 2.0, 0.0, 5.0, 2.0]])
    markers = drawn(state, replace(first, parked=parked[:1]), replace(second, parked=parked))
    assert [marker.id for marker in markers] == [0, 1, 2, 3, 4, 5, 6]
    assert [marker.id for marker in markers if marker.action == Marker.DELETE] == [4, 6]
    box = markers[5]
    assert (box.pose.position.x, box.pose.position.y, box.scale.x, box.scale.y) == (1.0, 2.0, 4.0, 1.8)
    assert box.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
