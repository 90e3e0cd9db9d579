"""Transforms, models and RViz's configuration show a world of one episode without a step by hand."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message
from tf2_msgs.msg import TFMessage

from vpsci_ros.nodes import convert
from vpsci_ros.nodes.recorder import of_own_frames, of_own_nodes
from vpsci_ros.nodes.topics import TOPICS
from vpsci_ros.resources import robot_description
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.layout import motion_of
from vpsci_ros.wire.odometry import write_transforms
from vpsci_ros.world import EPISODE
from vpsci_ros.world.observation import AGENTS

pytestmark = pytest.mark.usefixtures("forked_nodes")
RVIZ = Path(__file__).resolve().parents[2] / "rviz" / "vpsci.rviz"


def moving(record: np.void, prefix: str) -> TFMessage:
    """Return the transforms of vehicle and pedestrian of an EPISODE record."""
    movers = {f"{prefix}{agent}": motion_of(record, agent) for agent in AGENTS}
    return deserialize_message(write_transforms(movers, WireHeader(0, 0, "map")), TFMessage)


def test_transforms_are_the_poses_of_the_odometry() -> None:
    state = np.zeros(1, EPISODE)
    state["vehicle_x"], state["vehicle_y"], state["vehicle_heading"] = 3.0, -4.0, 0.5
    state["pedestrian_x"], state["pedestrian_vy"] = 7.0, 1.5
    vehicle, pedestrian = moving(state[0], "left/").transforms
    assert (vehicle.header.frame_id, vehicle.child_frame_id) == ("map", "left/vehicle/base_link")
    assert pedestrian.child_frame_id == "left/pedestrian/base_link"
    at, turned = vehicle.transform.translation, vehicle.transform.rotation
    assert (at.x, at.y, at.z) == (3.0, -4.0, 0.0)
    assert 2.0 * np.arctan2(turned.z, turned.w) == pytest.approx(0.5)
    turned = pedestrian.transform.rotation
    assert 2.0 * np.arctan2(turned.z, turned.w) == pytest.approx(0.5 * np.pi), "it faces where it walks"


def test_the_rear_axle_is_half_a_wheelbase_behind_the_centre_in_transforms_and_model() -> None:
    (axle,) = convert.fixed_transforms().transforms
    assert (axle.header.frame_id, axle.child_frame_id) == ("vehicle/base_link", "vehicle/rear_axle")
    origin = ET.fromstring(robot_description("vehicle")).find("joint/origin")
    assert [float(text) for text in origin.get("xyz").split()] == [axle.transform.translation.x, 0.0, 0.0]
    assert axle.transform.translation.x == -1.4375


def test_the_models_have_the_sizes_by_which_curvttc_is_computed() -> None:
    vehicle, pedestrian = (ET.fromstring(robot_description(agent)) for agent in AGENTS)
    box = vehicle.find("link/collision/geometry/box").get("size").split()
    assert [float(text) for text in box][:2] == [VEHICLE_LENGTH, VEHICLE_WIDTH]
    assert float(pedestrian.find("link/collision/geometry/cylinder").get("radius")) == PEDESTRIAN_RADIUS
    for model in (vehicle, pedestrian):
        children = {joint.find("child").get("link") for joint in model.iter("joint")}
        assert [link.get("name") for link in model.iter("link") if link.get("name") not in children] == ["base_link"]


def test_rviz_shows_topics_of_the_graph_in_their_types() -> None:
    configuration = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]
    assert configuration["Global Options"]["Fixed Frame"] == "map"
    kinds = {"MarkerArray": "MarkerArray", "Odometry": "Odometry", "RobotModel": "String"}
    shown = [
        (each["Class"].rpartition("/")[2], each.get("Topic", each.get("Description Topic")))
        for each in configuration["Displays"]
    ]
    found = {topic["Value"]: kinds[kind] for kind, topic in shown if topic}
    assert len(found) == 4
    assert {name: TOPICS[name].type.__name__ for name in found} == found
    prefixes = [each["TF Prefix"] for each in configuration["Displays"] if "TF Prefix" in each]
    assert prefixes == list(AGENTS)


@pytest.mark.parametrize(("prefix", "own"), [("", False), ("left/", True), ("right/", False)])
def test_of_a_topic_that_graphs_share_each_takes_its_own(prefix: str, own: bool) -> None:
    state = np.zeros(1, EPISODE)
    poses = moving(state[0], "left/")
    status = DiagnosticArray(status=[DiagnosticStatus(name="left/world_simulator")])
    assert of_own_nodes(status, prefix) is own
    for message in (poses, convert.fixed_transforms("left/")):
        assert of_own_frames(serialize_message(message), prefix) is own
    assert not of_own_frames(serialize_message(TFMessage()), "left/")
    for names in (["left/somebody_else"], []):
        assert not of_own_nodes(DiagnosticArray(status=[DiagnosticStatus(name=name) for name in names]), "left/")
