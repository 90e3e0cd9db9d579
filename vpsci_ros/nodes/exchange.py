"""What nodes of one process publish for each other, handed on without the middleware.

rclpy has no such way of its own: a message between two nodes of a process takes 20 to 40 us through the middleware and
its executor, as much as the world takes for a tick. Readers in other processes get every message as before.
"""

import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

_AT_ONCE = 64  # messages between two looks at the clock


class Outgoing:
    """A message before it is serialized: nodes of this process read its value, all others its bytes.

    :param value: what a reader of the bytes makes of them; nobody changes it any more.
    :param write: makes the bytes of values, where anybody needs them; of several at once they may cost less each.
    """

    __slots__ = "_data", "value", "write"

    def __init__(self, value: Any, write: Callable[[Sequence[Any]], list[bytes]]) -> None:
        self.value, self.write, self._data = value, write, b""

    def __bytes__(self) -> bytes:
        self._data = self._data or padded(self.write([self.value])[0])
        return self._data


def each(write: Callable[[Any], bytes]) -> Callable[[Sequence[Any]], list[bytes]]:
    """Return what makes the bytes of values one by one."""
    return lambda values: list(map(write, values))


class LocalReader:
    """A subscription to serialized messages, some of which come from this process.

    :param receive: called with each message, once.
    """

    def __init__(self, receive: Callable[[bytes | Outgoing], None]) -> None:
        self.receive = receive
        self.copies: Counter[bytes] = Counter()
        """Messages received here that the middleware is still to bring, too."""

    def from_middleware(self, data: bytes) -> None:
        """Receive a message of the middleware, unless it is the copy of one received here."""
        if self.copies[data] > 0:
            self.copies[data] -= 1
        else:
            del self.copies[data]
            self.receive(data)


class Exchange:
    """Hands messages on in the order in which they were published, to the readers of a topic one after the other."""

    def __init__(self) -> None:
        self._readers: defaultdict[str, list[LocalReader]] = defaultdict(list)
        self._waiting: deque[tuple[LocalReader, bytes | Outgoing]] = deque()
        self._counts: dict[Publisher, int] = {}  # of subscriptions, while messages are handed on

    def reader(self, topic: str, receive: Callable[[bytes | Outgoing], None]) -> LocalReader:
        """Return another reader of a topic."""
        self._readers[topic].append(LocalReader(receive))
        return self._readers[topic][-1]

    def publish(self, topic: str, message: Any, publisher: Publisher) -> None:
        """Publish a message, in whatever form, to the readers here, and through the middleware if there are others."""
        readers = self._readers[topic]
        if readers and not isinstance(message, Outgoing):
            message = padded(message if isinstance(message, bytes) else serialize_message(message))
        self._waiting.extend([(reader, message) for reader in readers])
        if (self._counts.get(publisher) or self.subscriptions(publisher)) > len(readers):
            message = bytes(message) if isinstance(message, Outgoing) else message
            for reader in readers:
                reader.copies[message] += 1
            publisher.publish(message)

    def subscriptions(self, publisher: Publisher) -> int:
        """Return how many there are to a publisher, here and elsewhere; after `deliver` the middleware counts again."""
        count = self._counts.get(publisher)
        if count is None:
            self._counts[publisher] = count = publisher.get_subscription_count()
        return count

    def deliver(self, seconds: float) -> bool:
        """Hand on what waits and what comes of it, for so long [s] at most; return whether there is more."""
        self._counts.clear()
        until = time.perf_counter() + seconds
        while self._waiting and time.perf_counter() < until:
            for _ in range(min(_AT_ONCE, len(self._waiting))):
                reader, data = self._waiting.popleft()
                reader.receive(data)
        self._counts.clear()
        return bool(self._waiting)


def padded(data: bytes) -> bytes:
    """Return a serialized message as the middleware brings it."""
    return data + bytes(-len(data) % 4)
