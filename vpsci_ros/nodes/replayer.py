"""The replayer: publishes the recorded messages of a bag at the pace of their log times, times `rate`."""

import importlib
import time
from collections import deque
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from vpsci_ros.bags.episodes import bag_episodes, choose
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.topic_info import TopicInfo
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.node_config import ReplayerConfig
from vpsci_ros.nodes.output import PEER_TIMEOUT
from vpsci_ros.nodes.topics import LATCHED, TOPICS, listeners
from vpsci_ros.wire.decoder import RawMessage

CLOCK = "/clock"
PERIOD = 0.001  # [s] between looks at what is due
SLICE = 0.02  # [s] of publishing at a stretch, so that a stop is heard
FLUSH = Duration(seconds=4.0)  # for readers to acknowledge the last messages: one heartbeat of the middleware
SETTLED = 1.0  # [s] without a new reader: those that run already have been found
MOST_LATCHED = 1000  # messages of a topic that are kept for late subscribers, whatever its recorded profile says
REPLAY = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""A reader that must see every message is waited for, however fast the replay would be."""


class Replayer(GraphNode):
    """Publishes a bag's topics and `/clock`.

    It begins when all readers among `peers`, and at least one reader, are there and none has come for `SETTLED` s.
    With `first_episode` it first publishes what latched topics such as `/tf_static` held at its beginning. Messages are
    not deserialised. A bag without `/clock`, of another tool say, gets one from its log times.
    """

    essential_peers = ()

    def __init__(self, **given: Any) -> None:
        super().__init__("replayer", **given)
        config = self.config(ReplayerConfig)
        self._rate = config.rate
        bag = Bag(config.bag)
        chosen = [topic for topic in bag.topics().values() if topic.messages]
        if not chosen:
            raise InvalidInput(f"{config.bag}: the bag holds no message")
        self._outlets = {topic.name: publisher for topic in chosen if (publisher := self._publisher(topic))}
        if not self._outlets:
            names = ", ".join(topic.name for topic in chosen)
            raise InvalidInput(f"{config.bag}: none of the message types of {names} is installed here")
        self._makes_clock = CLOCK not in self._outlets
        if self._makes_clock:
            self._outlets[CLOCK] = self.create_publisher(Clock, "clock", REPLAY)
        first = config.first_episode
        start = min(each.start_time for each in choose(bag_episodes(bag), first)) if first else 0  # [ns]
        depths = {topic.name: depth for topic in chosen if (depth := _kept(topic))}
        self._held = self._publish_held(bag, depths, start)
        topics = self._outlets.keys() - ({CLOCK} if self._makes_clock else set())  # not the recorded clock, too
        self._messages = bag.messages(topics, start, ordered=True)
        self._next: RawMessage | None = next(self._messages, None)
        if self._next is None:
            raise InvalidInput(f"{config.bag}: the bag holds no message from episode {first} on")
        self._sent = 0
        self._at, self._shown = self._next.time, -1
        self._anchor = (0.0, self._at)  # [s] of wall time, and the log time [ns] then
        self._readers, self._readers_since = -1, time.monotonic()
        self._begun = False
        self.wall_timer(PERIOD, self._on_timer)

    def _publisher(self, topic: TopicInfo) -> Publisher | None:
        package, _, name = topic.type.partition("/msg/")
        try:
            kind = getattr(importlib.import_module(f"{package}.msg"), name)
        except (ImportError, AttributeError):
            self.get_logger().warning(f"{topic.name} is left out: its type {topic.type} is not installed here")
            return None
        shared = topic.name in TOPICS and TOPICS[topic.name].shared
        name = topic.name if shared else topic.name.removeprefix("/")
        return self.create_publisher(kind, name, _latched(depth) if (depth := _kept(topic)) else REPLAY)

    def _publish_held(self, bag: Bag, depths: dict[str, int], start: int) -> int:
        """Publish the latched messages that a subscriber at log time `start` [ns] would have got; return their number.

        :param depths: topic -> how many messages its publishers keep.
        """
        held = {topic: deque[RawMessage](maxlen=depth) for topic, depth in depths.items() if topic in self._outlets}
        if start and held:
            for raw in bag.messages(held, stop=start - 1, ordered=True):
                held[raw.topic].append(raw)
        messages = sorted((raw for rows in held.values() for raw in rows), key=lambda raw: raw.time)
        for raw in messages:
            self._outlets[raw.topic].publish(raw.data)
        return len(messages)

    def _on_timer(self) -> None:
        if not self._begun:
            self._begin_when_readers_are_found()
            return
        until = time.monotonic() + SLICE
        while self._next is not None and (now := time.monotonic()) < until and self._due(self._next, now):
            self._publish(self._next)
        self.finished = self._next is None

    def _begin_when_readers_are_found(self) -> None:
        now, readers = time.monotonic(), sum(p.get_subscription_count() for p in self._outlets.values())
        if readers != self._readers:
            self._readers, self._readers_since = readers, now
        if absent := self._absent():
            if now - self._readers_since > PEER_TIMEOUT:
                raise VpsciError(f"replayer: waited {PEER_TIMEOUT:g} s for {absent}; or leave it out of 'peers'")
        elif readers and now - self._readers_since > SETTLED:
            self._begun = True
            self._anchor = (now, self._at)
            return
        what = absent or "a reader of any of its topics"
        if now - self._readers_since > SETTLED:
            self.get_logger().info(f"waiting for {what}", throttle_duration_sec=5.0)

    def _absent(self) -> str:
        """Return "NODE and NODE to subscribe to /TOPIC" for the first topic that lacks readers; "" if none does."""
        for topic, outlet in self._outlets.items():
            expected = listeners(topic, self.peers) if topic in TOPICS else []
            if outlet.get_subscription_count() < len(expected):
                return f"{' and '.join(expected)} to subscribe to {topic}"
        return ""

    def _due(self, message: RawMessage, now: float) -> bool:
        begun, at = self._anchor
        return self._rate == 0.0 or (message.time - at) * 1e-9 <= (now - begun) * self._rate

    def _publish(self, message: RawMessage) -> None:
        if message.time > self._shown:
            self._at = self._shown = self.simulated_at = message.time
            if self._makes_clock:
                self._outlets[CLOCK].publish(Clock(clock=self.simulated_time))
        self._outlets[message.topic].publish(message.data)
        self._sent += 1
        self._next = next(self._messages, None)

    @property
    def state(self) -> str:
        """The replayer's state: "waiting for readers" or "playing"."""
        return "playing" if self._begun else "waiting for readers"

    def figures(self) -> dict[str, Any]:
        """Return how many messages were published, and the log time [s] of the last one."""
        return {"messages_published": self._held + self._sent, "time": f"{self._at * 1e-9:.3f}"}

    def close(self) -> None:
        """Wait, at most `FLUSH` for each topic, until all subscribers have the messages; log their number."""
        if self._sent:
            for publisher in self._outlets.values():
                publisher.wait_for_all_acked(FLUSH)
        self.get_logger().info(f"published {self._held + self._sent} messages, to {self._at * 1e-9:.3f} s")


def _kept(topic: TopicInfo) -> int:
    """Return how many messages of a topic are kept for subscribers that come later; 0: the topic is not latched.

    Where a bag does not say, topics that `TOPICS` lists as latched keep all their messages, up to `MOST_LATCHED`.
    """
    by_convention = topic.name in TOPICS and TOPICS[topic.name].qos is LATCHED
    return min(topic.latched or (topic.messages if by_convention else 0), MOST_LATCHED)


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
