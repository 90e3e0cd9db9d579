"""What every tick sends is read as it was written, and what the graph's own nodes cannot have sent is refused."""

import contextlib
import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import (
    ActionContent,
    SafetyContent,
    read_action,
    read_safety_state,
    write_action,
    write_safety_state,
)
from vpsci_ros.wire.decoder import rewritten
from vpsci_ros.wire.header import WireHeader, stamp_of
from vpsci_ros.wire.world_state import StateContent, read_world_state, write_world_state
from vpsci_ros.world.state import EPISODE, EVENT, FINISHED, RUNNING
from vpsci_ros.world.tick import Tick

PERIOD, TICK = 0.05, 2**32 + 5
HEADER = WireHeader(7, 50_000_000, "left/map")


def running(batch: int = 2, **changed: Any) -> NDArray[np.void]:
    """Return EPISODE[B] records of running episodes, of which nothing else is 0."""
    state = np.zeros(batch, EPISODE)
    for k, name in enumerate(EPISODE.names or ()):
        state[name] = 1 + k + np.arange(batch)
    state["status"], state["pedestrian"] = RUNNING, 0
    for name, values in changed.items():
        state[name] = values
    return state


def written(state: NDArray[np.void]) -> bytes:
    return write_world_state(StateContent(HEADER, Tick(TICK, state, np.arange(len(state)) % 2 == 0), PERIOD))


@pytest.mark.parametrize("batch", [1, 2, 3, 7, 64])
def test_a_state_is_read_as_it_was_written(batch: int) -> None:
    header, tick, period = read_world_state(written(running(batch)))
    assert (header, period, tick.number) == (HEADER, PERIOD, TICK)
    assert tick.policy_frame.tolist() == (np.arange(batch) % 2 == 0).tolist()
    sent = [name for name in layout.sequences(layout.own_definition("WorldState")) if name != "policy_frame"]
    for name in EPISODE.names or ():
        assert tick.state[name].tolist() == (running(batch)[name].tolist() if name in sent else [0] * batch), name


@pytest.mark.parametrize("batch", [1, 2, 7])
def test_answers_are_read_as_they_were_written(batch: int) -> None:
    rng = np.random.default_rng(batch)
    safety = SafetyContent(HEADER, TICK, rng.random(batch), rng.random(batch), rng.random(batch) < 0.5)
    action = ActionContent(HEADER, TICK, rng.random(batch), rng.random(batch), 9)
    for given, back in (
        (safety, read_safety_state(write_safety_state(safety))),
        (action, read_action(write_action(action), "/vehicle/action")),
    ):
        assert back[:2] == given[:2]
        assert all(np.array_equal(*pair) for pair in zip(given[2:], back[2:], strict=True))


def test_a_message_that_breaks_off_anywhere_is_refused() -> None:
    ones = np.ones(2)
    whole = [
        (read_world_state, written(running())),
        (read_safety_state, write_safety_state(SafetyContent(HEADER, 1, ones, ones, ones > 0))[:-2]),
        (lambda data: read_action(data, "/vehicle/action"), write_action(ActionContent(HEADER, 1, ones, ones, 1))),
    ]
    for read, data in whole:
        for end in range(len(data) - 3 * (read is read_world_state)):  # behind the last field there are zeros
            with pytest.raises(InvalidInput):
                read(data[:end])


@pytest.mark.parametrize("place", range(4, 260, 4))
def test_a_length_that_cannot_be_is_refused_or_was_a_number(place: int) -> None:
    data = bytearray(written(running(1)))
    data[place : place + 4] = b"\xff\xff\xff\x7f"
    with contextlib.suppress(InvalidInput):
        assert len(read_world_state(bytes(data)).tick.state) == 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"vehicle_x": [0.0, np.nan]}, "vehicle_x of slot 1: expected a number within 1e.08, got nan"),
        ({"pedestrian_vy": [np.inf, 0.0]}, "pedestrian_vy of slot 0"),
        ({"vehicle_speed": [1e300, 0.0]}, "vehicle_speed of slot 0"),
        ({"status": [1, 9]}, "status: expected codes from 0 to 2, got 9"),
    ],
)
def test_a_state_that_no_world_sends_is_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        read_world_state(written(running(**changed)))


def test_a_ragged_state_an_empty_one_and_a_big_endian_one_are_refused() -> None:
    data = written(running(1))
    start = data.index(struct.pack("<d", PERIOD)) + 8
    for at, count, said in ((start, 0, "at least one episode"), (start + 8, 3, "expected 1 entries in episode")):
        with pytest.raises(InvalidInput, match=said):
            read_world_state(data[:at] + struct.pack("<I", count) + data[at + 4 :])
    with pytest.raises(InvalidInput, match="little-endian CDR"):
        read_world_state(b"\0\0" + data[2:])


def test_a_state_of_another_version_is_refused_in_words() -> None:
    other = layout.own_definition("WorldState") + "\nfloat64[] wind\n" + "=" * 80 + "\nMSG: std_msgs/Header\n"
    with pytest.raises(InvalidInput, match=r"BAG: a WorldState of another version, which differs in wind; read it"):
        read_world_state(written(running()), "BAG", other)


def test_a_curvttc_that_is_not_a_number_is_refused() -> None:
    none = SafetyContent(HEADER, 1, np.array([np.nan]), np.ones(1), np.ones(1, np.uint8))
    with pytest.raises(InvalidInput, match="curvttc of slot 0 is not a number"):
        layout.safety_state(none, 1)
    with pytest.raises(InvalidInput, match="expected 2 entries in curvttc, got 1"):
        layout.safety_state(none, 2)


def event_message(**changed: Any) -> Any:
    events = np.zeros(1, EVENT)
    events["kind"], events["outcome"] = FINISHED, 1
    return type("EpisodeEvent", (), {"tick": 4, **(layout.event_fields(events) | changed)})


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


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (struct.pack("<4xiI", -1, 0), "expected a stamp from 0 s on, got -1 s"),
        (struct.pack("<4xiI", 3, 1_000_000_000), "and 1000000000 ns"),
        (b"\0" * 11, "expected a message of at least 12 bytes, got 11"),
    ],
)
def test_a_message_without_a_time_is_refused(data: bytes, message: str) -> None:
    assert stamp_of("/clock", struct.pack("<4xiI", 3, 5)) == 3_000_000_005
    with pytest.raises(InvalidInput, match=message):
        stamp_of("/clock", data)


def test_a_message_that_is_written_once_more_has_zeros_between_its_fields() -> None:
    kind = "vpsci_msgs/msg/VehicleControl"
    clean = struct.pack("<4sIII2s2xQddd", b"\0\1\0\0", 1, 2, 2, b"a\0", 7, 0.5, 0.25, 0.0)
    dirty = clean.replace(b"a\0" + bytes(2), b"a\0" + b"\xaa" * 2) + b"\xbb"
    message, again = rewritten(kind, dirty, "/vehicle/cmd_control")
    assert again == clean
    assert (message.tick, message.steer) == (7, 0.5)
    with pytest.raises(InvalidInput, match="/vehicle/cmd_control: 20 bytes that are no vpsci_msgs/msg/VehicleControl"):
        rewritten(kind, clean[:20], "/vehicle/cmd_control")
