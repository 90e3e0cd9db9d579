"""An external driving system at the wheel: its commands checked and handed to the world, one tick at a time."""

from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import AccelStamped
from numpy.typing import NDArray

from vpsci_msgs.msg import VehicleControl
from vpsci_ros.nodes.base import GraphNode

LARGEST_ACCELERATION = 50.0  # [m/s2] beyond any vehicle's: a sign of wrong units


class ExternalVehicle:
    """The latest good command for the present tick, from `/vehicle/cmd_accel` or `/vehicle/cmd_control`.

    A command that is not finite, out of range or stamped before the present tick is refused with a throttled warning
    and counted. A stamp of zero (or tick 0) means the present tick.

    :param counts: where refused commands are counted.
    :param heard: called when a good command has come.
    """

    def __init__(self, node: GraphNode, counts: Counter[str], heard: Callable[[], None]) -> None:
        self._node = node
        self._counts = counts
        self._heard = heard
        self._tick, self._nanoseconds = 0, 0
        self._not_asked: deque[tuple[int, int]] = deque(maxlen=8)  # tick and time of the last ones without an episode
        self.acceleration: NDArray[np.float64] | None = None
        self.control: NDArray[np.float64] | None = None
        self.inputs = [
            node.input("/vehicle/cmd_accel", self._on_acceleration),
            node.input("/vehicle/cmd_control", self._on_control),
        ]

    @property
    def answered(self) -> bool:
        """Whether there is a command for the present tick."""
        return self.acceleration is not None or self.control is not None

    def begin(self, tick: int, nanoseconds: int, *, asked: bool = True) -> None:
        """Forget the last tick's command; the present one begins at `nanoseconds` of simulated time.

        :param asked: whether an episode runs; an answer to a tick without one is neither used nor held against anybody.
        """
        self._tick, self._nanoseconds = tick, nanoseconds
        if not asked:
            self._not_asked.append((tick, nanoseconds))
        self.acceleration = self.control = None

    def _on_acceleration(self, message: AccelStamped) -> None:
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        if any(stamp == nanoseconds for _, nanoseconds in self._not_asked):
            return
        linear = message.accel.linear
        values = np.array([[linear.x, linear.y]])
        late = 0 < stamp < self._nanoseconds
        if self._good(values, np.abs(values) <= LARGEST_ACCELERATION, late, "/vehicle/cmd_accel (linear.x, linear.y)"):
            self.acceleration = values
            self._heard()

    def _on_control(self, message: VehicleControl) -> None:
        if any(message.tick == tick for tick, _ in self._not_asked):
            return
        values = np.array([[message.steer, message.throttle, message.brake]])
        inside = (values >= [-1.0, 0.0, 0.0]) & (values <= 1.0)
        late = 0 < message.tick < self._tick
        if self._good(values, inside, late, "/vehicle/cmd_control (steer, throttle, brake)"):
            self.control = values
            self._heard()

    def _good(self, values: NDArray[Any], inside: NDArray[np.bool_], late: bool, what: str) -> bool:
        reason = "it answers an earlier tick" if late else "" if bool(inside.all()) else "out of range or not finite"
        if reason:
            self._counts["vehicle_commands_refused"] += 1
            text = f"refused {what} = {values[0].tolist()} at tick {self._tick}: {reason}"
            self._node.get_logger().warning(text, throttle_duration_sec=5.0)
        return not reason
