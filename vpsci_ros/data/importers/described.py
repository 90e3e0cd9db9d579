"""Recordings of any other layout: a short YAML beside the files says what their columns are.

`layout.yaml` in the folder of recordings:

    files: "*.csv"                 # CSV or Parquet, a clip each; "**/*.csv" with those of folders in the folder
    beside: {cars: people}         # in a file's name: cars_1.csv and, where there is one, people_1.csv are one clip
    clip: run                      # column by which a file is cut into clips
    delimiter: ";"                 # of CSV; ,
    columns: {id: track, frame: frame, class: kind, x: x, y: y, vx: vx, vy: vy, heading: yaw}  # length, width, time
    # instead of vx and vy: speed, of vehicles, along their heading
    vehicles: [car, bus]           # values of the column `class`
    pedestrians: [person]
    frame_rate: 25                 # with `frame`; or time_unit: 0.001 [s], with `time`
    metres: 0.05                   # in one unit of positions, speeds and sizes; 1
    degrees: true                  # headings; false
    compass: true                  # headings clockwise from north; false
    y_down: true                   # false
    length: 4.5                    # [m] of vehicles whose tracks do not say
    width: 1.8
    projection: EPSG:32632         # x and y are longitude and latitude: project them to these metres (extra `geo`)
    fastest: 2.5                   # [m/s] pedestrians with a higher median speed are left out
    source: my_corner              # name of the source
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout import Layout, classes_in, clip_of, read_csv
from vpsci_ros.data.importers.tracks import Clip, Importer, require_columns, require_source
from vpsci_ros.data.near_misses import TURN_LIMIT
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import listed, read_yaml, reason, require_form, shown
from vpsci_ros.errors import InvalidInput, require
from vpsci_ros.parameters import refuse_unknown

FILE = "layout.yaml"
UNREADABLE = "road users that cannot be read"  # a count of `Clip.left_out`
BLANK = "rows without the name of a clip"  # likewise
_COLUMNS = ("id", "frame", "time", "class", "x", "y", "vx", "vy", "speed", "heading", "length", "width")
_KEYS: dict[str, Any] = {
    "files": "*.csv",
    "beside": {},
    "clip": "",
    "delimiter": ",",
    "columns": {},
    "vehicles": [],
    "pedestrians": [],
    "frame_rate": 0.0,
    "time_unit": 1.0,
    "metres": 1.0,
    "degrees": False,
    "compass": False,
    "y_down": False,
    "length": 4.5,
    "width": 1.8,
    "projection": "",
    "fastest": math.inf,
    "source": "",
}


def described(folder: Path, description: Path | None = None) -> Iterator[Clip]:
    """Yield a clip for each file that the layout names.

    :param description: the layout's file; None: `layout.yaml` in the folder.

    :raises InvalidInput: no layout, or one with a key that is missing, unknown or wrong, or whose classes do not occur;
        or see `_readable`.
    """
    path = description or folder / FILE
    values = _values(path)
    layout = _layout(values, path)
    files = _files(folder, values, path)
    size, seen = (float(values["length"]), float(values["width"])), Counter[str]()
    for file in files:
        name = file.relative_to(folder).with_suffix("").as_posix()
        for part, table, blank in _clips(file, values, layout):
            clip = _without_jumps(_readable(f"{name}{part}", file, table, layout)).with_size(*size)
            clip = clip.without_faster(float(values["fastest"]))
            yield replace(clip, left_out={**clip.left_out, BLANK: blank})
            seen.update(classes_in(table, layout))
    for key, wanted in (("vehicles", layout.vehicles), ("pedestrians", layout.pedestrians)):
        if not wanted & seen.keys():
            counted = ", ".join(f"{name!r} ({count} road users)" for name, count in sorted(seen.items()))
            raise InvalidInput(
                f"{path}: {key}: none of {', '.join(sorted(wanted))} occurs in column {layout.columns['class']}, which "
                f"has {counted}"
            )


def _files(folder: Path, values: dict[str, Any], path: Path) -> list[Path]:
    """Return the files that a layout names, sorted.

    :raises InvalidInput: it names none, or `beside` none of the files that may be beside them.
    """
    pattern, unusable = values["files"], ""
    try:
        files = sorted(file for file in folder.glob(pattern) if file.is_file() and file.resolve() != path.resolve())
    except (ValueError, IndexError, NotImplementedError) as error:
        files, unusable = [], f" ({reason(error)})"
    if unusable or ".." in Path(pattern).parts:
        raise InvalidInput(
            f"{path}: files: expected a pattern for files in the folder, such as '*.csv' or '**/*.csv', got "
            f"{shown(pattern)}{unusable}"
        )
    if not files:
        raise InvalidInput(f"{folder}: expected files {pattern}, as {path.name} says; found none")
    for own, theirs in values["beside"].items():
        if not any(_beside(file, str(own), str(theirs)) for file in files):
            raise InvalidInput(
                f"{path}: beside: no file with {own} in its name has one with {theirs} there beside it; found "
                f"{listed(file.name for file in files)}"
            )
    return files


def _beside(file: Path, own: str, theirs: str) -> Path | None:
    """Return the file whose name has `theirs` where that of `file` has `own`; None: there is none."""
    other = file.with_name(file.name.replace(own, theirs))
    return other if other != file and other.is_file() else None


def _projected(table: pl.DataFrame, projection: str, layout: Layout, path: Path) -> pl.DataFrame:
    """Return a table whose longitudes and latitudes have become metres of a projection, where there is one.

    :raises InvalidInput: no such projection, or not one in metres; or the package pyproj is missing.
    """
    names = [layout.columns["x"], layout.columns["y"]]
    if not projection or not set(names) <= set(table.columns):
        return table
    require("pyproj")
    import pyproj

    try:
        system = pyproj.CRS(projection)
        if {axis.unit_name for axis in system.axis_info} != {"metre"}:
            raise InvalidInput(
                f"{path}: projection: expected one in metres such as EPSG:32632, got {shown(projection)}"
            )
        to_metres = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise InvalidInput(f"{path}: projection: {reason(error)}; expected one such as EPSG:32632") from None
    degrees = [table[name].cast(pl.Float64, strict=False).to_numpy() for name in names]
    return table.with_columns(**dict(zip(names, to_metres.transform(*degrees), strict=True)))


def _clips(file: Path, values: dict[str, Any], layout: Layout) -> Iterator[tuple[str, pl.DataFrame, int]]:
    """Yield what follows the file's name in a clip's, the clip's table, and how many rows of no clip precede it.

    :raises InvalidInput: the file does not have the column `clip`, or no row has a value there.
    """
    table = _table(file, values["delimiter"])
    for own, theirs in values["beside"].items():
        if (other := _beside(file, str(own), str(theirs))) is not None:
            table = pl.concat([table, _table(other, values["delimiter"])], how="diagonal_relaxed")
    table = _projected(table, values["projection"], layout, file)
    column = values["clip"]
    if not column:
        yield "", table, 0
        return
    require_columns(table, [column], file)
    known = table.drop_nulls(column)
    if known.is_empty():
        raise InvalidInput(f"{file}: column {column}: expected the name of a clip in each row, got none")
    blank = table.height - known.height
    for (part,), rows in sorted(known.partition_by(column, as_dict=True, maintain_order=True).items()):
        yield f"/{part}", rows, blank
        blank = 0


def _table(file: Path, delimiter: str) -> pl.DataFrame:
    if file.suffix != ".parquet":
        return read_csv(file, delimiter)
    try:
        return read_parquet(file, "a table of tracks")
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInput(f"{file}: not readable as Parquet: {error}; take the file as published") from error


def _readable(name: str, path: Path, table: pl.DataFrame, layout: Layout) -> Clip:
    """Return the clip of a table without the road users that cannot be read.

    They have to be fewer than half, and neither all vehicles nor all pedestrians.

    :raises InvalidInput: see `clip_of`.
    """
    try:
        return clip_of(name, {path: (table, layout)})
    except InvalidInput as refused:
        column = layout.columns["id"]
        if column not in table.columns:
            raise
        known = table.drop_nulls(column)
        numbered = known.with_columns(known[column].cast(pl.String).rank("dense").cast(pl.Int64).alias(column))
        clips, bad, classes = [], 0, set[str]()
        for track in numbered.partition_by(column, maintain_order=True):
            try:
                clips.append(clip_of(name, {path: (track, layout)}))
            except InvalidInput:
                bad += 1
                classes |= classes_in(track, layout).keys()
        no_vehicle = classes & layout.vehicles and not any(clip.vehicles for clip in clips)
        no_pedestrian = classes & layout.pedestrians and not any(clip.pedestrians for clip in clips)
        if bad >= len(clips) or no_vehicle or no_pedestrian:
            raise
        left_out = Counter({UNREADABLE: bad, "rows without an id": table.height - known.height})
        for clip in clips:
            left_out.update(clip.left_out)
        return Clip(
            name,
            [track for clip in clips for track in clip.vehicles],
            [track for clip in clips for track in clip.pedestrians],
            left_out,
            (*dict.fromkeys(text for clip in clips for text in clip.assumed), f"the first left out: {refused}"),
        )


def _without_jumps(clip: Clip) -> Clip:
    good = [track for track in clip.vehicles if np.abs(np.diff(track.values["heading"])).max(initial=0.0) < TURN_LIMIT]
    left_out = {**clip.left_out, "vehicles whose heading jumps": len(clip.vehicles) - len(good)}
    return replace(clip, vehicles=good, left_out=left_out)


def _values(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InvalidInput(f"{path}: no such file; expected a layout, see vpsci_ros/data/importers/described.py")
    values = read_yaml(path)
    require_form(values, dict, str(path))
    refuse_unknown(values, _KEYS, str(path))
    return _KEYS | values


def _is_in_a_name(part: object) -> bool:
    return isinstance(part, (str, int)) and bool(text := str(part)) and not {"/", "\0"} & set(text)


def _layout(values: dict[str, Any], path: Path) -> Layout:
    columns = values["columns"]
    if not isinstance(values["files"], str) or Path(values["files"]).is_absolute() or not values["files"]:
        raise InvalidInput(f"{path}: files: expected a pattern such as '*.csv', got {shown(values['files'])}")
    if not isinstance(columns, dict) or not set(columns) <= set(_COLUMNS) or not {"id", "x", "y"} <= set(columns):
        raise InvalidInput(
            f"{path}: columns: expected id, x, y and others of {', '.join(_COLUMNS)}, got {shown(columns)}"
        )
    if not isinstance(values["projection"], str):
        raise InvalidInput(f"{path}: projection: expected a name such as EPSG:32632, got {shown(values['projection'])}")
    if not isinstance(values["beside"], dict) or not all(map(_is_in_a_name, sum(values["beside"].items(), ()))):
        raise InvalidInput(
            f"{path}: beside: expected parts of files' names such as {{cars: people}}, got {shown(values['beside'])}"
        )
    if not isinstance(values["clip"], str):
        raise InvalidInput(f"{path}: clip: expected the name of a column, got {shown(values['clip'])}")
    delimiter = values["delimiter"]
    if not isinstance(delimiter, str) or len(delimiter.encode()) != 1:
        raise InvalidInput(f"{path}: delimiter: expected one character such as ';', got {shown(delimiter)}")
    if {"speed", "vx"} <= set(columns):
        raise InvalidInput(f"{path}: columns: expected either speed or vx and vy")
    pairs = [("vx", "vy"), ("length", "width")]
    for one, other in pairs:
        if (one in columns) != (other in columns):
            raise InvalidInput(f"{path}: columns: expected both {one} and {other}, or none of them")
    if ("frame" in columns) == ("time" in columns):
        raise InvalidInput(f"{path}: columns: expected either frame or time")
    if values["source"] != "":
        require_source(values["source"], f"{path}: source:")
    for key in ("frame_rate", "time_unit", "metres", "length", "width", "fastest"):
        value = values[key]
        least = 0.0 if key == "frame_rate" and "time" in columns else 1e-9
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= least:
            raise InvalidInput(f"{path}: {key}: expected a number above 0, got {shown(value)}")
    for key in ("vehicles", "pedestrians"):
        if not isinstance(values[key], list) or not values[key] or "class" not in columns:
            raise InvalidInput(
                f"{path}: {key}: expected a list of values of the column `class`, got {shown(values[key])}"
            )
    return Layout(
        columns={str(name): str(column) for name, column in columns.items()},
        vehicles=frozenset(map(str, values["vehicles"])),
        pedestrians=frozenset(map(str, values["pedestrians"])),
        frame_rate=float(values["frame_rate"]),
        time_unit=float(values["time_unit"]),
        metres=float(values["metres"]),
        degrees=bool(values["degrees"]),
        compass=bool(values["compass"]),
        y_down=bool(values["y_down"]),
    )


def _source(folder: Path) -> str:
    values = _values(folder / FILE)
    _layout(values, folder / FILE)
    return str(values["source"])


DESCRIBED = Importer(described, length=4.5, width=1.8, source=_source)
