"""The recorder: writes every message of the graph, as it came off the wire, to a rosbag2 folder with MCAP storage."""

import hashlib
import time
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from tf2_msgs.msg import TFMessage

from vpsci_msgs.msg import EpisodeEvent, PolicyWeights
from vpsci_ros.bags.episodes import RECORD, BagEpisode, EpisodeLog, EventRow, event_rows
from vpsci_ros.bags.run_record import NODE, SCENARIO, SOFTWARE, WEIGHTS, node_record, scenario_records, software_record
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import serialized
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.config import EXECUTABLES, NODES, RecorderConfig
from vpsci_ros.nodes.exchange import Outgoing
from vpsci_ros.nodes.peer_parameters import PeerParameters
from vpsci_ros.nodes.serialized import message_of
from vpsci_ros.nodes.topics import LATCHED, RECORDING, TOPICS, Topic, speakers
from vpsci_ros.wire import layout, received
from vpsci_ros.wire.decoder import describe
from vpsci_ros.wire.layout import EVENTS, SAFETY, WORLD
from vpsci_ros.wire.padding import zeroed
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Actions

POLL = 0.02  # [s]: at a thousand ticks a second two hundred messages at once, in place of as many calls
_ACTIONS = {f"/{agent}/action": agent for agent in AGENTS}


class Recorder(GraphNode):
    """Every topic of the table that names the recorder, raw, into one bag.

    Log times are the simulated times in the messages, so that a bag plays back at the pace of the world and is the
    same for the same seed; publish times are the wall times of receipt. Beside the messages the bag gets the
    parameters of the other nodes, which it requests, and a record of each episode.
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
        self._rows = 0  # of the arrays of states and answers; 0: not known
        self._episodes = EpisodeLog()
        self._ended: list[BagEpisode] = []
        self._recorded_episodes = 0
        self._untimed = explicit and "world_simulator" not in self.peers  # stage 1: diagnostics alone, in wall time
        if self._untimed:
            self.simulated_time = self.get_clock().now().to_msg()
        self._at = -1  # [ns] of the latest message
        self._begun = time.monotonic()
        serialized.warm_up()
        others = [name for name in (self.peers if explicit else NODES) if name not in ("recorder", "replayer")]
        self._peer_parameters = PeerParameters(self, others, self._on_parameters)
        if "learner" in others:
            self.input("/policy/weights", _digest, partial(self._bag.describe, WEIGHTS), LATCHED)
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
            take = partial(self._on_message, row.name)
            self.input(row.name, lambda message: message, take, RECORDING, raw=True, polled=True)
        self._waiting = []
        self.wall_timer(POLL, self.intake.poll)

    def _on_message(self, topic: str, message: bytes | Outgoing) -> None:
        data = bytes(message)
        if TOPICS[topic].shared and not self.intake.read(topic, _is_own, topic, data, self.frame_prefix):
            return
        at = self.intake.read(topic, received.stamp, topic, data)
        clean = None if at is None else self.intake.read(topic, zeroed, TOPICS[topic].type_name, data, topic)
        ticked = self.intake.read(topic, self._checked, topic, message) if clean is not None else None
        if at is None or clean is None or ticked is None:
            self._bag.refuse(topic)
            return
        if self._ended and at > self._ended[0].end_time:
            self._write_ended()
        self._bag.write(topic, clean, at, time.time_ns())
        tick, events = ticked
        if events:
            self._ended += self._episodes.add(tick, at, events, self._bag.files[-1].name)
        if at != self._at and (topic != "/diagnostics" or self._untimed):
            self._at = at
            self.simulated_time = Time(sec=at // 1_000_000_000, nanosec=at % 1_000_000_000)

    def _checked(self, topic: str, message: bytes | Outgoing) -> tuple[int, list[EventRow]]:
        """Return the tick and the events of an EpisodeEvent, none of other messages.

        :raises InvalidInput: a state, an answer or events that the nodes which act on them refuse as well.
        """
        if topic == EVENTS:
            event = message_of(bytes(message), EpisodeEvent, EVENTS)
            return event.tick, event_rows(layout.events(event))
        if topic == WORLD:
            rows = len(serialized.shown(message).tick.state)
            if self._rows and rows != self._rows:
                raise InvalidInput(f"{topic}: expected {self._rows} pedestrians, got {rows}; are two worlds here?")
        elif topic == SAFETY and self._rows:
            layout.safety_state(serialized.safety_state(message), self._rows)
        elif topic in _ACTIONS and self._rows:
            Actions(**{_ACTIONS[topic]: layout.action(serialized.action(message, topic), self._rows, topic)})
        return 0, []

    def _write_ended(self) -> None:
        """Write the records of the episodes whose last tick is over."""
        for episode in self._ended:
            self._bag.add_metadata(RECORD, episode.to_record())
        self._recorded_episodes += len(self._ended)
        self._ended.clear()

    def _on_parameters(self, node: str, values: dict[str, Any]) -> None:
        scenarios = scenario_records(load_scenarios(values.get("scenarios", ()), values.get("scenario_files", ())))
        self._bag.describe(NODE, node_record(node, values))
        if node == "world_simulator":
            self._rows = int(values.get("batch", 0)) * int(values.get("pedestrians", 1))
        for record in scenarios:
            self._bag.describe(SCENARIO, record)

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
        self.intake.poll()
        self._write_ended()
        totals = {"episodes": str(self._recorded_episodes), "episodes_unfinished": str(self._episodes.unfinished)}
        self._bag.close(totals)
        written = sum(topic.messages for topic in self._bag.topics.values())
        self.get_logger().info(f"wrote {self._bag.folder}: {written} messages, {self._recorded_episodes} episodes")


def _digest(message: PolicyWeights) -> dict[str, str]:
    """Return the record of weights that the learner of this run has published.

    :raises InvalidInput: they are another's.
    """
    return {"version": str(message.version), "sha256": hashlib.sha256(received.weights(message)).hexdigest()}


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
