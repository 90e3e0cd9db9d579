"""The recorder: writes every message of the graph, as it came off the wire, to a rosbag2 folder with MCAP storage."""

import hashlib
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from vpsci_msgs.msg import PolicyWeights
from vpsci_ros.bags.episodes import RECORD, BagEpisode, EpisodeLog
from vpsci_ros.bags.run_record import NODE, SCENARIO, SOFTWARE, WEIGHTS, node_record, scenario_records, software_record
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.nodes import serialized
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.config import NODES, RecorderConfig
from vpsci_ros.nodes.exchange import Outgoing
from vpsci_ros.nodes.peer_parameters import PeerParameters
from vpsci_ros.nodes.recorder_reading import FOREIGN, Reading
from vpsci_ros.nodes.topics import LATCHED, RECORDING, TOPICS, Topic, speakers
from vpsci_ros.wire.decoder import describe
from vpsci_ros.world import load_scenarios

AT_ONCE = 250  # messages that are written together; the values of more would be in the cache no longer
POLL = 0.02  # [s]: at a thousand ticks a second two hundred messages at once, in place of as many calls


class Recorder(GraphNode):
    """Every topic of the table that names the recorder, raw, into one bag.

    Log times are the simulated times in the messages, so that a bag plays back at the pace of the world and is the
    same for the same seed; publish times are the wall times of receipt. Beside the messages the bag gets the
    parameters of the other nodes, which it requests, and a record of each episode.

    What comes is gathered, and a thread of its own reads and writes it, some hundred messages at a time: what nodes of
    this process publish has its bytes made there, all of a kind together.
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
        sizes = {"chunk_size": config.chunk_size * 1024, "split_size": config.split_size}
        self._bag = BagWriter(config.bag, topics, **sizes)
        self._bag.describe(SOFTWARE, software_record())
        self._reading = Reading(self.intake, self.frame_prefix)
        self._episodes = EpisodeLog()
        self._ended: list[BagEpisode] = []
        self._recorded_episodes = 0
        self._untimed = explicit and "world_simulator" not in self.peers  # stage 1: diagnostics alone, in wall time
        if self._untimed:
            self.simulated_at = self.get_clock().now().nanoseconds
        self._begun = time.monotonic()
        self._came: list[tuple[str, bytes | Outgoing, int]] = []  # topic, message, wall time [ns]
        self._thread = ThreadPoolExecutor(1, "recorder")
        self._written: Future[None] | None = None  # what was handed over to it
        serialized.warm_up()
        others = [name for name in (self.peers if explicit else NODES) if name not in ("recorder", "replayer")]
        self._peer_parameters = PeerParameters(self, others, self._on_parameters)
        if "learner" in others:
            self.input("/policy/weights", _digest, partial(self._describe, WEIGHTS), LATCHED)
        # Where the nodes wait for this one, it first waits for their parameters: a short run would be over before.
        self._waiting: list[Topic] = wanted
        if explicit:
            self.wall_timer(0.02, self._subscribe_when_known)
        else:
            self._subscribe()

    def _subscribe_when_known(self) -> None:
        late = time.monotonic() - self._begun > 0.5 * self.peer_timeout  # the others wait for this one as long in all
        if self._waiting and (late or not self._peer_parameters.missing):
            if late:
                missing = ", ".join(self._peer_parameters.missing)
                self.get_logger().warning(f"recording without the parameters of {missing}: no answer yet")
            self._subscribe()

    def _subscribe(self) -> None:
        for row in self._waiting:
            self.input(row.name, None, partial(self._take, row.name), RECORDING, raw=True, polled=True)
        self._waiting = []
        self.wall_timer(POLL, self._poll)

    def _take(self, topic: str, message: bytes | Outgoing) -> None:
        self._came.append((topic, message, time.time_ns()))
        if len(self._came) >= AT_ONCE:
            self._hand_over()

    def _poll(self) -> None:
        self.intake.poll()
        self._hand_over()

    def _hand_over(self) -> None:
        """Have written what has come, beside what this process does next.

        :raises VpsciError: the disk has refused what was to be written before.
        """
        if self._came:
            self.intake.arrived = time.perf_counter()
            self._settle()
            self._written = self._thread.submit(self._record, self._came)
            self._came = []

    def _settle(self) -> None:
        """Wait until everything is written that was handed over; a writer that is slower thus slows down the graph."""
        written, self._written = self._written, None
        if written is not None:
            written.result()

    def _describe(self, name: str, values: Mapping[str, str]) -> None:
        self._settle()
        self._bag.describe(name, values)

    def _record(self, came: Sequence[tuple[str, bytes | Outgoing, int]]) -> None:
        """Write messages that came at these wall times [ns], in their order."""
        own = self._reading.own([message[:2] for message in came])
        for (topic, message, came_at), found in zip(came, own, strict=True):
            read = found or self._reading.message(topic, bytes(message))
            if read is None:
                self._bag.refuse(topic)
            elif read is not FOREIGN:
                at, data, tick, events = read
                if self._ended and at > self._ended[0].end_time:
                    self._write_ended()
                self._bag.write(topic, data, at, came_at)
                if events:
                    self._ended += self._episodes.add(tick, at, events, self._bag.files[-1].name)
                if topic != "/diagnostics" or self._untimed:
                    self.simulated_at = at

    def _write_ended(self) -> None:
        """Write the records of the episodes whose last tick is over."""
        for episode in self._ended:
            self._bag.add_metadata(RECORD, episode.to_record())
        self._recorded_episodes += len(self._ended)
        self._ended.clear()

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        scenarios = scenario_records(load_scenarios(values.get("scenarios", ()), values.get("scenario_files", ())))
        self._describe(NODE, node_record(node, values))
        if node == "world_simulator":
            self._reading.rows = int(values.get("batch", 0)) * int(values.get("pedestrians", 1))
        for record in scenarios:
            self._describe(SCENARIO, record)

    def figures(self) -> dict[str, Any]:
        """Return numbers of messages, episodes and files."""
        rows = self._bag.topics.values()
        return {
            "messages_seen": sum(row.seen for row in rows),
            "messages_written": sum(row.messages for row in rows),
            "episodes": self._recorded_episodes + len(self._ended),
            "files": len(self._bag.files),
        }

    def close(self) -> None:
        """Complete the bag."""
        self._poll()
        self._settle()
        self._thread.shutdown()
        self._write_ended()
        totals = {"episodes": str(self._recorded_episodes), "episodes_unfinished": str(self._episodes.unfinished)}
        self._bag.close(totals)
        written = sum(topic.messages for topic in self._bag.topics.values())
        self.get_logger().info(f"wrote {self._bag.folder}: {written} messages, {self._recorded_episodes} episodes")


def _digest(message: PolicyWeights) -> dict[str, str]:
    """Return the record of weights that the learner has published."""
    return {"version": str(message.version), "sha256": hashlib.sha256(bytes(message.safetensors)).hexdigest()}
