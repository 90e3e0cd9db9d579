"""The input of a node: its subscriptions, rejected messages, and the nodes that publish to it."""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from operator import itemgetter
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.topics import TOPICS

T = TypeVar("T")
MOST_AT_ONCE = 1000  # messages of a topic in one poll
LOG_PERIOD = 5.0  # [s] between lines about refused messages of a topic
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # so the middleware calls a node of which it knows only the publisher yet


class Intake:
    """The subscriptions of a node, by topic of `TOPICS`.

    :ivar arrived: `time.perf_counter()` when the latest message of a topic with `decode` came, or a handler set it.
    :ivar polled: subscription that the node polls itself -> what takes its messages.
    :ivar refused: topic -> messages that were refused.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inputs: dict[str, Subscription] = {}
        self._receivers: dict[str, tuple[Callable[[Any], Any], Callable[[Any], None]]] = {}
        self.polled: dict[Subscription, Callable[[bytes], None]] = {}
        self._second: set[str] = set()
        self.refused: Counter[str] = Counter()
        self.arrived = 0.0
        self._logged_at: dict[str, float] = {}  # topic -> [s]

    def add(
        self,
        topic: str,
        decode: Callable[[Any], T] | None,
        handle: Callable[[T], None],
        qos: QoSProfile | None = None,
        *,
        raw: bool = False,
        polled: bool = False,
    ) -> Subscription:
        """Subscribe to a topic of `TOPICS`, and return the subscription.

        :param decode: called with each message, or its bytes where `raw`; refuses one by `InvalidInput`, and the
            refusal is counted and logged; returns no None. None: `handle` is called with every message at once.
        :param handle: called with what `decode` returned.
        :param polled: messages, `raw` ones, come when the node calls `poll`, and wake no executor.
        """
        row = TOPICS[topic]
        receive: Callable[[Any], None] = handle
        if decode is not None:
            self._receivers[topic] = decode, handle
            receive = partial(self.receive, topic)
        self._inputs[topic] = self._node.create_subscription(
            row.type, row.ros_name, receive, raw=raw, **row.quality(qos)
        )
        if polled:
            self.polled[self._inputs[topic]] = receive
        return self._inputs[topic]

    def poll(self) -> None:
        """Process the received messages of all topics added with `polled`, in the order of publication.

        Where the executor wakes for each message, a node that reads every topic needs several times as much CPU time.
        """
        came = []
        for subscription, receive in self.polled.items():
            with subscription.handle:
                for _ in range(MOST_AT_ONCE):
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    came.append((taken[1]["source_timestamp"], receive, taken[0]))
        came.sort(key=itemgetter(0))
        for _, receive, message in came:
            receive(message)

    def receive(self, topic: str, message: Any) -> None:
        """Decode a message of a topic and call the topic's handler, or reject the message."""
        self.arrived = time.perf_counter()
        decode, handle = self._receivers[topic]
        value = self.read(topic, decode, message)
        if value is not None:
            handle(value)

    def read(self, topic: str, convert: Callable[..., T], *arguments: Any) -> T | None:
        """Return the result of `convert`; if it raises `InvalidInput`, count and log the message, and return None."""
        try:
            return convert(*arguments)
        except InvalidInput as error:
            self._refuse(topic, str(error))
            return None

    def _refuse(self, topic: str, text: str) -> None:
        """Count a message that is rejected for a reason, and log it, at most once in `LOG_PERIOD` for a topic."""
        self.refused[topic] += 1
        if (now := time.monotonic()) - self._logged_at.get(topic, -math.inf) <= LOG_PERIOD:
            return
        self._logged_at[topic] = now
        count = f"{self.refused[topic]} so far"
        if topic in self._inputs:
            name = self._inputs[topic].topic_name  # with the namespace, which the decoder does not know
            text = text.replace(topic, name, 1) if topic in text else f"{name}: {text}"
            count += f", published by {', '.join(self.publishers(topic)) or 'a node that is gone'}"
        self._node.get_logger().warning(f"refused {text} ({count})")

    def look(self) -> None:
        """Record and log unexpected publishers of the subscribed topics, except topics that graphs share."""
        for topic, given in self._inputs.items():
            if not TOPICS[topic].shared and given.get_publisher_count() > 1:
                found = second_publishers(self.publishers(topic), TOPICS[topic].publishers)
                self._second |= {f"{name} on {topic}" for name in found}
                if found:
                    self._node.get_logger().warning(
                        f"a second publisher on {given.topic_name}: {', '.join(found)}; is another graph in this "
                        "domain, or was a node killed less than 20 s ago?",
                        throttle_duration_sec=LOG_PERIOD,
                    )

    @property
    def second_publishers(self) -> list[str]:
        """Unexpected publishers seen so far, as "/NODE on /TOPIC"."""
        return sorted(self._second)

    def publishers(self, topic: str) -> list[str]:
        """Return the names of the nodes that publish a topic, one for each publisher whose node is known."""
        writers = self._node.get_publishers_info_by_topic(self._inputs[topic].topic_name)
        names = (f"{writer.node_namespace.rstrip('/')}/{writer.node_name}" for writer in writers)
        return [name for name in names if not name.endswith(UNKNOWN)]


def second_publishers(names: Iterable[str], expected: Iterable[str]) -> list[str]:
    """Return the publishers of a topic beyond the first expected one; a single publisher counts as expected.

    :param names: of the nodes that publish it, with their namespaces, one for each publisher.
    :param expected: names without namespaces.
    """
    rest = sorted(names)
    wanted = tuple(expected)
    own = next((name for name in rest if name.rpartition("/")[2] in wanted), rest[0] if len(rest) == 1 else None)
    if own is not None:
        rest.remove(own)
    return rest
