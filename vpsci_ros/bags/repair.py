"""Repair of a bag whose recorder was killed: complete messages, index and metadata.yaml are written again."""

import contextlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import Writer

from vpsci_ros import __version__
from vpsci_ros.bags.mcap_file import McapFile, latched
from vpsci_ros.bags.reader import bag_files, bag_information, lost_files
from vpsci_ros.bags.writer import CHUNK_SIZE, RUN, TOTALS, BagFile, BagTopic, write_metadata
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.output_folder import FolderLock


@dataclass(frozen=True)
class Repair:
    """The result of `repair_bag`: what the bag now holds, and what was wrong.

    :ivar messages: topic -> messages that the bag now holds.
    :ivar damage: what was wrong, one sentence each; empty: the files were whole.
    :ivar rewritten: whether anything had to be written.
    """

    messages: dict[str, int]
    damage: tuple[str, ...]
    rewritten: bool

    def __str__(self) -> str:
        total = sum(self.messages.values())
        if not self.rewritten:
            return f"the bag is complete: {total} messages; nothing was changed"
        found = "; ".join(self.damage) or "metadata.yaml was missing"
        return f"{found}; recovered {total} messages on {len(self.messages)} topics"


def repair_bag(folder: str | Path) -> Repair:
    """Rewrite the files of a bag that break off or are damaged, and write metadata.yaml if it is missing or stale.

    Each file is written beside and renamed, metadata.yaml comes last: whenever this is interrupted, the bag is as it
    was or can be repaired again.

    :raises InvalidInput: no folder of a bag, no whole message in it, or a bag that is being recorded.
    """
    paths = bag_files(folder)
    with contextlib.closing(FolderLock(paths[0].parent)):
        return _repaired(Path(folder), paths)


def _repaired(folder: Path, paths: list[Path]) -> Repair:
    topics: dict[str, BagTopic] = {}
    counts: Counter[str] = Counter()
    damage: list[str] = []
    custom: dict[str, str] = {}
    if paths[0].parent != folder:
        raise InvalidInput(f"{folder}: expected the folder of a bag; what is whole of a file is read with --recover")
    if lost := lost_files(folder, bag_information(folder)):
        damage.append(lost)
    files = [BagFile(path.name) for path in paths]
    for path, part in zip(paths, files, strict=True):
        file = McapFile(path, strict=False)
        for schema, channel, message in file.messages():
            if channel.topic not in topics:
                details = channel.metadata
                type_hash, text = details.get("topic_type_hash", ""), schema.data.decode(errors="replace")
                topics[channel.topic] = BagTopic(channel.topic, schema.name, text, type_hash, bool(latched(channel)))
            counts[channel.topic] += 1
            part.count(message.log_time)
        damage += [f"{path.name}: {text}" for text in file.damage]
        custom |= dict(file.records).get(RUN, {})
    if not counts:
        raise InvalidInput(
            f"{folder}: no whole message in {', '.join(path.name for path in paths)}; nothing to recover"
        )
    if not damage and (lost_messages := int(custom.get("messages_written", 0)) - counts.total()) > 0:
        damage.append(f"{lost_messages} messages that its recorder has counted are lost with their file")
    if not damage and (folder / "metadata.yaml").is_file():
        return Repair(dict(counts), (), False)
    for path in paths:
        if any(text.startswith(f"{path.name}: ") for text in damage):
            _rewrite(path)
    for name, topic in topics.items():
        topic.messages = counts[name]
    if damage:  # what earlier files say of the numbers of messages is of an earlier time
        custom = {name: text for name, text in custom.items() if name not in TOTALS}
        custom["recovered"] = "; ".join(damage)
    write_metadata(folder, files, list(topics.values()), custom)
    return Repair(dict(counts), tuple(damage), True)


def _rewrite(path: Path) -> None:
    """Write the whole messages of a file to a complete one, and put that in its place."""
    source = McapFile(path, strict=False)
    with atomic_write(path) as part, part.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_SIZE, enable_data_crcs=True)
        writer.start(profile="ros2", library=f"vpsci_ros {__version__}")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for schema, channel, message in source.messages():
            if channel.topic not in channels:
                if schema.name not in schemas:
                    schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.name], channel.metadata
                )
            number = channels[channel.topic]
            writer.add_message(number, message.log_time, message.data, message.publish_time, message.sequence)
        for name, values in source.records:
            writer.add_metadata(name, values)
        writer.finish()  # type: ignore[no-untyped-call]
