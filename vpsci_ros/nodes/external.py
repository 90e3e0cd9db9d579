"""An external driving system at the wheel: its commands checked and held; a safe stop where it falls silent."""

from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from numpy.typing import NDArray

from vpsci_msgs.msg import VehicleControl
from vpsci_ros.config import ExternalConfig
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.world import EPISODE, EVENT
from vpsci_ros.world.events import NO_EVENTS
from vpsci_ros.world.state import RUNNING, SAFE_STOP

LARGEST_ACCELERATION = 50.0  # [m/s2] beyond any vehicle's: a sign of wrong units
Command = tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]  # acceleration [1, 2] or controls [1, 3]


class ExternalVehicle:
    """The command for the present tick, from `/vehicle/cmd_accel` or `/vehicle/cmd_control`.

    In lock-step the command has to answer the present tick, and the world waits for it. In real time the last good
    command holds; when it is older than `command_silence`, the vehicle brakes, more and more firmly, until commands
    come again.

    A command is refused, counted and told of in a throttled warning when it is not finite, out of range, for a tick
    that has not been, or too old: stamped before the present tick (lock-step), or longer than `command_silence` ago or
    before the last one (real time). A stamp of zero means the present.

    :param period: of a tick [s].
    :param counts: where commands are counted.
    :param heard: called when a good command has come.
    """

    def __init__(
        self,
        node: GraphNode,
        config: ExternalConfig,
        period: float,
        counts: Counter[str],
        heard: Callable[[], None],
    ) -> None:
        self.config = config
        self._node = node
        self._counts = counts
        self._heard = heard
        self._tick_time = round(period * 1e9)  # [ns]
        self._now = 0  # [ns] of simulated time, of the present tick
        self._stamp = 0  # [ns] of the latest command, where it is simulated time
        self._commanded: int | None = None  # [ns] simulated time at which the latest command came
        self._command: Command = (None, None)
        self._not_asked: deque[int] = deque(maxlen=8)  # [ns], the last ticks without an episode
        self._fresh = False
        self._given_up = False
        self._stopping = False
        self._inputs = [
            node.input("/vehicle/cmd_accel", self._on_acceleration),
            node.input("/vehicle/cmd_control", self._on_control),
        ]

    @property
    def real_time(self) -> bool:
        """Whether the world goes on at its own pace."""
        return self.config.external_mode == "real_time"

    @property
    def present(self) -> bool:
        """Whether anybody offers commands."""
        return any(given.get_publisher_count() for given in self._inputs)

    @property
    def answered(self) -> bool:
        """Whether the world need not wait at this tick; having waited in vain, it waits for nobody who is not there."""
        return self.real_time or self._fresh or (self._given_up and not self.present)

    def begin(self, tick: int, *, asked: bool = True) -> None:
        """Begin a tick; in lock-step, the last one's command is forgotten.

        :param asked: whether an episode runs; an answer to a tick without one is neither used nor held against anybody.
        """
        self._now = tick * self._tick_time
        if not asked:
            self._not_asked.append(self._now)
        if not self.real_time:
            self._given_up = not self._fresh and asked
            self._command = (None, None)
        elif self._commanded is None:
            self._commanded, self._command = self._now, (np.zeros((1, 2)), None)  # rolls until it hears otherwise
        self._fresh = False

    def drive(self, state: NDArray[np.void]) -> tuple[Command, NDArray[np.void]]:
        """Return the command to execute at the present tick, and the events to tell of, EVENT[n].

        :param state: EPISODE[1].
        """
        if not self.real_time or self._commanded is None or state["status"][0] != RUNNING:
            return self._command, NO_EVENTS
        silence = (self._now - self._commanded) / 1e9 - self.config.command_silence
        if silence <= 0.0:
            self._stopping = False
            return self._command, NO_EVENTS
        self._counts["safe_stop_ticks"] += 1
        braking = min(self.config.safe_stop_deceleration, self.config.safe_stop_jerk * silence)
        begins = not self._stopping or state["frame"][0] == 0
        self._stopping = True
        return (np.array([[-braking, 0.0]]), None), self._safe_stop(state) if begins else NO_EVENTS

    def _safe_stop(self, state: NDArray[np.void]) -> NDArray[np.void]:
        self._counts["safe_stops"] += 1
        text = f"no command for {self.config.command_silence:g} s: the vehicle brakes until commands come again"
        self._node.get_logger().warning(text, throttle_duration_sec=5.0)
        event = np.zeros(1, EVENT)
        for name in set(EVENT.names or ()) & set(EPISODE.names or ()):
            event[name] = state[name]
        event["kind"] = SAFE_STOP
        return event

    def _on_acceleration(self, message: AccelStamped) -> None:
        linear = message.accel.linear
        values = np.array([[linear.x, linear.y]])
        inside = np.abs(values) <= LARGEST_ACCELERATION
        stamp = _nanoseconds(message)
        if stamp in self._not_asked:
            return
        if self._good(values, inside, stamp, False, "/vehicle/cmd_accel (linear.x, linear.y)"):
            self._take((values, None), stamp)

    def _on_control(self, message: VehicleControl) -> None:
        values = np.array([[message.steer, message.throttle, message.brake]])
        inside = (values >= [-1.0, 0.0, 0.0]) & (values <= 1.0)
        stamp = message.tick * self._tick_time or _nanoseconds(message)
        early = message.tick * self._tick_time > self._now
        if stamp in self._not_asked:
            return
        if self._good(values, inside, stamp, early, "/vehicle/cmd_control (steer, throttle, brake)"):
            self._take((None, values), stamp)

    def _take(self, command: Command, stamp: int) -> None:
        self._counts["vehicle_commands"] += 1
        self._counts["vehicle_commands_surplus"] += self._fresh  # a second one at this tick
        self._command, self._commanded = command, self._now
        self._stamp = stamp if stamp <= self._now else 0  # a clock of its own says nothing of ticks
        self._fresh, self._given_up = True, False
        self._heard()

    def _good(self, values: NDArray[Any], inside: NDArray[np.bool_], stamp: int, early: bool, what: str) -> bool:
        reason = "" if bool(inside.all()) else "out of range or not finite"
        oldest = self._now
        if self.real_time:
            oldest = max(self._stamp, self._now - round(self.config.command_silence * 1e9))
        if early:
            reason = "it answers a tick that has not been"
        elif 0 < stamp < oldest:
            reason = "it answers an earlier tick"
        if reason:
            self._counts["vehicle_commands_refused"] += 1
            tick = self._now // self._tick_time
            text = f"refused {what} = {values[0].tolist()} at tick {tick}: {reason}"
            self._node.get_logger().warning(text, throttle_duration_sec=5.0)
        return not reason


def _nanoseconds(message: AccelStamped | VehicleControl) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
