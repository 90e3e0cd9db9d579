"""One sqlite3 file of a bag, as `ros2 bag record` wrote them by default before Jazzy.

Python's own sqlite3 reads it: rosbags' reader needs metadata.yaml and a whole file, and these are read without.
"""

import contextlib
import itertools
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vpsci_ros.bags.mcap_file import DAY, TopicInfo, by_name
from vpsci_ros.documents import printable
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage

_WHOLE = """typeof(timestamp) = 'integer' AND typeof(data) = 'blob' AND COALESCE(topic_id IN
    (SELECT id FROM topics WHERE typeof(name) || typeof(type) || typeof(serialization_format) = 'texttexttext'), 0)"""
_ODD = f"SELECT COUNT(*) FROM messages WHERE NOT ({_WHOLE})"
_TOPICS = f"""SELECT t.name, t.type, COUNT(m.id), COALESCE(MIN(m.timestamp), 0), COALESCE(MAX(m.timestamp), 0),
    COALESCE(MIN(NULLIF(m.timestamp, 0)), 0), COALESCE(t.offered_qos_profiles, '') || ''
    FROM topics t LEFT JOIN (SELECT * FROM messages WHERE {_WHOLE}) m ON m.topic_id = t.id
    WHERE typeof(t.name) || typeof(t.type) = 'texttext' GROUP BY t.id ORDER BY t.name"""
_VIEWS = """SELECT name FROM sqlite_master WHERE name IN ('topics', 'messages', 'message_definitions')
    AND (type <> 'table' OR sql LIKE 'CREATE VIRTUAL%' OR sql LIKE '%GENERATED%')"""  # what may take for ever to read
LARGEST = 2**28  # [bytes] of a message
_MESSAGES = f"""SELECT topic_id, timestamp, data FROM messages {{}}
    WHERE timestamp BETWEEN ? AND ? AND {_WHOLE} ORDER BY {{}}"""


class SqliteFile:
    """The messages of one file in the order of their times; the same methods as `McapFile`.

    :param strict: refuse a damaged file, instead of noting what is wrong with it.
    :ivar damage: what was found wrong while reading, one sentence each.
    """

    def __init__(self, path: Path, *, strict: bool) -> None:
        self.path = path
        self.strict = strict
        self.damage: list[str] = []

    def topics(self) -> list[TopicInfo]:
        """Return what topics the file has.

        :raises InvalidInput: not such a file, or (strict) a damaged one.
        """
        self._note_odd_messages()
        held = ("durability: 1", "transient_local")
        if self.strict:
            return [
                TopicInfo(name, kind, count, later if last > DAY else first, last, any(each in qos for each in held))
                for name, kind, count, first, last, later, qos in self._rows(_TOPICS)
            ]
        listed = [  # the index of a damaged file, by which messages are counted above, may not be trusted
            TopicInfo(str(name), str(kind), latched=any(each in str(qos) for each in held))
            for name, kind, qos in self._rows("SELECT name, type, offered_qos_profiles FROM topics")
        ]
        latched = {topic.name: topic.latched for topic in listed}
        single = (TopicInfo(m.topic, m.type, 1, m.time, m.time, latched[m.topic]) for m in self.select())
        return list(by_name(itertools.chain(listed, single)).values())

    def named_records(self) -> list[tuple[str, dict[str, str]]]:
        """Return the text records: this storage has none."""
        return []

    def select(
        self, topics: Collection[str] | None = None, start: int = 0, stop: int = 2**63 - 1, *, ordered: bool = True
    ) -> Iterator[RawMessage]:
        """Yield the messages of these topics (None: all) with times from `start` to `stop` [ns], both included.

        :raises InvalidInput: not such a file, or (strict) a damaged one.
        """
        self._note_odd_messages()
        definitions = {}
        with contextlib.suppress(InvalidInput):  # older files have no such table
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            definitions = {kind: (text, form) for kind, form, text in self._rows(query, quiet=True)}
        described = {row[0]: row[1:] for row in self._rows("SELECT id, name, type, serialization_format FROM topics")}
        # A damaged file is read as far as it goes, which its index does not know.
        order = ("", "timestamp, id") if self.strict else ("NOT INDEXED", "id")
        for topic, time, data in self._rows(_MESSAGES.format(*order), (start, stop)):
            name, kind, encoding = described[topic]
            if topics is None or name in topics:
                definition, form = definitions.get(kind, ("", ""))
                yield RawMessage(name, kind, encoding, definition, form, time, bytes(data))

    def _note_odd_messages(self) -> None:
        """Count the messages without a topic, a time or data: they are left out.

        :raises InvalidInput: (strict) there are any.
        """
        for (count,) in self._rows(_ODD):
            if count and self.strict:
                raise InvalidInput(
                    f"{self.path}: {count} of its messages have no listed topic, no whole number as their time or no "
                    "data; copy it again, or read what is whole with --recover"
                )
            self.damage += [f"{count} of its messages have no listed topic, time or data"] * bool(count)

    def _rows(self, query: str, values: tuple[int, ...] = (), *, quiet: bool = False) -> Iterator[tuple[Any, ...]]:
        with contextlib.closing(sqlite3.connect(f"file:{quote(str(self.path))}?mode=ro", uri=True)) as connection:
            try:
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
                for (name,) in connection.execute(_VIEWS):
                    raise InvalidInput(
                        f"{self.path}: {printable(name)} is no table; expected a bag as recorders write it"
                    )
                yield from connection.execute(query, values)
            except sqlite3.Error as error:
                text = f"{self.path}: not a whole sqlite3 bag file ({error})"
                if quiet or self.strict or "no such table" in str(error) or "not a database" in str(error):
                    raise InvalidInput(f"{text}; copy it again, or read what is whole with --recover") from None
                self.damage.append(f"it is damaged ({error})")
