"""What the graph's own nodes cannot have sent is refused, field by field."""

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import layout, received
from vpsci_ros.world.state import EPISODE, EVENT, FINISHED, RUNNING


def state_message(**changed: Any) -> SimpleNamespace:
    state = np.zeros(2, EPISODE)
    state["status"], state["scenario"] = RUNNING, 1
    fields = layout.world_state_fields(state, np.ones(2, bool))
    fields = {name: values.copy() for name, values in fields.items()}
    return SimpleNamespace(tick=4, **(fields | changed))


def event_message(**changed: Any) -> SimpleNamespace:
    events = np.zeros(1, EVENT)
    events["kind"], events["outcome"] = FINISHED, 1
    return SimpleNamespace(tick=4, **(layout.event_fields(events) | changed))


def test_a_state_of_the_world_is_taken_as_it_is() -> None:
    tick = received.world_state(state_message())
    assert (tick.number, len(tick.state), tick.policy_frame.all()) == (4, 2, True)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"vehicle_x": np.zeros(3)}, "expected 2 entries in vehicle_x, got 3"),
        ({"vehicle_x": np.array([0.0, np.nan])}, "vehicle_x of slot 1: expected a number within 1e.08, got nan"),
        ({"pedestrian_vy": np.array([np.inf, 0.0])}, "pedestrian_vy of slot 0"),
        ({"vehicle_speed": np.array([1e300, 0.0])}, "vehicle_speed of slot 0"),
        ({"status": np.array([1, 9], np.uint8)}, "status: expected codes from 0 to 2, got 9"),
    ],
)
def test_a_state_that_no_world_sends_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        received.world_state(state_message(**changed))


def test_a_state_without_episodes_is_refused() -> None:
    empty = {name: np.zeros(0, EPISODE[name]) for name in EPISODE.names or ()}
    with pytest.raises(InvalidInput, match="expected at least one episode"):
        received.world_state(SimpleNamespace(tick=0, policy_frame=np.zeros(0, np.uint8), **empty))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"slot": np.zeros(2, np.uint32)}, "expected 1 entries in slot, got 2"),
        ({"outcome": np.array([200], np.uint8)}, "outcome: expected codes from 0 to 4, got 200"),
        ({"kind": np.array([0], np.uint8)}, "kind: expected codes from 1 to 8, got 0"),
    ],
)
def test_events_that_are_ragged_or_unknown_are_refused(changed: dict[str, Any], message: str) -> None:
    assert layout.events(event_message())["outcome"] == [1]
    with pytest.raises(InvalidInput, match=message):
        layout.events(event_message(**changed))


def test_a_curvttc_that_is_not_a_number_is_refused() -> None:
    message = SimpleNamespace(curvttc=np.array([np.nan]), distance=np.ones(1), critical=np.ones(1, np.uint8))
    with pytest.raises(InvalidInput, match="curvttc of slot 0 is not a number"):
        layout.safety_state(message, 1)
    with pytest.raises(InvalidInput, match="expected 2 entries in curvttc, got 1"):
        layout.safety_state(message, 2)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (struct.pack("<4xiI", -1, 0), "expected a stamp from 0 s on, got -1 s"),
        (struct.pack("<4xiI", 3, 1_000_000_000), "and 1000000000 ns"),
        (b"\0" * 11, "expected a message of at least 12 bytes with a stamp, got 11"),
    ],
)
def test_a_message_without_a_time_is_refused(data: bytes, message: str) -> None:
    assert received.stamp("/clock", struct.pack("<4xiI", 3, 5)) == 3_000_000_005
    with pytest.raises(InvalidInput, match=message):
        received.stamp("/clock", data)
