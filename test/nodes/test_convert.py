"""Messages carry arrays without changing a bit, and a message that does not fit is refused."""

import numpy as np
import pytest
from nodes.stage import odometry_messages, state_bytes
from rclpy.serialization import deserialize_message, serialize_message

from vpsci_msgs.msg import AgentAction, EpisodeEvent, SafetyState, WorldState
from vpsci_ros.nodes import convert
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import ActionContent, SafetyContent, write_action, write_safety_state
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.events import write_events
from vpsci_ros.wire.header import WireHeader, padded
from vpsci_ros.world import EPISODE, EVENT
from vpsci_ros.world.transition import TRANSITION


def random_records(dtype: np.dtype, count: int, seed: int = 1) -> np.ndarray:
    """Records of arbitrary but finite content."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, dtype)
    for name in dtype.names:
        kind = rows[name].dtype
        drawn = rng.normal(size=rows[name].shape) * 100 if kind.kind == "f" else rng.integers(0, 200, rows[name].shape)
        rows[name] = drawn.astype(kind)
    return rows


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def test_ros_reads_what_a_node_writes_of_a_state_and_writes_the_same() -> None:
    state, frame = random_records(EPISODE, 3), np.array([True, False, True])
    data = state_bytes(state, frame, 2**30)
    message = deserialize_message(data, WorldState)
    assert (message.tick, message.dt, message.header.frame_id) == (2**30, 0.05, "map")
    assert message.header.stamp == convert.stamp(2**30, 0.05)
    fields = layout.world_state_fields(state, frame)
    kinds = WorldState.get_fields_and_field_types().items()
    assert set(fields) == {name for name, kind in kinds if kind.startswith("sequence")}
    for name, values in fields.items():
        assert layout.values(getattr(message, name)).tobytes() == values.tobytes(), name
    _, again = rewritten("vpsci_msgs/msg/WorldState", serialize_message(message), "/world/state")
    assert data == padded(again, 4)


@pytest.mark.parametrize("batch", [1, 2, 3])
def test_ros_reads_what_a_node_writes_of_an_answer_and_writes_the_same(batch: int) -> None:
    rng, header = np.random.default_rng(batch), WireHeader(3, 5, "left/map")
    pairs, critical = rng.random((batch, 2)), rng.random(batch) < 0.5
    safety = write_safety_state(SafetyContent(header, 7, *pairs.T, critical))
    action = write_action(ActionContent(header, 7, *pairs.T, 9))
    for data, kind in ((safety, SafetyState), (action, AgentAction)):
        message = deserialize_message(data, kind)
        name = f"vpsci_msgs/msg/{kind.__name__}"
        assert data == padded(rewritten(name, serialize_message(message), name)[1], 4)
        assert (message.tick, message.header.frame_id, message.header.stamp.nanosec) == (7, "left/map", 5)
    assert message.longitudinal.tolist() == pairs[:, 0].tolist()
    assert message.policy_version == 9


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_ros_reads_what_a_node_writes_of_events_and_writes_the_same(count: int) -> None:
    events = random_records(EVENT, count)
    data = write_events(events, WireHeader(3, 5, "map"), 2)
    message = deserialize_message(data, EpisodeEvent)
    assert data == rewritten("vpsci_msgs/msg/EpisodeEvent", serialize_message(message), "/episode/event")[1]
    assert (message.tick, message.header.stamp.sec, message.header.frame_id) == (2, 3, "map")
    filled = [n for n, kind in EpisodeEvent.get_fields_and_field_types().items() if kind.startswith("sequence")]
    assert set(filled) == set(EVENT.names)
    for name in filled:
        assert layout.values(getattr(message, name)).tobytes() == events[name].tobytes(), name


def test_transitions_come_back_bit_for_bit() -> None:
    rows = random_records(TRANSITION, 6)
    rows["last"] = [0, 1, 0, 0, 1, 0]
    for name in ("next_curvttc", "next_vehicle_observation", "next_pedestrian_observation"):
        rows[name][rows["last"] == 0] = 0.0
    rows["number"] = np.arange(100, 106)
    rows["vehicle_policy_version"] = 3
    rows["pedestrian_policy_version"] = 4
    message = over_the_wire(convert.transition_message(rows, tick=2, period=0.05))
    assert layout.transitions(message).tobytes() == rows.tobytes()
    for name in layout.sequences(
        layout.own_definition("Transition")
    ):  # what the step after holds, of the two last ones alone
        each, rest = divmod(len(getattr(message, name)), 2 if name.startswith("next_") else 6)
        assert each > 0, name
        assert rest == 0, name


def test_odometry_speaks_in_the_childs_frame() -> None:
    state = np.zeros(1, EPISODE)
    state["vehicle_heading"], state["vehicle_speed"], state["vehicle_curvature"] = np.pi / 2, 4.0, 0.1
    state["pedestrian_vx"], state["pedestrian_vy"] = 0.0, -1.5
    vehicle, pedestrian = odometry_messages(state[0], convert.Header(frame_id="map"))
    assert vehicle.child_frame_id == "vehicle/base_link"
    assert (vehicle.twist.twist.linear.x, vehicle.twist.twist.linear.y) == (4.0, 0.0)
    assert vehicle.twist.twist.angular.z == pytest.approx(0.4)  # yaw rate = speed * curvature
    assert vehicle.pose.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
    assert pedestrian.twist.twist.linear.x == pytest.approx(1.5)
    assert pedestrian.pose.pose.orientation.z == pytest.approx(np.sin(-np.pi / 4))
