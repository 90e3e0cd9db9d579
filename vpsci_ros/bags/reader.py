"""A recorded bag of this package or another ROS 2 tool: MCAP, one or several files, complete or not."""

import contextlib
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.topic_info import TopicInfo, by_name
from vpsci_ros.documents import read_yaml, refuse_pointer, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage

_SQLITE = "a bag in sqlite3 storage is not read: have `ros2 bag convert` make one of MCAP"


class BagTick(NamedTuple):
    """The world and the safety monitor's answer at one tick; NaN where the bag has no answer."""

    number: int
    period: float  # [s] from one tick to the next
    state: NDArray[np.void]  # EPISODE[B]; fields that the message does not carry are 0
    curvttc: NDArray[np.float64]  # [B] [s]
    distance: NDArray[np.float64]  # [B] [m]
    time: int = 0  # [ns] log time in the bag


class Bag:
    """A bag on disk, which can be read repeatedly; messages are not kept in memory.

    :param path: a rosbag2 folder, with or without its metadata.yaml, or one of its files.
    :param recover: read what is whole of a bag that was not closed, is damaged or lacks files, instead of refusing it.
    :ivar path: as given.
    :ivar files: its files in the order of recording.
    :raises InvalidInput: no such bag, or (unless `recover`) metadata.yaml lists a file that is not there.
    """

    def __init__(self, path: str | Path, *, recover: bool = False) -> None:
        self.path, self.recover = Path(path), recover
        self.files = [McapFile(file, strict=not recover) for file in bag_files(path)]
        self._information = bag_information(self.path)
        self.lost_files = lost_files(self.path, self._information)
        if self.lost_files and not recover:
            raise InvalidInput(
                f"{path}: {self.lost_files}; copy it again, read what is here with --recover, or have "
                "`vpsci bag repair` write metadata.yaml again"
            )

    def __str__(self) -> str:
        return str(self.path)

    @property
    def damage(self) -> list[str]:
        """The damage found while reading, one sentence for each."""
        of_files = [f"{file.path.name}: {text}" for file in self.files for text in dict.fromkeys(file.damage)]
        return [self.lost_files] * bool(self.lost_files) + of_files

    def topics(self) -> dict[str, TopicInfo]:
        """Return the bag's topics by name.

        :raises InvalidInput: a file is no MCAP file, or (unless `recover`) is damaged.
        """
        return by_name(row for file in self.files for row in file.topics())

    def require_complete(self, written: Mapping[str, int]) -> None:
        """Refuse a folder that holds fewer messages of a topic than its recorder or metadata.yaml has counted.

        One that `vpsci bag repair` has completed says so, one file of several is not the bag, and a topic that somebody
        left out is not lost.

        :param written: by the recorder's own record, by topic.
        :raises InvalidInput: (unless `recover`) it does.
        """
        if self.recover or self.path.is_file() or "recovered" in (self._information.get("custom_data") or {}):
            return
        with contextlib.suppress(KeyError, TypeError, ValueError):
            rows = self._information["topics_with_message_count"]
            listed = {row["topic_metadata"]["name"]: int(row["message_count"]) for row in rows}
            written = {name: max(listed.get(name, 0), written.get(name, 0)) for name in listed | dict(written)}
        for name, topic in self.topics().items():
            if topic.messages < (count := written.get(name, 0)):
                raise InvalidInput(
                    f"{self.path}: it holds {topic.messages:,} of the {count:,} messages of {name} that were "
                    "recorded: a file is lost or an older one; copy it again, or read what is here with --recover"
                )

    def records(self) -> list[tuple[str, dict[str, str]]]:
        """Return the text records of all files with their names, in the order of writing.

        :raises InvalidInput: see `topics`.
        """
        return [record for file in self.files for record in file.named_records()]

    def messages(
        self, topics: Collection[str] | None = None, start: int = 0, stop: int = 2**63 - 1, *, ordered: bool = False
    ) -> Iterator[RawMessage]:
        """Yield the messages of these topics (None: all) with log times from `start` to `stop` [ns], both included.

        :param ordered: by log time within each file; else in the order of writing.
        :raises InvalidInput: see `topics`.
        """
        if str(self._information.get("compression_mode", "")).lower() == "message":
            raise InvalidInput(
                f"{self.path}: its messages are compressed one by one; have `ros2 bag convert` unpack them"
            )
        for file in self.files:
            yield from file.select(topics, start, stop, ordered=ordered)


def opened(bag: str | Path | Bag) -> Bag:
    """Return the `Bag` of a path; an open `Bag` is returned as it is."""
    return bag if isinstance(bag, Bag) else Bag(bag)


def bag_files(path: str | Path) -> list[Path]:
    """Return the files of a bag in the order of recording.

    :raises InvalidInput: no such folder or file, or none in it.
    """
    path = Path(path)
    require_regular(path)
    if path.is_file() and path.suffix == ".mcap":
        refuse_pointer(path)
        return [path]
    if path.suffix == ".db3":
        raise InvalidInput(f"{path}: {_SQLITE}")
    if not path.is_dir():
        raise InvalidInput(f"{path}: no such folder; expected a rosbag2 folder with an .mcap file")
    inside = [file for file in path.iterdir() if not file.name.startswith(".")]
    files = [file for file in inside if file.suffix == ".mcap"]
    if not files and any(file.suffix == ".db3" for file in inside):
        raise InvalidInput(f"{path}: {_SQLITE}")
    if not files:
        raise InvalidInput(f"{path}: no .mcap file; expected a rosbag2 folder, with files unpacked by zstd -d")
    require_regular(path / "metadata.yaml")
    for file in files:
        require_regular(file)
        if file.is_dir():
            raise InvalidInput(f"{file}: expected a file of a bag, found a folder")
        refuse_pointer(file)
    return sorted(files, key=_number)


def lost_files(path: Path, information: Mapping[str, Any]) -> str:
    """Return a sentence that names the files listed in metadata.yaml that a folder lacks; "" if it lacks none."""
    listed = information.get("relative_file_paths")
    names = [Path(str(name)).name for name in listed] if isinstance(listed, list) else []
    lost = [name for name in names if not (path / name).exists()]
    return f"metadata.yaml lists {', '.join(lost)}, which the folder lacks" if lost else ""


def bag_information(path: Path) -> dict[str, Any]:
    """Return the content of metadata.yaml; empty if it is missing or unreadable."""
    try:
        return dict(read_yaml(path / "metadata.yaml")["rosbag2_bagfile_information"])
    except (KeyError, TypeError, ValueError):
        return {}


def _number(file: Path) -> tuple[str, int]:
    """Return the key that sorts bag_10.mcap after bag_9.mcap: the name without its last number, and this number."""
    found = re.fullmatch(r"(.*?)(\d*)", file.stem)
    assert found is not None
    return found[1], int(found[2] or 0)
