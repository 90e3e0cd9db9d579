"""Bags whose messages were forged one by one, in files that are whole: states that are no numbers or lie elsewhere.

`vpsci bag verify` may call such a bag the same only if nothing that it compares has changed, and `vpsci bag export`
writes numbers or refuses. Whatever else is a defect.
"""

import io
import random
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.bags.export import export_bag
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import NODE, bag_run, node_record
from vpsci_ros.bags.verify import VerifiedBag, verify_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage, known_types
from vpsci_ros.wire.layout import EVENTS, SAFETY, WORLD

COMPARED = (WORLD, SAFETY, EVENTS)
WAYS = ("not a number", "elsewhere", "elsewhere from then on", "lost", "twice", "once more at the end", "exchanged")


def bag(folder: Path) -> Path:
    """Make the whole bag: two episodes by rules."""
    from chaos import files

    return files._bag(folder).parent


def case(seed: int, whole: Path) -> tuple[str, str]:
    """Forge one message, or all after it, and read the bag: return the way, and "told", "the same" or a defect."""
    rng = random.Random(f"bags/{seed}")
    way = WAYS[seed % len(WAYS)]
    before = list(Bag(whole).messages())
    after = forged(before, way, rng)
    with tempfile.TemporaryDirectory() as folder:
        return way, judged(written(whole, after, Path(folder) / "bag"), same=_content(before) == _content(after))


def judged(path: Path, *, same: bool) -> str:
    """Return the verdict on a forged bag; `same`: it holds what the whole one holds."""
    try:
        found: VerifiedBag = verify_bag(path)
        told = bool(found.difference or found.uncompared)
    except InvalidInput:
        told = True
    if not told and not same:
        return f"verified as the same to the bit, {found.ticks} ticks"
    said = io.StringIO()
    try:
        export_bag(path, path.parent / "out", keep_rejected=True, console=Console(file=said, width=200))
    except InvalidInput:
        return "told"
    tables = [pl.read_parquet(table) for table in (path.parent / "out").rglob("Location*.parquet")]
    empty = sum(int(table.select(pl.any_horizontal(pl.selectors.float().is_nan())).sum().item()) for table in tables)
    if bool(empty) != ("empty cells" in said.getvalue()) or (empty and not told):
        return f"exported with {empty} rows that hold numbers which are none, without a word"
    return "told" if told else "the same"


def forged(messages: list[RawMessage], way: str, rng: random.Random) -> list[RawMessage]:
    """Return the messages with one of them, or all after it, changed."""
    place = rng.choice([at for at, raw in enumerate(messages) if raw.topic in COMPARED])
    raw, rest = messages[place], messages[place + 1 :]
    if way == "lost":
        return messages[:place] + rest
    if way == "twice":
        return [*messages[: place + 1], raw, *rest]
    if way == "once more at the end":
        return [*messages, raw]
    if way == "exchanged":
        other = rng.choice([at for at, each in enumerate(messages) if each.topic == raw.topic])
        out = list(messages)
        out[place], out[other] = raw._replace(data=messages[other].data), messages[other]._replace(data=raw.data)
        return out
    field = rng.choice([name for name, value in _fields(raw).items() if _has_floats(value)])
    by = np.nan if way == "not a number" else rng.choice((7.0, -0.5, 1e-9, 1e9))
    to = len(messages) if way.endswith("from then on") else place + 1
    return [
        shifted(each, field, by) if place <= at < to and each.topic == raw.topic else each
        for at, each in enumerate(messages)
    ]


def shifted(raw: RawMessage, field: str, by: float) -> RawMessage:
    """Return a message with this added to all numbers of a field."""
    store = known_types()
    message = store.deserialize_cdr(raw.data, raw.type)
    setattr(message, field, getattr(message, field) + by)
    return raw._replace(data=bytes(store.serialize_cdr(message, raw.type)))


def written(whole: Path, messages: list[RawMessage], folder: Path) -> Path:
    """Write a bag of these messages, with the parameters of the whole one."""
    source = Bag(whole)
    topics = {raw.topic: BagTopic(raw.topic, raw.type, raw.definition, "RIHS01_0") for raw in source.messages()}
    writer = BagWriter(folder, list(topics.values()))
    for node, values in bag_run(source).parameters.items():
        writer.describe(NODE, node_record(node, values))
    for raw in messages:
        writer.write(raw.topic, raw.data, raw.time, 0)
    writer.close({})
    return folder


def _fields(raw: RawMessage) -> dict[str, Any]:
    return vars(known_types().deserialize_cdr(raw.data, raw.type))


def _has_floats(value: Any) -> bool:
    return isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size > 0)


def _content(messages: list[RawMessage]) -> Counter[tuple[str, bytes]]:
    return Counter((raw.topic, bytes(raw.data)) for raw in messages if raw.topic in COMPARED)
