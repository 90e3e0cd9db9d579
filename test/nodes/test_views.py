"""Views that are filled into templates are the bytes that ROS makes of their messages."""

import pytest
from nodes.stage import odometry_messages
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from vpsci_ros.nodes import convert, views
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.header import WireHeader, whole_words
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import NO_ACTIONS


def serialized(kind: str, message: object) -> bytes:
    return whole_words(rewritten(kind, serialize_message(message), kind)[1])


def test_views_of_every_scenario_are_the_bytes_of_their_messages() -> None:
    scenarios = load_scenarios([1, 2, 3, 4, 5, 6, 7, 8, 101])
    numbered = {scenario.number: scenario for scenario in scenarios}
    scene = views.SceneMarkers(numbered)
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", pedestrians=2)
    for number in numbered:
        world = World(config, scenarios, [(number, 3)], 1, 5)
        for tick in range(40):
            state, stamp = world.now.state, convert.stamp(tick, 0.05)
            message, header = Header(stamp=stamp, frame_id="map"), WireHeader(stamp.sec, stamp.nanosec, "map")
            motions = [layout.motion_of(state[0], "vehicle")]
            motions += [layout.motion_of(record, "pedestrian") for record in state]
            motions = [views.numbers_of(motion) for motion in motions]
            odometry = odometry_messages(state[0], message, "left/")
            movers = {f"left/{agent}": motion for agent, motion in zip(AGENTS, motions, strict=False)}
            for (frame, motion), expected in zip(movers.items(), odometry, strict=True):
                assert views.odometry(motion, frame, header) == serialized("nav_msgs/msg/Odometry", expected)
            assert views.transforms(movers, header) == serialized(
                "tf2_msgs/msg/TFMessage", convert.transforms(odometry)
            )
            assert scene.written(state, motions, header) == serialized(
                "visualization_msgs/msg/MarkerArray", scene_markers(state, numbered, message)
            )
            world.advance(world.now.unassessed(), NO_ACTIONS)


def test_a_template_without_one_of_its_numbers_is_refused() -> None:
    message = convert.odometry(layout.PlanarMotion(0.1, 0.2, 0.3, 0.4, 0.5), "vehicle", Header(stamp=views.MARK))
    with pytest.raises(AssertionError, match="does not have one of its numbers"):
        views.Template("nav_msgs/msg/Odometry", message, [0.75])
