"""The report of a node, published on `/diagnostics` and, in a graph, sent through a pipe.

Any program may publish on `/diagnostics`. What decides how a run ended comes through a pipe that `vpsci graph` gives to
each process it starts, and that no other program has: lines of JSON, one a report, the last one at the node's end.
"""

import contextlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from vpsci_ros.lockstep.counts import WorldCounts

PIPE = "VPSCI_STATUS_PIPES"
"""Environment variable: "NODE=NUMBER,...", the file descriptors to which the nodes of the process write."""


@dataclass
class NodeStatus:
    """The report of a node: its state, what it waits for, figures, and numbers of messages.

    :ivar state: "waiting", "running", "paused" or the like.
    :ivar awaited: what it waits for, names of nodes or a few words.
    :ivar figures: rates, progress and versions by name, for people to read.
    :ivar published: topic of the table -> messages that the node published there.
    :ivar refused: topic -> messages that it refused.
    :ivar second_publishers: "/NODE on /TOPIC" of the nodes that publish beside the one that the topic belongs to.
    :ivar counts: of the world simulator.
    """

    state: str = "running"
    awaited: list[str] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    published: dict[str, int] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)
    second_publishers: list[str] = field(default_factory=list)
    counts: WorldCounts | None = None

    def pairs(self) -> dict[str, Any]:
        """Return the values for `/diagnostics`, by key."""
        pairs = dict(self.figures)
        pairs |= {"tick": self.counts.tick} | self.counts.nonzero() if self.counts else {}
        pairs |= {f"published {topic}": number for topic, number in self.published.items()}
        pairs |= {f"refused {topic}": number for topic, number in sorted(self.refused.items())}
        return pairs | ({"second_publishers": ", ".join(self.second_publishers)} if self.second_publishers else {})

    def number(self, name: str) -> float | None:
        """Return a figure as a number; None if it is missing or no finite number."""
        try:
            value = float(self.figures[name])
        except (KeyError, TypeError, ValueError):
            return None
        return value if math.isfinite(value) else None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "NodeStatus":
        """Return the status with these `values` of its fields, as read from JSON."""
        counts = values.get("counts")
        return cls(**{**values, "counts": WorldCounts(**counts) if counts else None})


def send(node: str, status: NodeStatus) -> None:
    """Write a node's status to the pipe of the process that runs the graph, if one has started this process."""
    if PIPE in os.environ:
        numbers = dict(pair.split("=") for pair in os.environ[PIPE].split(","))
        with contextlib.suppress(OSError, KeyError), open(int(numbers[node]), "wb", closefd=False) as pipe:
            pipe.write(json.dumps(asdict(status), default=str).encode() + b"\n")  # the graph may have been killed


class StatusPipe:
    """The pipe from one node to the process that runs the graph.

    :ivar latest: the status that came last.
    :ivar open: whether more may come.
    :ivar write_end: file descriptor for the node's process; to be closed here once that has been started.
    """

    def __init__(self) -> None:
        self.latest: NodeStatus | None = None
        self.read_end, self.write_end = os.pipe()
        os.set_blocking(self.read_end, False)
        self._rest = b""
        self.open = True

    def started(self) -> None:
        """Close this process's copy of the writing end, so that the pipe ends with the node's process."""
        os.close(self.write_end)

    def read(self) -> None:
        """Read the available bytes of the pipe, and store the last whole report as `latest`."""
        data = bytearray()
        with contextlib.suppress(BlockingIOError):
            while block := os.read(self.read_end, 65536):
                data += block
            self.open = False
        *lines, self._rest = (self._rest + data).split(b"\n")
        if lines:
            self.latest = NodeStatus.of(json.loads(lines[-1]))

    def close(self) -> None:
        """Close the reading end."""
        self.open = False
        os.close(self.read_end)
