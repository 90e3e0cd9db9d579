"""The nodes and driving systems that answer the world's ticks: their messages, and whose are missing."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from geometry_msgs.msg import AccelStamped
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.time import Time
from std_msgs.msg import Header

from vpsci_msgs.msg import VehicleControl
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.external_driver import ExternalDriver
from vpsci_ros.lockstep.lock_step import SAFETY, LockStep
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.failures import ADS, UNMATCHED
from vpsci_ros.nodes.topics import COMMANDS
from vpsci_ros.nodes.world_outputs import WorldOutputs
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import read_action, read_safety_state
from vpsci_ros.wire.layout import MAP, WORLD

ANNOUNCED_PATIENCE = 3.0  # [s] to wait for announced readers of the state that have not subscribed yet


class Respondents:
    """The input of the world: `/safety/state`, the agents' actions and an external driving system's commands.

    :param answered: called after each message, whether it was taken or refused.
    """

    def __init__(self, node: GraphNode, lock_step: LockStep, answered: Callable[[], None]) -> None:
        self._node = node
        self._lock_step = lock_step
        self._answered = answered
        self._names = {SAFETY: "safety_monitor"} | ({"vehicle": ADS} if lock_step.external else {})
        self._inputs = {"safety_monitor": self._listen("/safety/state", self._take_safety)}
        for names, agents in (("{}_policy", lock_step.policies), ("an external {}", lock_step.walkers)):
            for agent in agents:
                take = partial(self._take_action, agent)
                self._names[agent] = names.format(agent)
                self._inputs[self._names[agent]] = self._listen(f"/{agent}/action", take)
        self._all_here_since: float | None = None
        self._commands = []
        if lock_step.external:
            self._commands = [
                self._listen("/vehicle/cmd_accel", self._take_acceleration, COMMANDS),
                self._listen("/vehicle/cmd_control", self._take_control, COMMANDS),
            ]
            lock_step.external.present = self.commanded

    def commanded(self) -> bool:
        """Return whether any program has a publisher of commands to the vehicle."""
        return any(given.get_publisher_count() for given in self._commands)

    def missing(self, outputs: WorldOutputs) -> set[str]:
        """Return the nodes and readers that the world waits for before its first tick; empty: it may begin.

        Nodes that have to answer must be there, and the readers of `outputs`. Readers that are only announced are
        waited for at most `ANNOUNCED_PATIENCE` longer.
        """
        absent, now = self._absent() | outputs.absent(), time.monotonic()
        self._all_here_since = None if absent else self._all_here_since or now
        if self._all_here_since and now - self._all_here_since < ANNOUNCED_PATIENCE:
            return self._not_subscribed() | outputs.unread()
        return absent

    def _absent(self) -> set[str]:
        """Return the nodes whose answers the world needs and that do not publish yet."""
        absent = {name for name, given in self._inputs.items() if not given.get_publisher_count()}
        return absent | ({ADS, *self._unmatched()} if self._commands and not self.commanded() else set())

    def _unmatched(self) -> Iterator[str]:
        """Yield, in words, each publisher of commands that the world cannot read for its quality of service (QoS)."""
        for given in self._commands:
            for writer in self._node.get_publishers_info_by_topic(given.topic_name):
                fits, reason = qos_check_compatible(writer.qos_profile, given.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    reason = reason.removeprefix("ERROR: ").removesuffix(";")
                    yield f"{writer.node_name} {UNMATCHED} {given.topic_name} by its QoS ({reason})"

    def unanswered(self) -> set[str]:
        """Return the nodes that have not answered the present tick yet."""
        return {self._names[sender] for sender in self._lock_step.unanswered}

    def _not_subscribed(self) -> set[str]:
        """Return "NODE to subscribe to /TOPIC" for each node that publishes answers but does not read the ticks yet."""
        state, odometry = self._node.full_name(WORLD), self._node.full_name("/vehicle/odometry")
        found, unaware = self._not_reading(self._inputs.values(), state), self._not_reading(self._commands, state)
        return found | (self._not_reading(self._commands, odometry) if unaware else set())

    def _not_reading(self, inputs: Iterable[Subscription], topic: str) -> set[str]:
        """Return "NODE to subscribe to TOPIC" for each publisher of `inputs` that does not."""
        readers = self._node.get_subscriptions_info_by_topic(topic)
        known = {(reader.node_namespace, reader.node_name) for reader in readers}
        writers = [each for given in inputs for each in self._node.get_publishers_info_by_topic(given.topic_name)]
        missing = (each.node_name for each in writers if (each.node_namespace, each.node_name) not in known)
        return {f"{name} to subscribe to {topic}" for name in missing}

    def _listen(self, topic: str, take: Callable[[Any], None], qos: QoSProfile | None = None) -> Subscription:
        """Subscribe: `take` submits a message to the lock-step, or refuses it; either way the world may go on."""

        def submit(message: Any) -> None:
            self._node.intake.read(topic, take, message)
            self._answered()

        return self._node.input(topic, None, submit, qos, raw=qos is None)

    def _take_safety(self, data: bytes) -> None:
        answer = read_safety_state(data)
        self._lock_step.take_assessment(answer.tick, lambda tick: layout.assessment(answer, tick))

    def _take_action(self, agent: str, data: bytes) -> None:
        topic = f"/{agent}/action"
        answer = read_action(data, topic)
        self._lock_step.take_action(
            answer.tick, agent, answer.policy_version, lambda tick: layout.action(answer, len(tick.state), topic)
        )

    def _take_acceleration(self, message: AccelStamped) -> None:
        values, frame = (message.accel.linear.x, message.accel.linear.y), message.header.frame_id
        if (external := self._driver()) is not None:
            own = vehicle_frames(self._node.frame_prefix)
            with _named("(linear.x, linear.y)"):
                if frame not in own:
                    external.refuse(values, f"its frame is {frame!r}; expected one of {', '.join(map(repr, own))}")
                external.accelerate(values, command_stamp(message.header))

    def _take_control(self, message: VehicleControl) -> None:
        values = message.steer, message.throttle, message.brake
        if (external := self._driver()) is not None:
            with _named("(steer, throttle, brake)"):
                external.control(values, command_stamp(message.header), message.tick)

    def _driver(self) -> ExternalDriver | None:
        """Return the external driver, which takes commands; before the first tick, count a command and return None."""
        if self._lock_step.tick is None:
            self._lock_step.early_command()
            return None
        return self._lock_step.external


@contextmanager
def _named(fields: str) -> Iterator[None]:
    """Put the names of the refused values' fields in front of the message of an `InvalidInput` in the block."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"{fields} {error}") from None


def vehicle_frames(prefix: str) -> tuple[str, ...]:
    """Return the allowed `frame_id`s of an acceleration command: "", the odometry's frame, and the vehicle's.

    A driving system that copies the odometry's header, to say which tick it answers, has the frame `map` there.
    """
    return "", MAP, "base_link", "vehicle/base_link", *([f"{prefix}vehicle/base_link"] if prefix else [])


def command_stamp(header: Header) -> int | None:
    """Return the simulated time [ns] that a command answers; None, the present tick, if no stamp was set.

    A header of tick 0 has the stamp 0, too: its frame `map` distinguishes it from an empty header.
    """
    stamp = int(Time.from_msg(header.stamp).nanoseconds)
    return None if stamp == 0 and header.frame_id != MAP else stamp
