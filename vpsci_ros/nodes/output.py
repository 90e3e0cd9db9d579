"""A publisher of a graph's node that waits, before its first message, until all expected subscribers are matched."""

import time
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node

from vpsci_ros.errors import VpsciError
from vpsci_ros.nodes.topics import LATCHED, TOPICS
from vpsci_ros.runs.processes import unhindered_time

UNEXPECTED_PATIENCE = 1.0  # [s] for discovered subscribers that are not expected; some never match, by their QoS
PEER_TIMEOUT = 60.0  # [s], less what this node waits for a core, for expected readers to appear before it gives up


class Output:
    """A publisher that waits for all expected subscribers before the first message.

    It also waits a moment for other readers that the middleware has announced already.

    :param topic: of the table.
    :param expected: names of the nodes that are to read it.
    :param stopping: returns whether the node is to stop, and waits no more.
    :ivar published: number of messages, those included that nobody subscribed to.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        expected: list[str],
        stopping: Callable[[], bool],
    ) -> None:
        self.topic = topic
        self.expected = expected
        self._node = node
        row = TOPICS[topic]
        self._latched = row.qos is LATCHED
        self._publisher = node.create_publisher(row.type, row.ros_name, **row.quality())
        self._stopping = stopping
        self._ready = False
        self.published = 0

    @property
    def full_name(self) -> str:
        """The topic's name with its namespace."""
        return str(self._publisher.topic_name)

    @property
    def matched(self) -> bool:
        """Whether all expected subscribers are matched, by node name."""
        if self._publisher.get_subscription_count() < len(self.expected):
            return False
        names = {info.node_name for info in self._node.get_subscriptions_info_by_topic(self.full_name)}
        return names.issuperset(self.expected)

    def missing(self) -> list[str]:
        """Return the expected subscribers that are not discovered; if all are discovered, all that are expected."""
        known = {info.node_name for info in self._node.get_subscriptions_info_by_topic(self.full_name)}
        return [name for name in self.expected if name not in known] or self.expected

    @property
    def complete(self) -> bool:
        """Whether all expected subscribers and all others that are discovered are matched."""
        known = self._node.count_subscribers(self.full_name)
        return self.matched and self._publisher.get_subscription_count() >= known

    @property
    def has_readers(self) -> bool:
        """Whether the topic has a subscriber; views of the world are published only then."""
        return self._publisher.get_subscription_count() > 0

    def publish(self, message: Any) -> None:
        """Publish a message or its bytes; the first call waits for the expected subscribers.

        :raises VpsciError: they did not appear within `PEER_TIMEOUT`.
        """
        if not self._ready:
            self._wait()
        self.publish_now(message)

    def publish_now(self, message: Any) -> None:
        """Publish to the matched subscribers without waiting."""
        if self._latched or self.has_readers:
            self._publisher.publish(message)
        self.published += 1

    def flush(self, timeout_sec: float) -> bool:
        """Wait until all subscribers have received all messages; return False after a timeout."""
        return self._publisher.wait_for_all_acked(Duration(seconds=timeout_sec))

    def _wait(self) -> None:
        begun, last_notice, patience_from = time.monotonic(), time.monotonic(), unhindered_time()
        # Matching goes on in the middleware's threads while this callback waits.
        while not self.complete and not self._stopping():
            now = time.monotonic()
            if self.matched and now - begun > UNEXPECTED_PATIENCE:
                break
            if unhindered_time() - patience_from > PEER_TIMEOUT:
                raise VpsciError(
                    f"{self._node.get_name()}: waited {PEER_TIMEOUT:g} s for {' and '.join(self.missing())} to "
                    f"subscribe to {self.full_name}; start them, or name only running nodes in the parameter 'peers'"
                )
            if now - last_notice > 5.0:
                self._node.get_logger().info(f"waiting for {' and '.join(self.missing())} on {self.full_name}")
                last_notice = now
            time.sleep(0.005)
        self._ready = True
