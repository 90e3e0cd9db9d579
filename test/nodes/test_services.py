"""The world by services and by parameters: paused, stepped, paced otherwise, all while it runs."""

from collections.abc import Callable
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nodes.stage import PATIENCE, Stage, overrides
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from vpsci_msgs.msg import WorldState
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.world_simulator import WorldSimulator

RULES = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}


class Session(Stage):
    """A rule-based world and its monitor in one process, and a node that calls and listens."""

    def __init__(self, context: Context, **settings: Any) -> None:
        chosen = RULES | {"scenarios": [1], "episodes": 2, "batch": 1} | settings
        self.world = WorldSimulator(context=context, parameter_overrides=overrides(**chosen))
        super().__init__(context, self.world, SafetyMonitor(context=context), executor=EventsExecutor)
        self.ticks: list[int] = []
        self.reported: dict[str, list[DiagnosticArray]] = {}
        self.peer.create_subscription(WorldState, "world/state", self._on_state, 1000)
        self.peer.create_subscription(DiagnosticArray, "diagnostics", self._on_diagnostics, 1000)

    def _on_state(self, message: WorldState) -> None:
        self.ticks.append(message.tick)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.reported.setdefault(message.status[0].name, []).append(message)


@pytest.fixture
def begin(context: Context, closed: Callable[[Any], Any]) -> Callable[..., Session]:
    return lambda **settings: closed(Session(context, **settings))


def test_a_paused_world_waits_for_steps_and_takes_one_tick_for_each(begin: Callable[..., Session]) -> None:
    session = begin(action_timeout=0.2, episodes=1, episode_time=3.0)
    assert session.call(SetBool, "world/pause", data=True).success
    session.spin_until(lambda: session.ticks == [0])
    for step in (1, 2, 3):
        answer = session.call(Trigger, "world/step")
        assert answer.success, answer.message
        session.spin_until(lambda: len(session.ticks) > step)  # noqa: B023 - called at once
    assert session.ticks == [0, 1, 2, 3]
    for _ in range(50):
        session.executor.spin_once(timeout_sec=0.01)  # longer than action_timeout: nothing is missed while paused
    assert session.ticks == [0, 1, 2, 3]
    assert session.world.counts.safety_answers_missing == 0
    assert session.call(SetBool, "world/pause", data=False).success
    session.spin_until(lambda: session.world.finished)
    assert session.ticks == list(range(len(session.ticks)))


def test_parameters_that_may_change_do_and_bad_values_are_refused_with_the_reason(
    begin: Callable[..., Session],
) -> None:
    world = begin(real_time_factor=1.0).world

    def change(name: str, value: Any) -> str:
        (result,) = world.set_parameters([Parameter(name, value=value)])
        return "" if result.successful else result.reason

    assert change("real_time_factor", 2.0) == ""
    assert 25_000_000 in [timer.timer_period_ns for timer in world.timers]
    assert "read-only" in change("batch", 2)
    assert "real_time_factor" in change("real_time_factor", -1.0)
    assert "expected 'Type.DOUBLE' got 'Type.STRING'" in change("real_time_factor", "fast")
    assert "action_timeout" in change("action_timeout", float("nan"))
    assert world.get_parameter("real_time_factor").value == 2.0


def test_a_shorter_time_to_wait_for_answers_counts_at_the_present_tick(begin: Callable[..., Session]) -> None:
    session = begin(vehicle_driver="external", action_timeout=PATIENCE, episodes=1, episode_time=0.5)
    session.peer.create_publisher(AccelStamped, "vehicle/cmd_accel", 10)  # which says nothing
    session.spin_until(lambda: session.ticks[:1] == [0])
    session.world.set_parameters([Parameter("action_timeout", value=0.01)])
    session.spin_until(lambda: session.world.finished)


def test_a_report_tells_the_rate_of_ticks_and_simulated_time(begin: Callable[..., Session]) -> None:
    session = begin(real_time_factor=1.0)
    session.spin_until(
        lambda: {"world_simulator", "safety_monitor"} <= set(session.reported) and len(session.ticks) > 30
    )
    session.spin_until(  # a report of a second in which the machine was busy may give fewer
        lambda: 10 <= int(value(session.reported["world_simulator"][-1], "ticks_per_second")) <= 25
    )
    world = session.reported["world_simulator"][-1]
    assert world.header.stamp.sec * 20 + world.header.stamp.nanosec / 5e7 == int(value(world, "tick"))


def value(message: DiagnosticArray, key: str) -> str:
    return next(pair.value for pair in message.status[0].values if pair.key == key)
