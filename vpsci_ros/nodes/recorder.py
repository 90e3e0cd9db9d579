"""The recorder: writes the topics that `topics` lists for it to a rosbag2 folder with MCAP storage."""

import hashlib
import struct
import time
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_msgs.msg import PolicyWeights
from vpsci_ros.bags.episodes import EPISODE_RECORD, BagEpisode, EpisodeLog
from vpsci_ros.bags.run_record import NODE, SCENARIO, SOFTWARE, WEIGHTS, node_record, scenario_records, software_record
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.convert import parameters_in
from vpsci_ros.nodes.node_config import EXECUTABLES, NODES, RecorderConfig
from vpsci_ros.nodes.topics import LATCHED, RECORDING, TOPICS, speakers
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import describe, parsed, rewritten
from vpsci_ros.wire.header import stamp_of
from vpsci_ros.wire.layout import EVENTS, TYPES
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.state import NO_EVENTS

POLL = 0.02  # [s]: at a thousand ticks a second two hundred messages at once, in place of as many calls
_AS_WRITTEN = {"/clock", "/markers", "/tf", *TYPES}
"""Topics whose messages have zeros between their fields; others are serialized again, so that bags are reproducible."""


class _Entry(NamedTuple):
    """A message as it is recorded: stamp and bytes, and of `/episode/event` tick and events."""

    at: int  # [ns] its stamp
    data: bytes
    tick: int = 0  # of events
    events: NDArray[np.void] = NO_EVENTS  # EVENT[n]


SPLIT_SIZE = 2**30  # [bytes] of a file of the bag; the next one begins then
_FOREIGN = _Entry(0, b"")  # in place of a message of another graph


