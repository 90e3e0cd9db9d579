"""The file `layout.yaml`, which describes the columns of recordings of any layout.

docs/formats.md says what each key means.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vpsci_ros.data.importers.layout import BOX, Layout
from vpsci_ros.data.importers.tracks import require_source
from vpsci_ros.documents import read_yaml, require_form, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import refuse_unknown

FILE = "layout.yaml"
_COLUMNS = ("id", "frame", "time", "class", "x", "y", *BOX, "vx", "vy", "speed", "heading", "length", "width", "lost")
_ROLES = ("vehicle", "pedestrian")


@dataclass(frozen=True)
class LayoutFile:
    """The keys of a `layout.yaml`, each with its default."""

    header: bool = True
    files: str = "*.csv"
    beside: Mapping[Any, Any] = field(default_factory=dict)
    clip: str | int = ""
    delimiter: str = ","
    columns: Mapping[str, Any] = field(default_factory=dict)
    vehicle: Mapping[str, Any] = field(default_factory=dict)
    pedestrian: Mapping[str, Any] = field(default_factory=dict)
    vehicles: Sequence[Any] = field(default_factory=list)
    pedestrians: Sequence[Any] = field(default_factory=list)
    frame_rate: float = 0.0
    time_unit: float = 1.0
    metres: float | Mapping[str, float] = 1.0
    degrees: bool = False
    compass: bool = False
    y_down: bool = False
    length: float = 4.5
    width: float = 1.8
    projection: str = ""
    fastest: float = math.inf
    source: str = ""


def read_layout_file(path: Path) -> tuple[LayoutFile, list[Layout]]:
    """Return the keys of a `layout.yaml`, and the layout of its rows, or of the vehicle and the pedestrian in each row.

    :raises InvalidInput: no such file, or a key that is missing, unknown, or not what it should be.
    """
    if not path.is_file():
        raise InvalidInput(f"{path}: no such file; expected a layout, see docs/formats.md")
    given, defaults = read_yaml(path), vars(LayoutFile())
    require_form(given, dict, str(path))
    refuse_unknown(given, defaults, str(path))
    values = defaults | given
    layouts = _layouts(values, path)
    return LayoutFile(**values), layouts


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
            f"{path}: columns: expected id, x, y (or {', '.join(BOX)}) and others of {', '.join(_COLUMNS)}, got "
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
    centre = {"x", "y"} <= columns and not set(BOX) & columns
    return "id" in columns and (centre or (set(BOX) <= columns and not {"x", "y"} & columns))
