"""The recorder: writes every message of the graph, as it came off the wire, to a rosbag2 folder with MCAP storage."""

import struct
import sys
import time
from functools import partial
from typing import Any

from rclpy.context import Context

from vpsci_ros.config import RecorderConfig
from vpsci_ros.data.bag_writer import BagTopic, BagWriter
from vpsci_ros.nodes import schemas
from vpsci_ros.nodes.base import GraphNode, run
from vpsci_ros.nodes.topics import RECORDING, TOPICS, speakers

DRAIN_QUIET = 0.3  # [s] without a message: nothing is on its way any more


class Recorder(GraphNode):
    """Every topic of the table that names the recorder, raw, into one bag.

    Log times are the simulated times in the messages, so that a bag plays back at the pace of the world and is the
    same for the same seed; publish times are the wall times of receipt.
    """

    def __init__(self, *, context: Context | None = None, parameter_overrides: list[Any] | None = None) -> None:
        super().__init__("recorder", context=context, parameter_overrides=parameter_overrides)
        config = self.config(RecorderConfig)
        explicit = set(self.peers) != set(self.essential_peers)
        recorded = [row for row in TOPICS.values() if "recorder" in row.subscribers]
        # A topic without a publisher here is an external driving system's.
        wanted = [row for row in recorded if not (explicit and row.publishers) or speakers(row.name, self.peers)]
        topics = [BagTopic(row.name, *schemas.describe(row.type)) for row in wanted]
        self._bag = BagWriter(config.bag, topics, chunk_size=config.chunk_size * 1024)
        self._last_receipt = time.monotonic()
        for row in wanted:
            self.input(row.name, partial(self._on_message, row.name), RECORDING, raw=True)

    def _on_message(self, topic: str, data: bytes) -> None:
        self._last_receipt = time.monotonic()
        # Every recorded type begins with its stamp, after CDR's 4 bytes; in an array of markers its length comes first.
        seconds, nanoseconds = struct.unpack_from("<iI", data, 8 if topic == "/markers" else 4)
        self._bag.write(topic, data, seconds * 1_000_000_000 + nanoseconds, time.time_ns())

    @property
    def quiet(self) -> bool:
        """Whether nothing has come for a while, so that the bag can be closed without cutting anything off."""
        return time.monotonic() - self._last_receipt > DRAIN_QUIET

    def close(self) -> None:
        """Complete the bag."""
        counts = {name: topic.messages for name, topic in self._bag.topics.items()}
        self._bag.close({"messages_written": str(sum(counts.values()))})
        self.get_logger().info(f"wrote {self._bag.folder} with {sum(counts.values())} messages")


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run(Recorder, args)


if __name__ == "__main__":
    sys.exit(main())
