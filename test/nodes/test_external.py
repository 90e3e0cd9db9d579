"""A driving system of one's own drives in lock-step; what it says wrongly is refused, and the world goes on."""

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from nodes.stage import PATIENCE, Stage, overrides
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.qos import qos_profile_sensor_data

from vpsci_msgs.msg import EpisodeEvent, WorldState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.intervention import Intervention, write_changes
from vpsci_ros.nodes.failures import ADS, never_came
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.world_simulator import WorldSimulator
from vpsci_ros.world import World, WorldConfig, load_scenarios

SETTINGS = {"scenarios": [1], "episodes": 1, "batch": 1, "vehicle_driver": "external", "pedestrian_driver": "autopilot"}


class Drive(Stage):
    """A world, a monitor and a driving system in one process; `run` drives one episode and keeps what was published."""

    def __init__(self, context: Context, **settings: object) -> None:
        self.world = WorldSimulator(context=context, parameter_overrides=overrides(**SETTINGS | settings))
        super().__init__(context, self.world, SafetyMonitor(context=context), peer="ads", executor=EventsExecutor)
        self.speed: list[float] = []
        self.walked: list[tuple[float, float]] = []
        self.kinds: Counter[int] = Counter()
        self.peer.create_subscription(WorldState, "world/state", self._on_state, 1000)
        self.peer.create_subscription(EpisodeEvent, "episode/event", self._on_event, 1000)

    def answer(self, message_type: type, topic: str, make: Callable[[Odometry], object | None]) -> None:
        """Answer every odometry message by what `make` makes of it."""
        publisher = self.peer.create_publisher(message_type, topic, 1000)

        def on_odometry(odometry: Odometry) -> None:
            message = make(odometry)
            if message is not None:
                publisher.publish(message)

        self.peer.create_subscription(Odometry, "vehicle/odometry", on_odometry, 1000)

    @property
    def missing(self) -> int:
        return self.kinds[EpisodeEvent.VEHICLE_ACTION_MISSING]

    def run(self) -> None:
        self.spin_until(lambda: self.world.finished)

    def _on_state(self, message: WorldState) -> None:
        if message.status[0] != WorldState.STATUS_IDLE:
            self.speed.append(message.vehicle_speed[0])
            self.walked.append((message.pedestrian_x[0], message.pedestrian_y[0]))

    def _on_event(self, message: EpisodeEvent) -> None:
        self.kinds.update(message.kind)


@pytest.fixture
def drive(context: Context, closed: Callable[[Any], Any]) -> Callable[..., Drive]:
    return lambda **settings: closed(Drive(context, **settings))


def acceleration(odometry: Odometry, along: float) -> AccelStamped:
    message = AccelStamped(header=odometry.header)
    message.accel.linear.x = along
    return message


def test_braking_by_acceleration_stops_the_vehicle_and_never_reverses_it(drive: Callable[..., Drive]) -> None:
    session = drive(episode_time=6.0)
    session.answer(AccelStamped, "vehicle/cmd_accel", lambda odometry: acceleration(odometry, -3.0))
    session.run()
    first = session.speed[0]
    assert first > 1.0
    assert session.speed[10] == pytest.approx(max(0.0, first - 10 * 0.05 * 3.0), abs=1e-9)
    assert min(session.speed) == session.speed[100] == 0.0
    assert session.missing == 0


def test_the_node_makes_the_changes_in_a_file_forced_braking_and_a_head_start(
    drive: Callable[..., Drive], tmp_path: Path
) -> None:
    changes, starts = tmp_path / "changes.json", {(1, 0): (-0.5, 0.25)}
    write_changes(changes, starts, {(1, 0): Intervention(frame=4, forced=(-4.0, -4.0))})
    session = drive(episode_changes=str(changes), episode_time=0.5)
    session.answer(AccelStamped, "vehicle/cmd_accel", lambda odometry: acceleration(odometry, -1.0))
    session.run()
    assert np.diff(session.speed) / 0.05 == pytest.approx([-1.0] * 4 + [-4.0] * 2 + [-1.0] * 4)
    config = WorldConfig(vehicle_driver="external", pedestrian_driver="autopilot")
    drawn, timed = (World(config, load_scenarios([1]), [(1, 0)], 1, 1, head_starts=s).state[0] for s in ({}, starts))
    assert session.walked[0] == (timed["pedestrian_x"], timed["pedestrian_y"])
    assert session.walked[0] != (drawn["pedestrian_x"], drawn["pedestrian_y"])


