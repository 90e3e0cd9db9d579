"""Write a rosbag2 folder with MCAP storage from serialized messages: schemas embedded, chunks compressed with zstd.

`mcap` writes the file; this module adds what makes it a bag (metadata.yaml, the QoS of each channel) and keeps the
part that is already on disk whole: chunks are handed to the operating system as they fill, so that a writer that is
killed leaves a file that is readable up to its last chunk (`vpsci_ros.data.bags.repair_bag` then completes it).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from mcap.writer import CompressionType, Writer

from vpsci_ros import __version__
from vpsci_ros.errors import VpsciError
from vpsci_ros.provenance import require_empty_folder, written_whole

BAG_VERSION = 9  # of rosbag2's metadata.yaml, the one that ROS 2 Jazzy writes


@dataclass
class BagTopic:
    """One topic of a bag: its type ("vpsci_msgs/msg/WorldState"), definition, hash, and QoS as rosbag2 writes it."""

    name: str
    type: str
    definition: str
    type_hash: str
    latched: bool = False
    messages: int = 0
    channel: int = field(default=-1, repr=False)

    def qos(self) -> dict[str, object]:
        """Return the offered QoS profile in the form of metadata.yaml."""
        forever = {"sec": 9223372036, "nsec": 854775807}
        return {
            "history": "keep_last",
            "depth": 1 if self.latched else 1000,
            "reliability": "reliable",
            "durability": "transient_local" if self.latched else "volatile",
            "deadline": forever,
            "lifespan": forever,
            "liveliness": "automatic",
            "liveliness_lease_duration": forever,
            "avoid_ros_namespace_conventions": False,
        }


class BagWriter:
    """A bag being written.

    :param folder: made if need be; must be empty.
    :param chunk_size: size of a chunk before compression [bytes].
    :raises InvalidInput: the folder is not empty.
    """

    def __init__(self, folder: str | Path, topics: list[BagTopic], *, chunk_size: int = 256 * 1024) -> None:
        self.folder = require_empty_folder(folder)
        self.path = self.folder / f"{self.folder.name}_0.mcap"
        self.topics = {topic.name: topic for topic in topics}
        self._file = open(self.path, "wb")  # noqa: SIM115 - closed by close()
        self._writer = Writer(
            self._file, chunk_size=chunk_size, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start(profile="ros2", library=f"vpsci_ros {__version__}")
        self._first = 2**63 - 1
        self._last = 0
        schemas: dict[str, int] = {}
        for topic in topics:
            if topic.type not in schemas:
                schemas[topic.type] = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            profile = yaml.safe_dump([topic.qos()], sort_keys=False)
            details = {"offered_qos_profiles": profile, "topic_type_hash": topic.type_hash}
            topic.channel = self._writer.register_channel(topic.name, "cdr", schemas[topic.type], details)

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Append one serialized (CDR) message; times are in nanoseconds.

        :raises VpsciError: the disk refuses it.
        """
        row = self.topics[topic]
        try:
            self._writer.add_message(row.channel, log_time, data, publish_time, row.messages)
            self._file.flush()  # a chunk that has just filled goes to the operating system at once
        except OSError as error:
            raise VpsciError(f"{self.path}: cannot write ({error.strerror}); free some space, record again") from error
        row.messages += 1
        self._first = min(self._first, log_time)
        self._last = max(self._last, log_time)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Store a named record of text values in the file, found again without reading the messages."""
        self._writer.add_metadata(name, dict(values))

    def close(self, custom_data: Mapping[str, str]) -> None:
        """Write the file's index and metadata.yaml; `custom_data` goes into both."""
        self.add_metadata("vpsci_ros", custom_data)
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        write_metadata(self.folder, [self.path.name], list(self.topics.values()), self._first, self._last, custom_data)


def write_metadata(
    folder: Path, files: list[str], topics: list[BagTopic], first: int, last: int, custom_data: Mapping[str, str]
) -> None:
    """Write a bag's metadata.yaml; `first` and `last` are the log times [ns] of its messages."""
    count = sum(topic.messages for topic in topics)
    start = {"nanoseconds_since_epoch": first if count else 0}
    duration = {"nanoseconds": last - first if count else 0}
    information = {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [topic.qos()],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.messages,
            }
            for topic in topics
        ],
        "compression_format": "",  # empty: chunks are compressed inside MCAP, which readers see to themselves
        "compression_mode": "",
        "relative_file_paths": files,
        "files": [
            {"path": name, "starting_time": start, "duration": duration, "message_count": count} for name in files[:1]
        ],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",
    }
    with written_whole(folder / "metadata.yaml") as path:
        text = yaml.dump({"rosbag2_bagfile_information": information}, Dumper=_NoAliases, sort_keys=False)
        path.write_text(text, encoding="utf-8")


class _NoAliases(yaml.SafeDumper):  # type: ignore[misc]
    """Readers of metadata.yaml in C++ get every value in place, not as a YAML alias."""

    def ignore_aliases(self, data: object) -> bool:
        return True
