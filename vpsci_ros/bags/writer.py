"""Write a rosbag2 folder with MCAP storage from serialized messages: schemas embedded, chunks compressed with zstd.

`mcap.writer` writes the file; this module adds what makes it a bag (metadata.yaml, the QoS of each channel) and keeps
the part that is already on disk whole: chunks are handed to the operating system as they fill, so that a writer that is
killed leaves a file that is readable up to its last chunk (`vpsci_ros.bags.repair` then completes it).
"""

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mcap.writer import CompressionType, Writer

from vpsci_ros import __version__
from vpsci_ros.documents import dump_yaml, in_utf8
from vpsci_ros.errors import VpsciError
from vpsci_ros.runs.files import require_empty_folder, write_text
from vpsci_ros.runs.output_folder import FolderLock

RUN = "vpsci_ros"  # name of the record with which every file ends
COUNTS = {"seen": "seen", "written": "messages", "refused": "refused"}  # its keys by topic -> fields of `BagTopic`
TOTALS = (*COUNTS, *(f"messages_{name}" for name in COUNTS))  # its keys about numbers of messages
CHUNK_SIZE = 64 * 1024  # [bytes] before compression: a killed recorder or a damaged byte costs no more than that
BAG_VERSION = 9  # of rosbag2's metadata.yaml, the one that ROS 2 Jazzy writes


@dataclass
class BagTopic:
    """One topic of a bag: its type ("vpsci_msgs/msg/WorldState"), definition, hash, whether it is latched, and counts.

    `seen` counts the messages that came, `messages` those that were written, `refused` those that could not be read.
    """

    name: str
    type: str
    definition: str
    type_hash: str
    latched: bool = False
    seen: int = 0
    messages: int = 0
    refused: int = 0
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


@dataclass
class BagFile:
    """One file of a bag: its name, and its entries in `metadata.yaml`; times are log times [ns]."""

    name: str
    first: int = 2**63 - 1
    last: int = 0
    messages: int = 0

    def count(self, log_time: int) -> None:
        """Count one written message of the file."""
        self.first, self.last = min(self.first, log_time), max(self.last, log_time)
        self.messages += 1


