"""Recordings of any other layout, whose columns a short YAML file in the same folder describes.

`layout.yaml` in the folder of recordings:

    header: false                  # no line of names: columns go by number, 1 is the first; true
    files: "*.csv"                 # CSV or Parquet, a clip each; "**/*.csv" with those of folders in the folder
    beside: {cars: people}         # in a file's name: cars_1.csv and, where there is one, people_1.csv are one clip
    clip: run                      # column by which a file is cut into clips
    delimiter: ";"                 # of CSV; ,
    columns: {id: track, frame: frame, class: kind, x: x, y: y, vx: vx, vy: vy, heading: yaw}  # length, width, time
    # instead of vx and vy: speed, of vehicles, along their heading; instead of x and y: x_min, y_min, x_max, y_max of a
    # box, whose centre counts; lost: a column that has 1 or true in rows that do not count
    # instead of class, vehicles and pedestrians, where a row holds one of each: columns that belong to one of them
    vehicle: {id: car, x: car_x, y: car_y}
    pedestrian: {id: walker, x: walker_x, y: walker_y}
    vehicles: [car, bus]           # values of the column `class`
    pedestrians: [person]
    frame_rate: 25                 # with `frame`; or time_unit: 0.001 [s], with `time`
    metres: 0.05                   # in one unit of positions, speeds, sizes; 1; by file: {"a*.csv": 0.05, b.csv: 0.04}
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
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout import Layout, classes_in, clip_of
from vpsci_ros.data.importers.tracks import (
    LINE,
    WHOLE,
    Clip,
    Importer,
    merged,
    read_csv,
    require_columns,
    require_source,
)
from vpsci_ros.data.near_misses import TURN_LIMIT
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import listed, read_yaml, reason, require_form, shown
from vpsci_ros.errors import InvalidInput, require
from vpsci_ros.parameters import refuse_unknown

FILE = "layout.yaml"
LOST = "rows that are marked as lost"  # a count of `Clip.left_out`
UNREADABLE = "road users that cannot be read"  # a count of `Clip.left_out`
BLANK = "rows without the name of a clip"  # likewise
_BOX = ("x_min", "y_min", "x_max", "y_max")
_COLUMNS = ("id", "frame", "time", "class", "x", "y", *_BOX, "vx", "vy", "speed", "heading", "length", "width", "lost")
_ROLES = ("vehicle", "pedestrian")
_MARKS = {"1": True, "true": True, "0": False, "false": False, "": False}  # of a lost row, and of others
_KEYS: dict[str, Any] = {
    "header": True,
    "files": "*.csv",
    "beside": {},
    "clip": "",
    "delimiter": ",",
    "columns": {},
    "vehicle": {},
    "pedestrian": {},
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
    """Yield the clips of the files that the layout names: one a file, or one a value of the layout's `clip` column.

    :param description: the layout's file; None: `layout.yaml` in the folder.

    :raises InvalidInput: no layout, or one with a key that is missing, unknown or wrong, or whose classes do not occur
        (of a `description`, none of them); or see `_readable`.
    """
    path = description or folder / FILE
    values = _values(path)
    layouts = _layouts(values, path)
    files = _files(folder, values, path)
    scales = _scales(folder, files, values["metres"], path)
    size, seen = (float(values["length"]), float(values["width"])), Counter[str]()
    for file in files:
        name = file.relative_to(folder).with_suffix("").as_posix()
        scaled = [replace(layout, metres=scales[file]) for layout in layouts]
        for part, table, left_out in _clips(file, values, layouts):
            parts = [_readable(f"{name}{part}", file, _rows_of(table, values, each), each) for each in scaled]
            clip = _without_heading_jumps(merged(parts)).with_size(*size).without_faster(float(values["fastest"]))
            yield replace(clip, left_out={**clip.left_out, **left_out}, source=str(values["source"]))
            seen.update(classes_in(table, layouts[0]) if len(layouts) == 1 else {})
    layout = layouts[0]
    for key, named in (("vehicles", layout.vehicles), ("pedestrians", layout.pedestrians)) * (len(layouts) == 1):
        wanted = named - seen.keys()
        if wanted == named or (wanted and description is None):
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


def _scales(folder: Path, files: list[Path], metres: float | dict[str, float], path: Path) -> dict[Path, float]:
    """Return metres in one unit of each file: one number for all, or by patterns of the files' names.

    :raises InvalidInput: a file for which there are none or several, or a pattern of no file.
    """
    if not isinstance(metres, dict):
        return dict.fromkeys(files, float(metres))
    names = {file: file.relative_to(folder).as_posix() for file in files}
    matches = {file: [pattern for pattern in metres if fnmatchcase(name, pattern)] for file, name in names.items()}
    for file, found in matches.items():
        if len(found) != 1:
            raise InvalidInput(
                f"{path}: metres: expected one pattern for file {names[file]}, got {listed(found)} of {listed(metres)}"
            )
    if unused := [pattern for pattern in metres if [pattern] not in matches.values()]:
        raise InvalidInput(f"{path}: metres: {unused[0]} names no file; there are {listed(names.values())}")
    return {file: float(metres[found[0]]) for file, found in matches.items()}


def _rows_of(table: pl.DataFrame, values: dict[str, Any], layout: Layout) -> pl.DataFrame:
    """Return the rows in which the vehicle, or the pedestrian, of a table with both in a row is there, each once."""
    role = "vehicle" if layout.vehicles else "pedestrian"
    own = [str(column) for column in values[role].values()]
    if not own or not set(layout.columns.values()) <= set(table.columns):
        return table
    there = table.filter(~pl.all_horizontal(pl.col(own).is_null()))
    return there.unique(sorted(set(layout.columns.values())), keep="first", maintain_order=True)


def _projected(table: pl.DataFrame, projection: str, layout: Layout, path: Path) -> pl.DataFrame:
    """Return a table whose longitudes and latitudes have become metres of a projection, where there is one.

    :raises InvalidInput: no such projection, or not one in metres; or the package pyproj is missing.
    """
    if not projection or not {layout.columns["x"], layout.columns["y"]} <= set(table.columns):
        return table
    names = [layout.columns["x"], layout.columns["y"]]
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


def _clips(
    file: Path, values: dict[str, Any], layouts: list[Layout]
) -> Iterator[tuple[str, pl.DataFrame, dict[str, int]]]:
    """Yield what follows the file's name in a clip's, the clip's table, and how many rows of no use precede it.

    :raises InvalidInput: the file does not have the column `clip`, or no row has a value there; or see `_not_lost`.
    """
    table = _table(file, values)
    for own, theirs in values["beside"].items():
        if (other := _beside(file, str(own), str(theirs))) is not None:
            table = pl.concat([table, _table(other, values)], how="diagonal_relaxed")
    for layout in layouts:
        table = _projected(table, values["projection"], layout, file)
    whole, left_out = table.height, Counter[str]()
    if "lost" in values["columns"]:
        table = _not_lost(table, str(values["columns"]["lost"]), file)
        left_out[LOST] = whole - table.height
    column = str(values["clip"])
    if not column:
        yield "", table, left_out
        return
    require_columns(table, [column], file)
    known = table.drop_nulls(column)
    if known.is_empty():
        raise InvalidInput(f"{file}: column {column}: expected the name of a clip in each row, got none")
    left_out[BLANK] = table.height - known.height
    for (part,), rows in sorted(known.partition_by(column, as_dict=True, maintain_order=True).items()):
        yield f"/{part}", rows, left_out
        left_out = Counter()


def _not_lost(table: pl.DataFrame, column: str, file: Path) -> pl.DataFrame:
    """Return the rows that are not marked as lost.

    :raises InvalidInput: no such column, or a value that is no mark.
    """
    require_columns(table, [column], file)
    text = table[column].cast(pl.String).str.strip_chars().str.to_lowercase().str.replace(WHOLE, "${1}").fill_null("")
    if (odd := table.filter(~text.is_in(list(_MARKS)))).height:
        raise InvalidInput(
            f"{file}: line {odd[LINE][0]}, column {column}: expected 0 or 1, true or false, got {shown(odd[column][0])}"
        )
    return table.filter(~text.replace_strict(_MARKS, return_dtype=pl.Boolean))


def _table(file: Path, values: dict[str, Any]) -> pl.DataFrame:
    header = values["header"]
    if file.suffix == ".parquet":
        table = read_parquet(file, "a table of tracks")
    else:
        table = read_csv(file, values["delimiter"], header=header)
    first = 2 if header else 1
    return table.with_columns(pl.int_range(first, first + pl.len()).alias(LINE))


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
        names = dict(zip(numbered[column], known[column].cast(pl.String), strict=True))
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
        clip = merged(clips)
        return replace(
            clip,
            vehicles=[replace(track, name=names[track.number]) for track in clip.vehicles],
            pedestrians=[replace(track, name=names[track.number]) for track in clip.pedestrians],
            left_out={UNREADABLE: bad, "rows without an id": table.height - known.height, **clip.left_out},
            assumed=(*clip.assumed, f"the first left out: {refused}"),
        )


def _without_heading_jumps(clip: Clip) -> Clip:
    good = [track for track in clip.vehicles if not (np.abs(np.diff(track.values["heading"])) >= TURN_LIMIT).any()]
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


def _layouts(values: dict[str, Any], path: Path) -> list[Layout]:
    """Return the layout, or those of the vehicle and of the pedestrian, where a row holds one of each.

    :raises InvalidInput: a value is not what its key expects.
    """
    given = {role: values[role] for role in _ROLES if values[role] != {}}
    for role, columns in given.items():
        if len(given) == 1 or not isinstance(columns, dict) or not isinstance(values["columns"], dict):
            raise InvalidInput(
                f"{path}: {role}: expected columns of a row that holds both vehicle and pedestrian, such as "
                f"{{id: car, x: car_x, y: car_y}}, and both keys, got {shown(columns)}"
            )
        if "class" in (both := values["columns"] | columns) or values["vehicles"] or values["pedestrians"]:
            raise InvalidInput(f"{path}: {role}: expected either it or class, vehicles and pedestrians")
        if "lost" in columns:
            raise InvalidInput(f"{path}: {role}: lost belongs to columns: expected one mark for the whole row")
        given[role] = both
    if not given:
        return [_layout(values, path)]
    return [_layout(values | {"columns": columns}, path, role) for role, columns in given.items()]


def _layout(values: dict[str, Any], path: Path, role: str = "") -> Layout:
    """Return the layout of a file's rows, or of the vehicle or the pedestrian (`role`) in them."""
    columns = values["columns"]
    if not isinstance(values["header"], bool):
        raise InvalidInput(f"{path}: header: expected true or false, got {shown(values['header'])}")
    if not isinstance(values["files"], str) or Path(values["files"]).is_absolute() or not values["files"]:
        raise InvalidInput(f"{path}: files: expected a pattern such as '*.csv', got {shown(values['files'])}")
    if not isinstance(columns, dict) or not set(columns) <= set(_COLUMNS) or not _has_places(set(columns)):
        raise InvalidInput(
            f"{path}: columns: expected id, x, y (or {', '.join(_BOX)}) and others of {', '.join(_COLUMNS)}, got "
            f"{shown(columns)}"
        )
    if not values["header"] and not all(type(column) is int and column > 0 for column in columns.values()):
        raise InvalidInput(
            f"{path}: columns: without a header expected numbers of columns, 1 for the first, got {shown(columns)}"
        )
    if values["projection"] and "x" not in columns:
        raise InvalidInput(f"{path}: projection: expected columns x and y, got those of a box")
    if not isinstance(values["projection"], str):
        raise InvalidInput(f"{path}: projection: expected a name such as EPSG:32632, got {shown(values['projection'])}")
    if not isinstance(values["beside"], dict) or not all(map(_is_in_a_name, sum(values["beside"].items(), ()))):
        raise InvalidInput(
            f"{path}: beside: expected parts of files' names such as {{cars: people}}, got {shown(values['beside'])}"
        )
    if not isinstance(values["clip"], str if values["header"] else (int, str)):
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
        if key == "metres" and isinstance(value, dict) and value:
            numbers = [each for each in value.values() if type(each) in (int, float) and each > 0.0]
            value = (
                min(numbers) if len(numbers) == len(value) and all(isinstance(each, str) for each in value) else value
            )
        least = 0.0 if key == "frame_rate" and "time" in columns else 1e-9
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= least:
            raise InvalidInput(f"{path}: {key}: expected a number above 0, got {shown(value)}")
    for key in ("vehicles", "pedestrians"):
        if not role and (not isinstance(values[key], list) or not values[key] or "class" not in columns):
            raise InvalidInput(
                f"{path}: {key}: expected a list of values of the column `class`, got {shown(values[key])}"
            )
    return Layout(
        columns={str(name): str(column) for name, column in columns.items() if name != "lost"},
        vehicles=frozenset(map(str, ["vehicle"] * (role == "vehicle") or values["vehicles"])),
        pedestrians=frozenset(map(str, ["pedestrian"] * (role == "pedestrian") or values["pedestrians"])),
        frame_rate=float(values["frame_rate"]),
        time_unit=float(values["time_unit"]),
        degrees=bool(values["degrees"]),
        compass=bool(values["compass"]),
        y_down=bool(values["y_down"]),
    )


def _has_places(columns: set[str]) -> bool:
    centre = {"x", "y"} <= columns and not set(_BOX) & columns
    return "id" in columns and (centre or (set(_BOX) <= columns and not {"x", "y"} & columns))


DESCRIBED = Importer(described, length=_KEYS["length"], width=_KEYS["width"])
