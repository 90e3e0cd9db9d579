"""The topics of a bag: type, number of messages, and log times of the first and the last message."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

KEEP_ALL = 2**31  # messages: more than any topic has


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a file or bag: `first` and `last` are log times [ns], 0 where it has no message.

    `latched` is how many messages its publishers keep for subscribers that come later, 0 where they keep none.
    """

    name: str
    type: str
    messages: int = 0
    first: int = 0
    last: int = 0
    latched: int = 0

    def merged(self, other: TopicInfo) -> TopicInfo:
        """Return this topic's information merged with that on the same topic in another file."""
        if not self.messages or not other.messages:
            return self if self.messages else other
        first, last = min(self.first, other.first), max(self.last, other.last)
        latched = max(self.latched, other.latched)
        return TopicInfo(self.name, self.type, self.messages + other.messages, first, last, latched)

    @property
    def rate(self) -> float:
        """Messages per second of log time; 0 if there are not two messages at different times."""
        return (self.messages - 1) * 1e9 / (self.last - self.first) if self.last > self.first else 0.0


def extent(topics: Collection[TopicInfo]) -> tuple[int, int]:
    """Return the first and the last log time [ns] of some topics, at least one of which has a message."""
    return min(topic.first for topic in topics if topic.messages), max(topic.last for topic in topics)


def by_name(rows: Iterable[TopicInfo]) -> dict[str, TopicInfo]:
    """Return topics by name, sorted; rows of the same topic are merged."""
    found: dict[str, TopicInfo] = {}
    for row in rows:
        found[row.name] = found[row.name].merged(row) if row.name in found else row
    return dict(sorted(found.items()))
