"""Those who answer the world's ticks: their messages, handed in to the lock-step; and who of them is not there yet."""

from collections.abc import Callable, Iterable
from functools import partial

from geometry_msgs.msg import AccelStamped
from rclpy.subscription import Subscription
from rclpy.time import Time
from std_msgs.msg import Header

from vpsci_msgs.msg import AgentAction, SafetyState, VehicleControl
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.serialized import action, safety_state
from vpsci_ros.nodes.topics import COMMANDS
from vpsci_ros.wire import layout
from vpsci_ros.wire.layout import MAP, WORLD
from vpsci_ros.world.lockstep import LockStep


class Respondents:
    """`/safety/state`, the agents' actions and an external driving system's commands.

    :param answered: called when an answer has come.
    """

    def __init__(self, node: GraphNode, lock_step: LockStep, answered: Callable[[], None]) -> None:
        self._node = node
        self._lock_step = lock_step
        self._answered = answered
        self._inputs = {"safety_monitor": node.input("/safety/state", self._on_safety, raw=True)}
        for agent in lock_step.policies:
            self._inputs[f"{agent}_policy"] = self._listen(agent)
        for agent in lock_step.walkers:
            self._inputs[f"an external {agent}"] = self._listen(agent)
        self._commands = []
        if lock_step.external:
            self._commands = [
                node.input("/vehicle/cmd_accel", self._on_acceleration, COMMANDS),
                node.input("/vehicle/cmd_control", self._on_control, COMMANDS),
            ]
            lock_step.external.present = self.commanded

    def commanded(self) -> bool:
        """Return whether anybody offers commands to the vehicle."""
        return any(given.get_publisher_count() for given in self._commands)

    def absent(self) -> set[str]:
        """Return whom the world cannot do without and who does not speak yet."""
        absent = {name for name, given in self._inputs.items() if not given.get_publisher_count()}
        return absent | ({"an external driving system"} if self._commands and not self.commanded() else set())

    def deaf(self) -> set[str]:
        """Return the nodes that answer but are not yet known to read the world's state, or of a vehicle to drive."""
        state, odometry = self._node.full_name(WORLD), self._node.full_name("/vehicle/odometry")
        found = self._deaf(self._inputs.values(), state)
        return found | (self._deaf(self._commands, odometry) if self._deaf(self._commands, state) else set())

    def _deaf(self, inputs: Iterable[Subscription], topic: str) -> set[str]:
        readers = self._node.get_subscriptions_info_by_topic(topic)
        known = {(reader.node_namespace, reader.node_name) for reader in readers}
        writers = [each for given in inputs for each in self._node.get_publishers_info_by_topic(given.topic_name)]
        deaf = (each.node_name for each in writers if (each.node_namespace, each.node_name) not in known)
        return {f"{name} to subscribe to {topic}" for name in deaf}

    def _listen(self, agent: str) -> Subscription:
        return self._node.input(f"/{agent}/action", partial(self._on_action, agent), raw=True)

    def _on_safety(self, message: SafetyState | bytes) -> None:
        def take() -> None:
            told = safety_state(message)
            self._lock_step.take_assessment(told.tick, lambda tick: layout.assessment(told, tick))

        self._hand_in("/safety/state", take)

    def _on_action(self, agent: str, message: AgentAction | bytes) -> None:
        topic = f"/{agent}/action"

        def take() -> None:
            told = action(message, topic)
            self._lock_step.take_action(
                told.tick,
                agent,
                told.policy_version,
                lambda tick: layout.action(told, len(tick.state), topic),
            )

        self._hand_in(topic, take)

    def _on_acceleration(self, message: AccelStamped) -> None:
        assert self._lock_step.external is not None
        external, values = self._lock_step.external, (message.accel.linear.x, message.accel.linear.y)
        frame, own = message.header.frame_id, vehicle_frames(self._node.frame_prefix)

        def take() -> None:
            if frame not in own:
                external.refuse(values, f"its frame is {frame!r}; expected one of {', '.join(map(repr, own))}")
            external.accelerate(values, command_stamp(message.header))

        self._command("/vehicle/cmd_accel", take, " (linear.x, linear.y)")

    def _on_control(self, message: VehicleControl) -> None:
        assert self._lock_step.external is not None
        values = message.steer, message.throttle, message.brake
        take = partial(self._lock_step.external.control, values, command_stamp(message.header), message.tick)
        self._command("/vehicle/cmd_control", take, " (steer, throttle, brake)")

    def _command(self, topic: str, take: Callable[[], None], fields: str) -> None:
        if self._lock_step.tick is None:
            self._lock_step.early_command()
        else:
            self._hand_in(topic, take, fields)

    def _hand_in(self, topic: str, take: Callable[[], None], fields: str = "") -> None:
        try:
            take()
        except InvalidInput as error:
            who = f" ({', '.join(self._node.intake.publishers(topic))} publish it)"
            name = f"{self._node.full_name(topic)}{fields}"
            self._node.get_logger().warning(f"refused {name}: {error}{who}", throttle_duration_sec=5.0)
        self._answered()


def vehicle_frames(prefix: str) -> tuple[str, ...]:
    """Return the frames that a command along the vehicle may name: none, the vehicle's, or the odometry's.

    Who copies the header of the odometry, to say which tick is answered, has its frame `map` there.
    """
    return "", MAP, "base_link", "vehicle/base_link", *([f"{prefix}vehicle/base_link"] if prefix else [])


def command_stamp(header: Header) -> int | None:
    """Return which simulated time [ns] a command answers; None for the present, where nobody has set a stamp.

    A header of tick 0 has the stamp 0, too: its frame `map` tells it from one that was left as it was made.
    """
    stamp = int(Time.from_msg(header.stamp).nanoseconds)
    return None if stamp == 0 and header.frame_id != MAP else stamp
