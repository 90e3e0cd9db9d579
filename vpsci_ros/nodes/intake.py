"""What a node takes in: who speaks on its topics, and which of their messages it refused."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.subscription import Subscription

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.topics import TOPICS, speakers

T = TypeVar("T")
SECOND = "second_publishers"  # their key in the diagnostics
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # so the middleware calls a node of which it knows only the publisher yet


class Intake:
    """The subscriptions of a node, by topic of the table."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inputs: dict[str, Subscription] = {}
        self._refused: Counter[str] = Counter()
        self._second: set[str] = set()

    def add(self, topic: str, subscription: Subscription) -> None:
        """Take note of a subscription."""
        self._inputs[topic] = subscription

    def read(self, topic: str, convert: Callable[..., T], *arguments: Any) -> T | None:
        """Return what `convert` makes of a message; None where it refuses the message, which is counted and logged."""
        try:
            return convert(*arguments)
        except InvalidInput as error:
            self._refused[topic] += 1
            text = str(error)
            if topic in self._inputs:  # the layout of messages knows of no namespaces
                text = text.replace(topic, self._inputs[topic].topic_name, 1)
            self._node.get_logger().warning(
                f"refused {text} ({self._refused[topic]} so far)", throttle_duration_sec=5.0
            )
            return None

    def presence(self, peers: list[str]) -> dict[str, bool]:
        """Return, for each other node among `peers` with topics that are listened to here, whether it publishes any."""
        said: dict[str, bool] = {}  # some of what a peer publishes depends on its parameters, so one topic is enough
        for topic, given in self._inputs.items():
            shared = len(TOPICS[topic].publishers) > 1  # by several nodes, of which one says nothing of the others
            names = self.publishers(topic) if shared else []
            for name in speakers(topic, [peer for peer in peers if peer != self._node.get_name()]):
                full = f"{self._node.get_namespace().rstrip('/')}/{name}"
                present = full in names if shared else given.get_publisher_count() > 0
                said[name] = said.get(name, False) or present
        return said

    def look(self) -> None:
        """Name whoever speaks where another does already."""
        for topic, given in self._inputs.items():
            if len(TOPICS[topic].publishers) > 1 or given.get_publisher_count() < 2:
                continue
            found = second_publishers(self.publishers(topic), TOPICS[topic].publishers)
            if found:
                self._second |= {f"{name} on {topic}" for name in found}
                self._node.get_logger().warning(
                    f"a second publisher on {given.topic_name}: {', '.join(found)}; is another graph in this domain?",
                    throttle_duration_sec=5.0,
                )

    def publishers(self, topic: str) -> list[str]:
        """Return the nodes that publish a topic, one name for each publisher, as far as they are known."""
        writers = self._node.get_publishers_info_by_topic(self._inputs[topic].topic_name)
        names = (f"{writer.node_namespace.rstrip('/')}/{writer.node_name}" for writer in writers)
        return [name for name in names if not name.endswith(UNKNOWN)]

    def pairs(self) -> list[tuple[str, Any]]:
        """Return what the diagnostics tell of it: messages refused by topic, and second publishers."""
        refused = [(f"refused {topic}", count) for topic, count in sorted(self._refused.items())]
        return refused + ([(SECOND, ", ".join(sorted(self._second)))] if self._second else [])


def second_publishers(names: Iterable[str], expected: Iterable[str]) -> list[str]:
    """Return who else publishes a topic beside the first of the nodes that are expected to.

    :param names: of the nodes that publish it, with their namespaces, one for each publisher.
    :param expected: names without namespaces.
    """
    rest = sorted(names)
    wanted = tuple(expected)
    own = next((name for name in rest if name.rpartition("/")[2] in wanted), rest[0] if len(rest) == 1 else None)
    if own is not None:
        rest.remove(own)
    return rest