def test_a_command_without_a_header_means_the_present_tick(drive: Callable[..., Drive]) -> None:
    session = drive(episode_time=0.5)
    session.answer(AccelStamped, "vehicle/cmd_accel", lambda _: AccelStamped())
    session.run()
    assert session.missing == 0


@pytest.mark.parametrize(("frame", "missing"), [("vehicle/base_link", 0), ("pedestrian/base_link", 10)])
def test_a_command_in_another_frame_than_the_vehicles_is_refused(
    drive: Callable[..., Drive], frame: str, missing: int
) -> None:
    session = drive(action_timeout=0.02 if missing else PATIENCE, episode_time=0.5)

    def make(odometry: Odometry) -> AccelStamped:
        message = AccelStamped()
        message.header.stamp, message.header.frame_id = odometry.header.stamp, frame
        return message

    session.answer(AccelStamped, "vehicle/cmd_accel", make)
    session.run()
    assert session.missing == missing


def test_commands_that_the_world_cannot_hear_for_their_quality_of_service_are_said_to_be_so(
    drive: Callable[..., Drive],
) -> None:
    session = drive()
    session.peer.create_publisher(AccelStamped, "vehicle/cmd_accel", qos_profile_sensor_data)
    session.spin_until(lambda: any("QoS" in each for each in session.world.awaited))
    assert ADS in session.world.awaited
    said = never_came(session.world.counts, 61.0, 60.0, session.world.awaited)
    assert re.search("ads cannot be heard on /.*cmd_accel by its QoS .Best effort publisher and reliable subscr", said)


def test_an_external_driver_of_many_episodes_at_once_is_refused(context: Context) -> None:
    with pytest.raises(InvalidInput, match="one episode at a time; got batch = 2"):
        WorldSimulator(context=context, parameter_overrides=overrides(**SETTINGS | {"batch": 2}))


FAST = {"external_mode": "real_time", "real_time_factor": 20.0}  # a tick each 2.5 ms


def test_silence_in_real_time_brings_the_vehicle_to_a_safe_stop_which_an_event_tells(
    drive: Callable[..., Drive],
) -> None:
    session = drive(**FAST, episode_time=10.0)
    keep = iter([0.0, 0.0, 0.0])
    session.answer(AccelStamped, "vehicle/cmd_accel", lambda odometry: given(odometry, next(keep, None)))
    session.run()
    braking = -np.diff(session.speed) / 0.05
    moving = braking[: int(np.argmin(session.speed)) - 1]
    begins = int(np.argmax(moving > 1e-6))
    assert np.allclose(moving[:begins], 0.0, atol=1e-9), "the last command holds until then"
    assert moving[begins : begins + 12] == pytest.approx(np.minimum(5.0, 5.0 * 0.05 * np.arange(1, 13)))
    assert session.speed[-1] == 0.0
    assert session.kinds[EpisodeEvent.SAFE_STOP] == 1
    assert session.world.counts.safe_stops == 1
    assert session.missing == 0


@pytest.mark.parametrize("settings", [{}, FAST])
def test_a_flood_of_commands_is_counted_and_stops_nothing(
    drive: Callable[..., Drive], settings: dict[str, object]
) -> None:
    session = drive(**settings, episode_time=0.5)
    publisher = session.peer.create_publisher(AccelStamped, "vehicle/cmd_accel", 1000)

    def flood(odometry: Odometry) -> None:
        for _ in range(50):
            publisher.publish(acceleration(odometry, -1.0))

    session.peer.create_subscription(Odometry, "vehicle/odometry", flood, 1000)
    session.run()
    assert len(session.speed) == 11
    assert session.world.counts.vehicle_commands_surplus + session.world.counts.vehicle_commands_refused > 200
    assert np.diff(session.speed)[2:] == pytest.approx(-0.05, abs=1e-9)


def given(odometry: Odometry, along: float | None) -> AccelStamped | None:
    return None if along is None else acceleration(odometry, along)
