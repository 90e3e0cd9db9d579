"""A recorded bag, this package's or another ROS 2 tool's: MCAP or sqlite3, one file or several, whole or in part."""

import re
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.sqlite_file import SqliteFile
from vpsci_ros.bags.topic_info import TopicInfo, by_name
from vpsci_ros.documents import read_yaml, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage

_STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {".mcap": McapFile, ".db3": SqliteFile}


class Bag:
    """A bag that is read as often as need be; nothing of it is kept in memory.

    :param path: a rosbag2 folder, with or without its metadata.yaml, or one of its files.
    :param recover: read what is whole of a bag that was not closed or is damaged, instead of refusing it.
    :ivar path: as given.
    :ivar files: its files in the order of recording.
    :raises InvalidInput: no such bag.
    """

    def __init__(self, path: str | Path, *, recover: bool = False) -> None:
        self.path = Path(path)
        self.files: list[McapFile | SqliteFile] = [
            _STORAGES[file.suffix](file, strict=not recover) for file in bag_files(path)
        ]

    @property
    def damage(self) -> list[str]:
        """What was found wrong while reading, one sentence each."""
        return [f"{file.path.name}: {text}" for file in self.files for text in dict.fromkeys(file.damage)]

    def topics(self) -> dict[str, TopicInfo]:
        """Return the bag's topics by name.

        :raises InvalidInput: a file is not what its name says, or (unless `recover`) not whole.
        """
        return by_name(row for file in self.files for row in file.topics())

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
        for file in self.files:
            yield from file.select(topics, start, stop, ordered=ordered)


def bag_files(path: str | Path) -> list[Path]:
    """Return the files of a bag in the order of recording.

    :raises InvalidInput: no such folder or file, none in it, or files that are compressed as a whole.
    """
    path = Path(path)
    require_regular(path)
    if path.is_file() and path.suffix in _STORAGES:
        return [path]
    if not path.is_dir():
        raise InvalidInput(f"{path}: no such folder; expected a rosbag2 folder with an .mcap or .db3 file")
    inside = [file for file in path.iterdir() if not file.name.startswith(".")]
    files = [file for file in inside if file.suffix in _STORAGES]
    if not files:
        if packed := sorted(file.name for file in inside if file.suffix == ".zstd"):
            raise InvalidInput(f"{path}: {packed[0]} is compressed as a whole; unpack it (zstd -d) and try again")
        raise InvalidInput(f"{path}: no .mcap file and no .db3; expected a rosbag2 folder as a recorder writes it")
    for file in files:
        require_regular(file)
        if file.is_dir():
            raise InvalidInput(f"{file}: expected a file of a bag, found a folder")
    if len(kinds := Counter(file.suffix for file in files)) > 1:
        raise InvalidInput(f"{path}: expected one kind of file, got {' and '.join(kinds)}; this is more than one bag")
    if str(_information(path).get("compression_mode", "")).lower() == "message":
        raise InvalidInput(f"{path}: each message is compressed; write it again with `ros2 bag convert` and try again")
    return sorted(files, key=_number)


def _information(path: Path) -> dict[str, Any]:
    """Return what metadata.yaml says, nothing where it is missing or unreadable: the files themselves say more."""
    try:
        return dict(read_yaml(path / "metadata.yaml")["rosbag2_bagfile_information"])
    except (KeyError, TypeError, ValueError):
        return {}


def _number(file: Path) -> tuple[str, int]:
    """Sort bag_10.mcap after bag_9.mcap."""
    found = re.fullmatch(r"(.*?)(\d*)", file.stem)
    assert found is not None
    return found[1], int(found[2] or 0)
