"""Odometry, transforms and markers that are written as bytes are the bytes that ROS makes of their messages."""

from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from vpsci_ros.nodes import convert
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.header import WireHeader, padded
from vpsci_ros.wire.markers import write_markers
from vpsci_ros.wire.odometry import write_odometry, write_transforms
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.tick import NO_ACTIONS


def serialized(kind: str, message: object) -> bytes:
    return padded(rewritten(kind, serialize_message(message), kind)[1], 4)


def test_views_of_every_scenario_are_the_bytes_of_their_messages() -> None:
    scenarios = load_scenarios([1, 2, 3, 4, 5, 6, 7, 8, 101])
    numbered = {scenario.number: scenario for scenario in scenarios}
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", pedestrians=2)
    for number in numbered:
        world = World(config, scenarios, [(number, 3)], 1, 5)
        for tick in range(5):
            for _ in range(8 * min(tick, 1)):
                world.advance(world.now.unassessed(), NO_ACTIONS)
            state, stamp = world.now.state, convert.stamp(tick, 0.05)
            message, header = Header(stamp=stamp, frame_id="map"), WireHeader(stamp.sec, stamp.nanosec, "map")
            motions = [layout.motion_of(state[0], "vehicle")]
            motions += [layout.motion_of(record, "pedestrian") for record in state]
            for motion, frame in zip(motions, ("left/vehicle", "pedestrian", "pedestrian_1"), strict=True):
                written = write_odometry(motion, frame, header)
                read = deserialize_message(written, Odometry)
                assert written == serialized("nav_msgs/msg/Odometry", read)
                assert (read.pose.pose.position.x, read.pose.pose.position.y) == motion[:2]
                assert (read.header, read.child_frame_id) == (message, f"{frame}/base_link")
                assert (read.twist.twist.linear.x, read.twist.twist.angular.z) == (motion.speed, motion.yaw_rate)
            transforms = write_transforms(dict(zip(("vehicle", "a/pedestrian"), motions, strict=False)), header)
            read = deserialize_message(transforms, TFMessage)
            assert transforms == serialized("tf2_msgs/msg/TFMessage", read)
            assert [each.child_frame_id for each in read.transforms] == ["vehicle/base_link", "a/pedestrian/base_link"]
            assert [each.transform.translation.x for each in read.transforms] == [motion.x for motion in motions[:2]]
            markers = write_markers(state, motions, numbered, header)
            read = deserialize_message(markers, MarkerArray)
            assert markers == serialized("visualization_msgs/msg/MarkerArray", read)
            assert all(each.header == message for each in read.markers)
