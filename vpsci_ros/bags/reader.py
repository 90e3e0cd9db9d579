"""A recorded bag, this package's or another ROS 2 tool's: MCAP or sqlite3, one file or several, whole or in part."""

import atexit
import contextlib
import hashlib
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from zstandard import ZstdDecompressor, ZstdError

from vpsci_ros.bags.mcap_file import McapFile
from vpsci_ros.bags.sqlite_file import SqliteFile
from vpsci_ros.bags.topic_info import TopicInfo, by_name
from vpsci_ros.documents import read_yaml, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import written_whole
from vpsci_ros.wire.decoder import RawMessage
from vpsci_ros.wire.layout import WORLD

VEHICLE = "/vehicle/odometry"
PACKED = ".zstd"  # ends the name of a file that is compressed as a whole
MOST_UNPACKED = 2**28, 200  # [bytes] of a message; of a file, times its size
_STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {".mcap": McapFile, ".db3": SqliteFile}


class Bag:
    """A bag that is read as often as need be; nothing of it is kept in memory.

    :param path: a rosbag2 folder, with or without its metadata.yaml, or one of its files.
    :param recover: read what is whole of a bag that was not closed, is damaged or lacks files, instead of refusing it.
    :param topic_prefix: of the graph's topics, such as "/left" of a graph in that namespace, which topics are then
        called without; None: found from their names.
    :ivar path: as given.
    :ivar files: its files in the order of recording.
    :raises InvalidInput: no such bag, or (unless `recover`) metadata.yaml lists a file that is not there.
    """

    def __init__(self, path: str | Path, *, recover: bool = False, topic_prefix: str | None = None) -> None:
        self.path, self.recover, self._prefix = Path(path), recover, topic_prefix
        self.files: list[McapFile | SqliteFile] = [
            _STORAGES[file.suffix](file, strict=not recover) for file in bag_files(path)
        ]
        self._information = bag_information(self.path)
        self.lost_files = lost_files(self.path)
        if self.lost_files and not recover:
            raise InvalidInput(
                f"{path}: {self.lost_files}; copy it again, read what is here with --recover, or have "
                "`vpsci bag repair` write metadata.yaml again"
            )

    def __str__(self) -> str:
        return str(self.path)

    @property
    def damage(self) -> list[str]:
        """What was found wrong while reading, one sentence each."""
        of_files = [f"{file.path.name}: {text}" for file in self.files for text in dict.fromkeys(file.damage)]
        return [self.lost_files] * bool(self.lost_files) + of_files

    def topics(self) -> dict[str, TopicInfo]:
        """Return the bag's topics by name.

        :raises InvalidInput: a file is not what its name says, or (unless `recover`) not whole.
        """
        return by_name(replace(row, name=self._plain[name]) for name, row in self._named.items() if name in self._plain)

    @cached_property
    def _named(self) -> dict[str, TopicInfo]:
        """The topics as the files name them."""
        return by_name(row for file in self.files for row in file.topics())

    @cached_property
    def _plain(self) -> dict[str, str]:
        """Names of topics in the files -> without the graph's prefix; one that hides behind another is left out."""
        prefix = self._prefix
        if prefix is None:
            graphs = {name.removesuffix(own) for own in (WORLD, VEHICLE) for name in self._named if name.endswith(own)}
            prefix = graphs.pop() if len(graphs) == 1 else ""
        prefix = prefix.rstrip("/")
        names = {name: name.removeprefix(prefix) for name in self._named if name.startswith(f"{prefix}/")}
        if not names and self._prefix:
            raise InvalidInput(f"{self.path}: no topic below {self._prefix}; it has {', '.join(self._named) or 'none'}")
        return names | {name: name for name in self._named.keys() - names.keys() - set(names.values())}

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
        for name, topic in (self._named | self.topics()).items():  # whether or not a prefix was put before them
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
        chosen = [name for name, plain in self._plain.items() if topics is None or plain in topics]
        packed = str(self._information.get("compression_mode", "")).lower() == "message"
        for file in self.files:
            for raw in file.select(chosen, start, stop, ordered=ordered):
                data = _unpacked_message(raw.data, self.path) if packed else raw.data
                yield raw._replace(topic=self._plain[raw.topic], data=data)


