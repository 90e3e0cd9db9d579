"""The lock-step sends and takes the bytes that ROS itself makes of a message, and other bytes are refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nodes.stage import action_message
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from vpsci_msgs.msg import AgentAction, SafetyState, WorldState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import convert, serialized
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import (
    SerializedAction,
    SerializedSafety,
    read_action,
    read_safety_state,
    write_action,
    write_safety_state,
)
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.padding import zeroed
from vpsci_ros.wire.world_state import SerializedState, as_read, read_world_state, write_world_state
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.tick import Tick

PERIOD, TICK = 0.05, 2**32 + 5
BATCHES = pytest.mark.parametrize("batch", [1, 2, 3, 7, 64])
FRAMES = pytest.mark.parametrize("frame", ["map", "", "left/vehicle"])


def some_state(batch: int) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
    """Return EPISODE[B] records of any bits, and policy frames."""
    rng = np.random.default_rng(batch)
    return np.frombuffer(rng.bytes(EPISODE.itemsize * batch), EPISODE).copy(), rng.random(batch) < 0.5


def headers(frame: str) -> tuple[Header, WireHeader]:
    stamp = convert.stamp(TICK, PERIOD)
    return Header(stamp=stamp, frame_id=frame), WireHeader(stamp.sec, stamp.nanosec, frame)


def one_running(**changed: Any) -> WorldState:
    state = np.zeros(1, EPISODE)
    state["status"], state["scenario"] = RUNNING, 1
    return convert.filled(convert.world_state_message(state, np.ones(1, bool), 3, PERIOD), changed)


@BATCHES
@FRAMES
def test_a_state_is_written_as_ros_writes_it_and_read_as_it_was(batch: int, frame: str) -> None:
    state, policy_frame = some_state(batch)
    message, header = convert.world_state_message(state, policy_frame, TICK, PERIOD), headers(frame)
    message.header = header[0]
    data = serialize_message(message)
    sent = SerializedState(header[1], Tick(TICK, state, policy_frame), PERIOD)
    assert write_world_state(sent) == zeroed("vpsci_msgs/msg/WorldState", data, "/world/state")
    back, by_fields = read_world_state(data), layout.world_state(message)
    assert back is not None
    assert (back.header, back.period, back.tick.number) == (header[1], PERIOD, TICK)
    assert back.tick.state.tobytes() == by_fields.state.tobytes()
    assert back.tick.policy_frame.tolist() == policy_frame.tolist()
    here = as_read(sent)
    assert here.tick.state.tobytes() == back.tick.state.tobytes()
    assert not np.shares_memory(here.tick.state, state)
    assert (here.header, here.period, here.tick.number) == (header[1], PERIOD, TICK)
    assert here.tick.policy_frame.tolist() == policy_frame.tolist()


@BATCHES
@FRAMES
def test_a_safety_state_is_written_as_ros_writes_it_and_read_as_it_was(batch: int, frame: str) -> None:
    rng, (header, start) = np.random.default_rng(batch), headers(frame)
    values = rng.random(batch), rng.random(batch), rng.random(batch) < 0.5
    data = serialize_message(convert.safety_message(header, TICK, *values))
    written = write_safety_state(SerializedSafety(start, TICK, *values))
    assert written == zeroed("vpsci_msgs/msg/SafetyState", data, "/safety/state")
    back = read_safety_state(data)
    assert back is not None
    assert (back.header, back.tick) == (start, TICK)
    for given, found in zip(values, back[2:], strict=True):
        assert np.array_equal(given, found)


@BATCHES
@FRAMES
def test_an_action_is_written_as_ros_writes_it_and_read_as_it_was(batch: int, frame: str) -> None:
    header, start = headers(frame)
    pairs = np.random.default_rng(batch).random((batch, 2))
    data = serialize_message(action_message(header, TICK, pairs, 9))
    written = write_action(SerializedAction(start, TICK, *pairs.T, 9))
    assert written == zeroed("vpsci_msgs/msg/AgentAction", data, "/vehicle/action")
    back = read_action(data)
    assert back is not None
    assert (back.header, back.tick, back.policy_version) == (start, TICK, 9)
    assert np.array_equal(layout.action(back, batch, "/vehicle/action"), pairs)


def test_a_message_that_breaks_off_anywhere_is_refused() -> None:
    _, start = headers("map")
    ones = np.ones(2)
    state, policy_frame = some_state(2)
    whole = [
        (serialized.shown, write_world_state(SerializedState(start, Tick(1, state, policy_frame), PERIOD))),
        (serialized.safety_state, write_safety_state(SerializedSafety(start, 1, ones, ones, ones > 0))),
        (
            lambda data: serialized.action(data, "/vehicle/action"),
            write_action(SerializedAction(start, 1, ones, ones, 1)),
        ),
    ]
    for read, data in whole:
        for end in range(len(data)):
            with pytest.raises(InvalidInput, match="bytes that are no"):
                read(data[:end])


@pytest.mark.parametrize("place", range(0, 260, 4))
def test_a_length_that_cannot_be_is_read_by_nobody(place: int) -> None:
    data = bytearray(serialize_message(one_running()))
    data[place : place + 4] = b"\xff\xff\xff\x7f"
    received = read_world_state(bytes(data))
    assert received is None or len(received.tick.state) == 1


def test_bytes_are_refused_in_the_words_in_which_the_message_is() -> None:
    for bad in (
        one_running(vehicle_x=np.zeros(2)),
        one_running(vehicle_x=np.array([np.nan])),
        one_running(status=np.array([9], np.uint8)),
        WorldState(),
    ):
        said = []
        for given in (bad, serialize_message(bad)):
            with pytest.raises(InvalidInput) as refusal:
                serialized.shown(given)
            said.append(str(refusal.value))
        assert said[0] == said[1]


def test_a_header_that_is_no_text_is_left_to_the_middleware() -> None:
    data = serialize_message(one_running())
    assert read_world_state(data.replace(b"map\0", b"\xff\xfe\xfd\0")) is None


def test_a_big_endian_message_is_left_to_the_middleware() -> None:
    data = serialize_message(one_running())
    assert read_world_state(b"\x00\x00" + data[2:]) is None


def test_empty_answers_are_read_as_empty() -> None:
    safety, action = read_safety_state(serialize_message(SafetyState())), read_action(serialize_message(AgentAction()))
    assert safety is not None
    assert action is not None
    assert [len(each) for each in (*safety[2:], *action[2:4])] == [0] * 5
    with pytest.raises(InvalidInput, match="expected 1 entries in curvttc, got 0"):
        layout.assessment(safety, Tick(0, np.zeros(1, EPISODE), np.ones(1, bool)))
    assert SimpleNamespace(**action._asdict()).policy_version == 0
