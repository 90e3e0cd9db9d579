"""Files that are made to harm who reads them: that never end, unpack to much more than they are, or say what is untrue.

Each maker leaves one in an empty folder and returns a function that reads it as its command does. Every one is to be
refused in words, at once.
"""

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, Writer

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.importers import import_trajectories
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import read_text
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.runs.files import sha256
from vpsci_ros.world.opendrive import OpenDriveMap

Read = Callable[[], object]
SMALL = {  # budgets for the test, so that the bombs are small
    "vpsci_ros.bags.mcap_file.LARGEST_CHUNK": 2**20,
    "vpsci_ros.data.parquet.MOST_TEXT": 2**20,
    "vpsci_ros.data.parquet.MOST_VALUES": 2**16,
    "vpsci_ros.documents.LONGEST": 2**16,
    "vpsci_ros.documents.LONGEST_YAML": 2**16,
    "vpsci_ros.world.opendrive.LARGEST_FILE": 2**20,
    "vpsci_ros.world.opendrive.MOST_ELEMENTS": 2**14,
}


def _pipe(name: str, read: Callable[[Path], object], folder: Path) -> Read:
    os.mkfifo(folder / name)
    return partial(read, folder / name)


def _device(folder: Path) -> Read:
    (folder / "bag.mcap").symlink_to("/dev/zero")
    return partial(bag_info, folder)


def packed(compression: CompressionType, recover: bool, folder: Path) -> Read:
    with (folder / "bag_0.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=2**23, compression=compression)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/chatter", "cdr", schema)
        for time in range(4):
            writer.add_message(channel, time, bytes(2**20), time)
        writer.finish()
    bag = Bag(folder, recover=recover)

    def read() -> list[int]:
        lengths = [len(raw.data) for raw in bag.messages()]
        assert recover, lengths
        return lengths

    return read


def _rows(folder: Path) -> Read:
    pq.write_table(pa.table({"x": np.zeros(2**20, np.int8)}), folder / "a.parquet")
    assert (folder / "a.parquet").stat().st_size < 2**16
    return partial(read_parquet, folder / "a.parquet", "numbers")


def _texts(folder: Path) -> Read:
    """One text that stands in every row: 40 MB, of which the file holds 1 KB."""
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(2**12, np.int32)), ["x" * 10_000])
    pq.write_table(pa.table({"clip": text}), folder / "a.parquet")
    assert (folder / "a.parquet").stat().st_size < 2**12
    return partial(read_parquet, folder / "a.parquet", "texts")


def _lists(folder: Path) -> Read:
    pq.write_table(pa.table({"x": [[1] * 2**18]}), folder / "a.parquet")
    return partial(read_parquet, folder / "a.parquet", "numbers")


def _map(text: str, read: Callable[[OpenDriveMap], object], folder: Path) -> Read:
    (folder / "map.xodr").write_text(text, encoding="utf-8")
    return lambda: read(OpenDriveMap(folder / "map.xodr"))


def _road(inside: str, width: float = 0.0) -> str:
    """A road that is a circle of 1 km, so that its lane joins itself."""
    text = f'<lane id="-1"><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
    return (
        '<OpenDRIVE><road id="1" length="1000"><planView><geometry s="0" x="0" y="0" hdg="0" length="1000">'
        f'<arc curvature="{2 * np.pi / 1000}"/></geometry></planView>{inside}'
        f'<lanes><laneSection s="0"><right>{text}</right></laneSection></lanes></road></OpenDRIVE>'
    )


_CORNERS = f"""<objects><object id="7" type="crosswalk" s="0" t="0" hdg="0">{'<cornerLocal u="0" v="1"/>' * 2000}
    </object></objects>"""
_LAUGHS = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(8))


def _long(folder: Path) -> Read:
    (folder / "a.yaml").write_bytes(b" " * 2**17)
    return partial(read_text, folder / "a.yaml", "YAML")


def _document(folder: Path) -> Read:
    (folder / "a.yaml").write_text("a: [" + "1," * 2**16 + "1]")
    return partial(load, folder / "a.yaml")


def _description(change: Callable[[dict], object], folder: Path) -> Read:
    """A dataset.json of the form that is read, but for one value."""
    counts = {"kept": 0, "collisions": 0, "least_curvttc": []}
    all_of_it = {"least_curvttc": [], "with_early_collisions": counts}
    whole = {"period": 0.05, "unfinished": 0, "scenarios": {}, "all": all_of_it, "filters": {"least_frames": 1}}
    whole |= {"files": {}, "versions": {"vpsci_ros": "1"}}
    (folder / DESCRIPTION).write_text(json.dumps(whole), encoding="utf-8")
    Dataset(folder)
    change(whole)
    (folder / DESCRIPTION).write_text(json.dumps(whole), encoding="utf-8")
    return partial(Dataset, folder)


BOMBS: dict[str, Callable[[Path], Read]] = {
    "a pipe as a bag": partial(_pipe, "bag.mcap", bag_info),
    "a pipe in a bag": partial(_pipe, "bag.mcap", lambda path: bag_info(path.parent)),
    "a device in a bag": _device,
    "a pipe as near misses": partial(_pipe, "a.parquet", read_near_misses),
    "a pipe as weights": partial(_pipe, "a.safetensors", load_weights),
    "a pipe as parameters": partial(_pipe, "a.yaml", load),
    "a pipe as a description": partial(_pipe, DESCRIPTION, lambda path: Dataset(path.parent)),
    "a pipe as tracks": partial(_pipe, "a.csv", lambda path: import_trajectories(path.parent, "described")),
    "a bag of lz4": partial(packed, CompressionType.LZ4, False),
    "a bag of zstd": partial(packed, CompressionType.ZSTD, False),
    "a long document": _document,
    "many equal rows": _rows,
    "a text in every row": _texts,
    "a list in a row": _lists,
    "a pipe as a map": partial(_pipe, "a.xodr", OpenDriveMap),
    "a pipe as an input": partial(_pipe, "a.bin", sha256),
    "a map of entities": partial(
        _map, f"<!DOCTYPE OpenDRIVE [<!ENTITY e0 'x'>{_LAUGHS}]><OpenDRIVE>&e8;</OpenDRIVE>", OpenDriveMap.crosswalks
    ),
    "a map of elements": partial(_map, f"<OpenDRIVE>{'<a/>' * 2**15}</OpenDRIVE>", OpenDriveMap.crosswalks),
    "a long map": partial(_map, _road(" " * 2**20), OpenDriveMap.crosswalks),
    "an outline of a circle": partial(_map, _road(_CORNERS), lambda found: found.crosswalk(7)),
    "round and round": partial(_map, _road(""), lambda found: found.route([(1, -1)] * 300)),
    "a long text": _long,
    "a period of 0": partial(_description, lambda whole: whole.update(period=0)),
    "a quartile in words": partial(_description, lambda whole: whole["all"].update(least_curvttc=["2"])),
}