class BagWriter:
    """Writes a bag: a folder with MCAP files and metadata.yaml.

    :param folder: made if need be; must be empty.
    :param chunk_size: size of a chunk before compression [bytes].
    :param split_size: begin another file when one has this size [bytes]; 0: never.
    :raises InvalidInput: the folder is not empty, or another process writes into it.
    """

    def __init__(
        self, folder: str | Path, topics: list[BagTopic], *, chunk_size: int = CHUNK_SIZE, split_size: int = 0
    ) -> None:
        self._lock = FolderLock(folder)
        self.folder = require_empty_folder(folder)
        if self._lock.made:
            self.folder.chmod(0o700)  # positions of people
        self.topics = {topic.name: topic for topic in topics}
        self.files: list[BagFile] = []
        self._chunk_size = chunk_size
        self._split_size = split_size
        self._described: list[tuple[str, dict[str, str]]] = []
        self._refusal = ""  # of the disk, why
        self._open()

    @property
    def path(self) -> Path:
        """Path of the file that is being written."""
        return self.folder / self.files[-1].name

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Append one serialized (CDR) message; times are in nanoseconds.

        :raises VpsciError: the disk refuses it.
        """
        row = self.topics[topic]
        if self._refusal:
            self._require_whole()
        try:  # rather than `_on_disk`, which takes as long as half a small message
            if self._full and self.files[-1].messages:
                self._finish()
                self._open()
            row.seen += 1
            self._writer.add_message(row.channel, log_time, data, publish_time, row.messages)
            self.files[-1].count(log_time)
            if self._file.tell() != self._written:
                self._flush()  # a chunk that has just filled goes to the operating system at once
        except OSError as error:
            raise self._refused(error) from error
        row.messages += 1

    def refuse(self, topic: str) -> None:
        """Count a received message that is not written, since it cannot be read."""
        self.topics[topic].seen += 1
        self.topics[topic].refused += 1

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Store a named record of text values, which can be read without the messages; errors as `write`."""
        with self._on_disk():
            self._writer.add_metadata(name, {key: in_utf8(value) for key, value in values.items()})
            self._flush()

    def describe(self, name: str, values: Mapping[str, str]) -> None:
        """Store a named record of text values in this file and in every one that follows; errors as `write`."""
        self._described.append((name, {key: in_utf8(value) for key, value in values.items()}))
        self.add_metadata(name, values)

    def close(self, custom_data: Mapping[str, str]) -> None:
        """Write the file's last text record and index, and metadata.yaml.

        :param custom_data: goes into the text record and metadata.yaml, beside the numbers of messages.

        :raises VpsciError: the disk refuses it, or has refused anything before: then the last file breaks off, and has
            to be repaired. Or the folder does not exist any more.
        """
        with self._on_disk():
            self._finish(custom_data)
            write_metadata(self.folder, self.files, list(self.topics.values()), self._totals() | dict(custom_data))
        self._lock.close()

    @contextlib.contextmanager
    def _on_disk(self) -> Iterator[None]:
        self._require_whole()
        try:
            yield
        except OSError as error:
            raise self._refused(error) from error

    def _require_whole(self) -> None:
        if self._refusal:
            raise VpsciError(f"{self.path}: not complete, since the disk refused a part of it ({self._refusal})")

    def _refused(self, error: OSError) -> VpsciError:
        self._refusal = error.strerror or repr(error)
        with contextlib.suppress(OSError):  # which the disk refuses as well
            self._file.close()
        return VpsciError(f"{self.path}: cannot write ({self._refusal}); free some space, record again")

    def _open(self) -> None:
        self.files.append(BagFile(f"{self.folder.name}_{len(self.files)}.mcap"))
        self._file = open(self.path, "wb")  # noqa: SIM115 - closed by _finish()
        self._writer = Writer(self._file, self._chunk_size, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=f"vpsci_ros {__version__}")
        schemas: dict[str, int] = {}
        for topic in self.topics.values():
            if topic.type not in schemas:
                schemas[topic.type] = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            profile = dump_yaml([topic.qos()])
            details = {"offered_qos_profiles": profile, "topic_type_hash": topic.type_hash}
            topic.channel = self._writer.register_channel(topic.name, "cdr", schemas[topic.type], details)
        for name, values in self._described:
            self._writer.add_metadata(name, values)
        self._look()

    def _flush(self) -> None:
        self._file.flush()
        self._look()

    def _look(self) -> None:
        self._written = self._file.tell()
        self._full = bool(self._split_size) and self._written >= self._split_size

    def _finish(self, custom_data: Mapping[str, str] | None = None) -> None:
        self.add_metadata(RUN, self._totals() | dict(custom_data or {}))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _totals(self) -> dict[str, str]:
        """Return, as texts, the numbers of messages seen, written and, if any, refused so far: in all and by topic."""
        rows = self.topics.values()
        counted = {name: {topic.name: getattr(topic, field) for topic in rows} for name, field in COUNTS.items()}
        by_topic = {name: count for name, count in counted.items() if name != "refused" or any(count.values())}
        together = {f"messages_{name}": str(sum(count.values())) for name, count in by_topic.items()}
        return together | {name: json.dumps(count) for name, count in by_topic.items()}


def write_metadata(folder: Path, files: list[BagFile], topics: list[BagTopic], custom_data: Mapping[str, str]) -> None:
    """Write a bag's metadata.yaml."""
    whole = BagFile("")
    whole.messages = sum(file.messages for file in files)
    whole.first, whole.last = min(file.first for file in files), max(file.last for file in files)
    information = {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        **_extent(whole),
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
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **_extent(file)} for file in files],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",
    }
    write_text(folder / "metadata.yaml", dump_yaml({"rosbag2_bagfile_information": information}))


def _extent(file: BagFile) -> dict[str, object]:
    count = file.messages
    return {
        "duration": {"nanoseconds": file.last - file.first if count else 0},
        "starting_time": {"nanoseconds_since_epoch": file.first if count else 0},
        "message_count": count,
    }
