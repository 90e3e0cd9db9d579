"""What a recorder reads of a message before it writes it: its stamp, whether it is credible, and the events in it."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from tf2_msgs.msg import TFMessage

from vpsci_msgs.msg import EpisodeEvent
from vpsci_ros.bags.episodes import EventRow, event_rows
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import serialized
from vpsci_ros.nodes.config import EXECUTABLES
from vpsci_ros.nodes.exchange import Outgoing, padded
from vpsci_ros.nodes.intake import Intake
from vpsci_ros.nodes.serialized import message_of
from vpsci_ros.nodes.topics import TOPICS
from vpsci_ros.wire import layout, received
from vpsci_ros.wire.layout import EVENTS, SAFETY, WORLD
from vpsci_ros.wire.padding import zeroed
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Actions, has_nan

_NOTHING: tuple[int, Sequence[EventRow]] = 0, ()
_ACTIONS = {f"/{agent}/action": agent for agent in AGENTS}


Read = tuple[int, bytes, int, Sequence[EventRow]]
"""A message as it is recorded: its stamp [ns], its bytes with zeros for padding; of events their tick, and which."""

FOREIGN: Read = (-1, b"", 0, ())
"""In place of a message of another graph, on a topic that graphs share."""


class Reading:
    """Reads messages, and has the intake count and log those that it refuses.

    :param prefix: before the names of this graph's frames and nodes, such as "left/".
    :ivar rows: of the arrays of states and answers; 0: not known.
    """

    def __init__(self, intake: Intake, prefix: str) -> None:
        self._intake, self._prefix = intake, prefix
        self.rows = 0

    def own(self, messages: Sequence[tuple[str, bytes | Outgoing]]) -> list[Read | None]:
        """Read what nodes of this process have published on these topics, those of a kind at once.

        :return: None for all other messages, and for those of a kind among which one is not credible: `message` finds
            out which.
        """
        found: list[Read | None] = [None] * len(messages)
        kinds: defaultdict[tuple[str, Callable[..., Any]], list[int]] = defaultdict(list)
        for place, (topic, message) in enumerate(messages):
            if isinstance(message, Outgoing):
                kinds[topic, message.write].append(place)
        for (topic, write), places in kinds.items():
            values = [messages[place][1].value for place in places]  # type: ignore[union-attr]
            if self._credible(topic, values):
                for place, value, data in zip(places, values, write(values), strict=True):
                    header = value.header
                    at = header.seconds * 1_000_000_000 + header.nanoseconds
                    happened = (value.tick, event_rows(value.events)) if topic == EVENTS else _NOTHING
                    found[place] = (at, padded(data), *happened)
        return found

    def _credible(self, topic: str, values: Sequence[Any]) -> bool:
        """Return whether the nodes that act on these values refuse none of them."""
        if topic == WORLD:
            states = [value.tick.state for value in values]
            arrays, fine = states, all(map(received.in_range, states))
        elif topic == SAFETY:
            arrays = [numbers for value in values for numbers in (value.curvttc, value.distance)]
            fine = not has_nan(np.concatenate(arrays))
            arrays += [value.critical for value in values]
        elif topic in _ACTIONS:
            arrays = [numbers for value in values for numbers in (value.longitudinal, value.lateral)]
            fine = bool(np.isfinite(np.concatenate(arrays)).all())
        else:
            return True
        return fine and set(map(len, arrays)) <= {self.rows or len(arrays[0])}

    def message(self, topic: str, data: bytes) -> Read | None:
        """Read a serialized message; None where it is refused."""
        if TOPICS[topic].shared and not self._intake.read(topic, _is_own, topic, data, self._prefix):
            return FOREIGN
        return self._intake.read(topic, self._read, topic, data)

    def _read(self, topic: str, data: bytes) -> Read:
        """Read a message.

        :raises InvalidInput: it has no stamp, or is shorter than its lengths say, or it is a state, an answer or events
            that the nodes which act on them refuse as well.
        """
        at, clean = received.stamp(topic, data), zeroed(TOPICS[topic].type_name, data, topic)
        if topic == EVENTS:
            event = message_of(data, EpisodeEvent, EVENTS)
            return at, clean, event.tick, event_rows(layout.events(event))
        if topic == WORLD:
            rows = len(serialized.shown(data).tick.state)
            if self.rows and rows != self.rows:
                raise InvalidInput(f"{topic}: expected {self.rows} pedestrians, got {rows}; are two worlds here?")
        elif topic == SAFETY and self.rows:
            layout.safety_state(serialized.safety_state(data), self.rows)
        elif topic in _ACTIONS and self.rows:
            Actions(**{_ACTIONS[topic]: layout.action(serialized.action(data, topic), self.rows, topic)})
        return at, clean, *_NOTHING


def _is_own(topic: str, data: bytes, prefix: str) -> bool:
    """Return `is_own` of a serialized message.

    :raises InvalidInput: it is none.
    """
    if topic == "/diagnostics":
        return is_own(message_of(data, DiagnosticArray, topic), prefix)
    return _are_own(received.child_frames(data, topic), prefix)


def is_own(message: DiagnosticArray | TFMessage, prefix: str) -> bool:
    """Return whether a message is of the graph whose names begin with `prefix`, such as "left/", or nothing."""
    if isinstance(message, DiagnosticArray):
        own = {f"{prefix}{name}" for name in EXECUTABLES}
        return bool(message.status) and all(status.name in own for status in message.status)
    return _are_own([transform.child_frame_id for transform in message.transforms], prefix)


def _are_own(frames: list[str], prefix: str) -> bool:
    return bool(frames) and all(frame.startswith(tuple(f"{prefix}{agent}" for agent in AGENTS)) for frame in frames)
