"""Views that are filled into templates are the bytes that ROS makes of their messages."""

from functools import partial

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import convert, views
from vpsci_ros.nodes.markers import scene_markers
from vpsci_ros.nodes.template import MARK, Template
from vpsci_ros.wire import layout, received
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.padding import zeroed
from vpsci_ros.wire.world_state import SerializedState
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import NO_ACTIONS


def serialized(kind: str, message: object) -> bytes:
    return zeroed(kind, serialize_message(message), kind)


def test_views_of_every_scenario_are_the_bytes_of_their_messages_one_by_one_and_all_at_once() -> None:
    scenarios = load_scenarios([1, 2, 3, 4, 5, 6, 7, 8, 101])
    numbered = {scenario.number: scenario for scenario in scenarios}
    scene = views.Views(numbered)
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", pedestrians=2)
    frames = {f"left/{agent}": mover for mover, agent in enumerate(AGENTS)}
    kinds = {
        "visualization_msgs/msg/MarkerArray": scene.markers,
        "tf2_msgs/msg/TFMessage": partial(scene.transforms, frames, {}),
        "nav_msgs/msg/Odometry": partial(scene.odometry, 0, "left/vehicle"),
    }
    ticks: list[SerializedState] = []
    expected: dict[str, list[bytes]] = {kind: [] for kind in kinds}
    for number in numbered:
        world = World(config, scenarios, [(number, 3)], 1, 5)
        for tick in range(40):
            state, stamp = world.now.state.copy(), convert.stamp(tick, 0.05)
            header = Header(stamp=stamp, frame_id="map")
            odometry = convert.odometry_messages(state[0], header, "left/")
            ticks.append(
                SerializedState(WireHeader(stamp.sec, stamp.nanosec, "map"), world.now._replace(state=state), 1)
            )
            messages = (scene_markers(state, numbered, header), convert.transforms(odometry), odometry[0])
            for (kind, write), message in zip(kinds.items(), messages, strict=True):
                expected[kind].append(serialized(kind, message))
                assert write(ticks[-1:]) == expected[kind][-1:]
            (walking,) = scene.odometry(1, "left/pedestrian", ticks[-1:])
            assert walking == serialized("nav_msgs/msg/Odometry", odometry[1])
            world.advance(world.now.unassessed(), NO_ACTIONS)
    for kind, write in kinds.items():
        assert write(ticks) == expected[kind]


def test_a_template_without_one_of_its_numbers_is_refused() -> None:
    message = convert.odometry(layout.PlanarMotion(0.1, 0.2, 0.3, 0.4, 0.5), "vehicle", Header(stamp=MARK))
    with pytest.raises(AssertionError, match="does not have one of its numbers"):
        Template("nav_msgs/msg/Odometry", message, [0.75])


def test_child_frames_are_read_from_bytes_and_what_is_no_transform_is_refused() -> None:
    state = np.zeros(1, convert.layout.EPISODE)
    moving = convert.transforms(convert.odometry_messages(state[0], Header(frame_id="map"), "left/"))
    data = serialize_message(moving)
    assert received.child_frames(data, "/tf") == [f"left/{agent}/base_link" for agent in AGENTS]
    assert received.child_frames(serialize_message(TFMessage()), "/tf") == []
    for bad in (data[:-60], data[:30], data[:4] + b"\xff\xff\xff\xff" + data[8:], data[:20] + b"\xff" * 40):
        with pytest.raises(InvalidInput, match="no TFMessage"):
            received.child_frames(bad, "/tf")