class Recorder(GraphNode):
    """Writes the serialized messages of every topic that lists the recorder as subscriber into one bag.

    Log times are the simulated times in the messages (stage 1: wall times), so that a bag plays back at the pace of
    the world; publish times are the wall times of receipt. The bag also gets the parameters of the other nodes, from
    their reports, and a record of each episode.

    States and answers are recorded as they came; the nodes that act on them refuse invalid ones.
    """

    drains = True

    def __init__(self, **given: Any) -> None:
        super().__init__("recorder", **given)
        config = self.config(RecorderConfig)
        explicit = set(self.peers) != set(self.essential_peers)
        recorded = [row for row in TOPICS.values() if "recorder" in row.subscribers]
        # A topic without a publisher here is an external driving system's.
        wanted = [row for row in recorded if not (explicit and row.publishers) or speakers(row.name, self.peers)]
        topics = [
            BagTopic(row.name, row.type_name, *describe(row.type_name), latched=row.qos is LATCHED) for row in wanted
        ]
        self._bag = BagWriter(config.bag, topics, split_size=SPLIT_SIZE)
        self._bag.describe(SOFTWARE, software_record())
        self._episodes = EpisodeLog()
        self._ended: list[BagEpisode] = []
        self._recorded_episodes = 0
        self._untimed = explicit and "world_simulator" not in self.peers  # stage 1: diagnostics alone, in wall time
        if self._untimed:
            self.simulated_at = self.get_clock().now().nanoseconds
        self._unknown = {name for name in (self.peers if explicit else NODES) if name in NODES and name != "recorder"}
        """Nodes whose parameters the bag still lacks."""
        if "learner" in self._unknown:
            self.input("/policy/weights", _digest, partial(self._bag.describe, WEIGHTS), LATCHED)
        for row in wanted:
            self.input(row.name, None, partial(self._take, row.name), RECORDING, raw=True, polled=True)
        self.wall_timer(POLL, self.intake.poll)

    def _take(self, topic: str, data: bytes) -> None:
        """Write a message, unless it is another graph's or refused.

        :raises VpsciError: the disk refuses it.
        """
        self.intake.arrived = time.perf_counter()
        entry = self.intake.read(topic, self._read, topic, data)
        if entry is None:
            self._bag.refuse(topic)
            return
        if entry is _FOREIGN:
            return
        at, data, tick, events = entry
        if self._ended and at > self._ended[0].end_time:
            self._write_ended()
        self._bag.write(topic, data, at, time.time_ns())
        if len(events):
            self._ended += self._episodes.add(tick, at, events, self._bag.files[-1].name)
        if topic != "/diagnostics" or self._untimed:
            self.simulated_at = at

    def _read(self, topic: str, data: bytes) -> _Entry:
        """Return a message as it is recorded; `_FOREIGN` for one of another graph on a topic that graphs share.

        :raises InvalidInput: it has no stamp, is not of its topic's type, or its events' arrays differ in length.
        """
        row = TOPICS[topic]
        if topic == "/diagnostics":
            message, again = rewritten(row.type_name, data, topic)
            if not of_own_nodes(message, self.frame_prefix):
                return _FOREIGN
            entry = _Entry(stamp_of(topic, data), again)
            self._describe(parameters_in(message, self._unknown, self.frame_prefix))
            return entry
        if row.shared and not of_own_frames(data, self.frame_prefix):
            return _FOREIGN
        at = stamp_of(topic, data)
        if topic == EVENTS:
            message = parsed(row.type_name, data, topic)
            return _Entry(at, data, message.tick, layout.events(message))
        return _Entry(at, data if topic in _AS_WRITTEN else rewritten(row.type_name, data, topic)[1])

    def _write_ended(self) -> None:
        """Write the records of the episodes whose last tick is over."""
        for episode in self._ended:
            self._bag.add_metadata(EPISODE_RECORD, episode.to_record())
        self._recorded_episodes += len(self._ended)
        self._ended.clear()

    def _describe(self, parameters: Mapping[str, dict[str, Any]]) -> None:
        """Write the records of nodes with these parameters.

        :raises InvalidInput: they name scenarios that there are not.
        """
        for node, values in parameters.items():
            scenarios = scenario_records(load_scenarios(values.get("scenarios", ()), values.get("scenario_files", ())))
            self._bag.describe(NODE, node_record(node, values))
            for record in scenarios:
                self._bag.describe(SCENARIO, record)
            self._unknown.discard(node)

    def figures(self) -> dict[str, Any]:
        """Return numbers of messages, episodes and files."""
        rows = self._bag.topics.values()
        return {
            "messages_seen": sum(row.seen for row in rows),
            "messages_written": sum(row.messages for row in rows),
            "episodes": self._recorded_episodes + len(self._ended),
            "files": len(self._bag.files),
            "nodes_without_parameters": len(self._unknown),
        }

    def close(self) -> None:
        """Complete the bag."""
        self.intake.poll()
        self._write_ended()
        totals = {"episodes": str(self._recorded_episodes), "episodes_unfinished": str(self._episodes.unfinished)}
        self._bag.close(totals)
        written = sum(topic.messages for topic in self._bag.topics.values())
        self.get_logger().info(f"wrote {self._bag.folder}: {written} messages, {self._recorded_episodes} episodes")


def of_own_nodes(diagnostics: Any, prefix: str) -> bool:
    """Return whether all reports in a DiagnosticArray are of the graph with this prefix, such as "left/" or ""."""
    names = {status.name for status in diagnostics.status}
    return bool(names) and names <= {f"{prefix}{name}" for name in EXECUTABLES}


def of_own_frames(transforms: bytes, prefix: str) -> bool:
    """Return whether a serialized TFMessage has the frames of the graph with this prefix, see `of_own_nodes`."""
    vehicle = f"{prefix}vehicle/base_link".encode() + b"\0"  # every message of a graph's frames has it
    return struct.pack("<I", len(vehicle)) + vehicle in transforms


def _digest(message: PolicyWeights) -> dict[str, str]:
    """Return the record of weights that the learner has published."""
    return {"version": str(message.version), "sha256": hashlib.sha256(bytes(message.safetensors)).hexdigest()}