def opened(bag: str | Path | Bag) -> Bag:
    """Return a bag that may be open already."""
    return bag if isinstance(bag, Bag) else Bag(bag)


def bag_files(path: str | Path) -> list[Path]:
    """Return the files of a bag in the order of recording; one that is compressed as a whole is unpacked elsewhere.

    :raises InvalidInput: no such folder or file, or none in it.
    """
    path = Path(path)
    require_regular(path)
    if path.is_file() and _is_of_bag(path):
        return [_unpacked_file(path)]
    if not path.is_dir():
        raise InvalidInput(f"{path}: no such folder; expected a rosbag2 folder with an .mcap or .db3 file")
    inside = [file for file in path.iterdir() if not file.name.startswith(".")]
    files = [file for file in inside if _is_of_bag(file)]
    if not files:
        raise InvalidInput(f"{path}: no .mcap file and no .db3; expected a rosbag2 folder as a recorder writes it")
    for file in files:
        require_regular(file)
        if file.is_dir():
            raise InvalidInput(f"{file}: expected a file of a bag, found a folder")
    plain = {file.name for file in files}  # beside which the packed one stays
    files = [_unpacked_file(file) for file in files if file.suffix != PACKED or file.stem not in plain]
    if len(kinds := Counter(file.suffix for file in files)) > 1:
        raise InvalidInput(f"{path}: expected one kind of file, got {' and '.join(kinds)}; this is more than one bag")
    return sorted(files, key=_number)


def lost_files(path: Path) -> str:
    """Say which files metadata.yaml lists that are not in the folder; nothing where all are."""
    listed = bag_information(path).get("relative_file_paths")
    names = [Path(str(name)).name.removesuffix(PACKED) for name in listed] if isinstance(listed, list) else []
    lost = [name for name in names if not any((path / each).exists() for each in (name, f"{name}{PACKED}"))]
    return f"metadata.yaml lists {', '.join(lost)}, which the folder lacks" if lost else ""


def _is_of_bag(file: Path) -> bool:
    return Path(file.name.removesuffix(PACKED)).suffix in _STORAGES


@cache
def _room() -> Path:
    """Return a folder for unpacked files, which goes with the process."""
    room = Path(tempfile.mkdtemp(prefix="vpsci_bag_"))
    atexit.register(shutil.rmtree, room, ignore_errors=True)
    return room


def _unpacked_file(path: Path) -> Path:
    """Return a file, unpacked if it is compressed as a whole.

    :raises InvalidInput: it cannot be unpacked.
    """
    if path.suffix != PACKED:
        return path
    status = path.stat()
    folder = _room() / hashlib.sha256(f"{path.resolve()} {status.st_mtime_ns}".encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    if not (unpacked := folder / path.stem).exists():
        try:
            with path.open("rb") as packed, written_whole(unpacked) as part, part.open("wb") as file:
                for block in ZstdDecompressor().read_to_iter(packed):
                    if file.write(block) and file.tell() > MOST_UNPACKED[0] + MOST_UNPACKED[1] * status.st_size:
                        raise ZstdError(f"to more than {MOST_UNPACKED[1]} times its size")
        except ZstdError as error:
            raise InvalidInput(f"{path}: cannot be unpacked: {error}; copy it again") from None
    return unpacked


def _unpacked_message(data: bytes, where: Path) -> bytes:
    try:
        return ZstdDecompressor().decompress(data, max_output_size=MOST_UNPACKED[0])
    except ZstdError as error:
        raise InvalidInput(f"{where}: a message cannot be unpacked: {error}; copy the bag again") from None


def bag_information(path: Path) -> dict[str, Any]:
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
