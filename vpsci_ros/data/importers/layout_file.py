"""The file `layout.yaml`, which describes the columns of recordings of any layout; docs/formats.md says what keys mean.

A `Layout` has the names, units, axes and classes of a table's columns, a `LayoutFile` the files and what holds for all.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.importers.tracks import alike, require_source
from vpsci_ros.data.near_misses import CYCLIST, SCOOTER, WALKER
from vpsci_ros.documents import read_yaml, require_form, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import refuse_unknown

FILE = "layout.yaml"
BOX = ("x_min", "y_min", "x_max", "y_max")
SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "ft/s": 0.3048, "cm/s": 0.01}
ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
UNITS = {"speed": SPEEDS, "angle": ANGLES, "size": LENGTHS}
HEADINGS = {  # how a heading is measured -> factor and summand [rad] that make it counter-clockwise from x
    "from x to y": (1.0, 0.0),
    "counter-clockwise from x": (1.0, 0.0),
    "clockwise from x": (-1.0, 0.0),
    "clockwise from north": (-1.0, 0.5 * math.pi),
    "counter-clockwise from north": (1.0, 0.5 * math.pi),
}
TICKS = 1e6  # [1/s] resolution of times that are no frame numbers
_OF_ROWS = ("lost", "distance")  # of a row, not of a road user
_MEASURED = ("vx", "vy", "speed", "heading", "length", "width")
_COLUMNS = ("id", "frame", "time", "class", "x", "y", *BOX, *_MEASURED, *_OF_ROWS)
_ROLES = ("vehicle", "pedestrian")
_CLASSES = ("vehicles", "pedestrians", "cyclists", "scooters")
_SAID = {  # kinds that names of classes say; "it": of rows that hold a pedestrian each
    WALKER: "pedestrian pedestrians person persons people ped peds walker adult child human it",
    CYCLIST: "bicycle bicyclist bike biker cyclist",
    SCOOTER: "e-scooter escooter scooter scooterist",
}
_RETIRED = {"degrees": "units: {angle: deg}", "compass": "heading: clockwise from north"}


@dataclass(frozen=True)
class Layout:
    """The columns of a table of tracks, and their units.

    :ivar columns: of `id`, `frame` or `time`, `class`, `x`, `y` (or `x_min`, `y_min`, `x_max`, `y_max` of a box), and
        optionally `vx`, `vy`, `speed` (along the heading), `heading`, `length`, `width`: the name of the column.
        Without `id` all rows are of one road user.
    :ivar vehicles, pedestrians: values of `class` that count as such, in small letters, numbers as `alike` writes them;
        others are left out. Without a column `class` one of both is empty, and every track is of the other kind.
    :ivar cyclists, scooters: values of `class` that count as pedestrians of these kinds.
    :ivar mixed: classes of pedestrians whose names do not say otherwise may hold cyclists, too.
    :ivar frame_rate: frames a second, where there is `frame`.
    :ivar time_unit: seconds in one unit of `time`.
    :ivar metres: metres in one unit of positions.
    :ivar speed, size: m/s and metres in one unit of speeds and sizes; 0: `metres`.
    :ivar angle: radians in one unit of headings.
    :ivar heading: a key of `HEADINGS`. "from x to y" holds in the file's axes, the others are seen from above.
    :ivar y_down: y points down, or to the right of x: y changes its sign.
    :ivar smooth: window [s] of the parabolas that smooth positions; 0: they are not smoothed.
    :ivar described: of a user's `layout.yaml`, whose keys messages name.
    :ivar speeds_agree: leave out road users whose speeds differ from their positions by a tenth; false for filtered
        speeds, which lag behind.
    """

    columns: Mapping[str, str]
    vehicles: frozenset[str]
    pedestrians: frozenset[str]
    frame_rate: float = 0.0
    time_unit: float = 1.0
    metres: float = 1.0
    speed: float = 0.0
    size: float = 0.0
    angle: float = 1.0
    heading: str = "from x to y"
    y_down: bool = False
    smooth: float = 0.0
    speeds_agree: bool = True
    cyclists: frozenset[str] = frozenset()
    scooters: frozenset[str] = frozenset()
    mixed: bool = False
    described: bool = False

    def __post_init__(self) -> None:
        for name in _CLASSES:
            values = alike(pl.Series(sorted(getattr(self, name)), dtype=pl.String)).str.to_lowercase()
            object.__setattr__(self, name, frozenset(values))

    @property
    def kinds(self) -> dict[str, str]:
        """The kind of each class of pedestrians; "" where speeds have to say it."""
        said = {name: kind for kind, names in _SAID.items() for name in self.pedestrians & {*names.split()}}
        kinds = dict.fromkeys(self.pedestrians, "" if self.mixed else WALKER) | said
        return kinds | dict.fromkeys(self.cyclists, CYCLIST) | dict.fromkeys(self.scooters, SCOOTER)

    @property
    def rate(self) -> float:
        """Frames a second; those of `TICKS` where there is no `frame`."""
        return self.frame_rate if "frame" in self.columns else TICKS

    def unit(self, name: str) -> float:
        """Return the factor that takes a column to metres or m/s; 1 for a heading."""
        if name == "heading":
            return 1.0
        given = self.size if name in ("length", "width") else self.speed if name in ("vx", "vy", "speed") else 0.0
        return given or self.metres

    def directions(self, headings: pl.Series, angle: float, heading: str) -> pl.Series:
        """Return headings in radians counter-clockwise from x; `angle` and `heading` say how they are measured."""
        times, plus = HEADINGS[heading]
        return headings * (angle * (-times if self.y_down and heading == "from x to y" else times)) + plus


@dataclass(frozen=True)
class LayoutFile:
    """What a `layout.yaml` says of its files and of all rows.

    :ivar layouts: of its rows, or of the vehicle and of the pedestrian in each row.
    :ivar lost, distance: columns of the whole row; "": none.
    """

    layouts: tuple[Layout, ...]
    header: bool
    files: str
    clip: str
    delimiter: str
    lost: str
    distance: str
    length: float
    width: float
    fixed: bool
    source: str


def _number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value >= 1e-9


def _truth(value: object) -> bool:
    return isinstance(value, bool)


_LIST = "a list of values of the column `class`"
_COLUMNS_OF = "names of columns such as {id: track, x: x}"
KEYS: dict[str, tuple[Any, Callable[[Any], bool], str]] = {  # key -> default, check, what is expected
    "header": (True, _truth, "true or false"),
    "files": (
        "*.csv",
        lambda value: isinstance(value, str) and value[:1] not in ("", "/"),
        "a pattern such as '*.csv'",
    ),
    "clip": ("", lambda value: isinstance(value, (str, int)) and not _truth(value), "the name of a column"),
    "delimiter": (",", lambda value: isinstance(value, str) and len(value.encode()) == 1, "one character such as ';'"),
    **{key: ({}, lambda value: isinstance(value, dict), _COLUMNS_OF) for key in ("columns", *_ROLES)},
    **{key: ([], lambda value: isinstance(value, list), _LIST) for key in _CLASSES},
    "frame_rate": (0.0, lambda value: value == 0.0 or _number(value), "a number above 0"),
    "time_unit": (1.0, _number, "a number above 0"),
    "metres": (1.0, _number, "a number above 0"),
    "units": (
        {},
        lambda value: isinstance(value, dict) and all(k in UNITS and str(v) in UNITS[k] for k, v in value.items()),
        "; ".join(f"{name}: {', '.join(units)}" for name, units in UNITS.items()),
    ),
    "heading": ("from x to y", lambda value: str(value) in HEADINGS, ", ".join(HEADINGS)),
    "y_down": (False, _truth, "true or false"),
    "smooth": (0.0, lambda value: value == 0.0 or _number(value), "a window in seconds"),
    "length": (4.5, _number, "a number above 0"),
    "width": (1.8, _number, "a number above 0"),
    "fixed": (False, _truth, "true or false"),
    "source": ("", lambda value: True, "a name"),
}
LENGTH, WIDTH = (float(KEYS[name][0]) for name in ("length", "width"))


def read_layout_file(path: Path) -> LayoutFile:
    """Return what a `layout.yaml` says.

    :raises InvalidInput: no such file, or a key that is missing, unknown, or not what it should be.
    """
    if not path.is_file():
        raise InvalidInput(f"{path}: no such file; expected a layout, see docs/formats.md")
    given = read_yaml(path)
    require_form(given, dict, str(path))
    for key in _RETIRED.keys() & given.keys():
        raise InvalidInput(f"{path}: {key}: is written as `{_RETIRED[key]}`")
    refuse_unknown(given, KEYS, str(path))
    values = {key: given.get(key, default) for key, (default, _, _) in KEYS.items()}
    for key, (_, is_right, expected) in KEYS.items():
        if not is_right(values[key]):
            raise InvalidInput(f"{path}: {key}: expected {expected}, got {shown(values[key])}")
    if values["source"] != "":
        require_source(values["source"], f"{path}: source:")
    own: dict[str, Any] = {name: str(values["columns"].get(name, "")) for name in _OF_ROWS}
    own |= {name: values[name] for name in ("header", "files", "delimiter", "length", "width", "fixed", "source")}
    return LayoutFile(layouts=tuple(_layouts(values, path)), clip=str(values["clip"]), **own)


def _layouts(values: dict[str, Any], path: Path) -> list[Layout]:
    """Return the layout, or those of the vehicle and of the pedestrian, where a row holds one of each.

    :raises InvalidInput: a value is not what its key expects.
    """
    given = {role: values[role] for role in _ROLES if values[role]}
    if not given:
        if "distance" in values["columns"]:
            raise InvalidInput(f"{path}: columns: distance: expected rows that hold both a vehicle and a pedestrian")
        for key in ("vehicles", "pedestrians"):
            if not values[key] or "class" not in values["columns"]:
                raise InvalidInput(f"{path}: {key}: expected {_LIST}, got {shown(values[key])}")
        classes = {key: frozenset(map(str, values[key])) for key in _CLASSES}
        return [_layout(values, "columns", values["columns"], path, classes)]
    if len(given) == 1:
        role = next(iter(given))
        raise InvalidInput(
            f"{path}: {role}: expected columns of a row that holds both vehicle and pedestrian, such as {{x: car_x, y: "
            f"car_y}}, and both keys, got {shown(given[role])}"
        )
    both = {role: values["columns"] | columns for role, columns in given.items()}
    for role, columns in both.items():
        if "class" in columns or values["vehicles"] or values["pedestrians"]:
            raise InvalidInput(f"{path}: {role}: expected either it or class, vehicles and pedestrians")
        if own := set(_OF_ROWS) & set(given[role]):
            raise InvalidInput(f"{path}: {role}: {min(own)} belongs to columns: expected one for the whole row")
    none = dict.fromkeys(_CLASSES, frozenset[str]())
    return [_layout(values, role, own, path, none | {f"{role}s": frozenset({"it"})}) for role, own in both.items()]


def _layout(
    values: dict[str, Any], key: str, columns: dict[str, Any], path: Path, classes: dict[str, frozenset[str]]
) -> Layout:
    """Return the layout of a file's rows, or of one role in them; `key` is where its columns stand."""
    where, names = f"{path}: {key}:", set(columns)
    if unknown := sorted(map(str, names - set(_COLUMNS))):
        raise InvalidInput(f"{where} {', '.join(unknown)}: unknown; expected {', '.join(_COLUMNS)}")
    box = set(BOX) & names
    wanted = {*BOX} if box else {"x", "y"}
    wanted |= {"id"} if key == "columns" else set()
    for one, other in (("vx", "vy"), ("length", "width")):
        wanted |= {one, other} if {one, other} & names else set()
    if missing := [name for name in _COLUMNS if name in wanted - names]:
        instead = "" if box or {"x", "y"} & names else f" (or {', '.join(BOX)} of a box)"
        raise InvalidInput(f"{where} {', '.join(missing)} missing{instead}; it has {', '.join(map(str, columns))}")
    if box and {"x", "y"} & names:
        raise InvalidInput(f"{where} expected either x and y or {', '.join(BOX)}")
    if {"speed", "vx"} <= names:
        raise InvalidInput(f"{where} expected either speed or vx and vy")
    if ("frame" in names) == ("time" in names):
        raise InvalidInput(f"{where} expected either frame or time")
    if "frame" in names and not values["frame_rate"]:
        raise InvalidInput(f"{path}: frame_rate: expected a number above 0 for the column frame, got none")
    if not values["header"] and not all(type(column) is int and column > 0 for column in columns.values()):
        raise InvalidInput(
            f"{where} without a header expected numbers of columns, 1 for the first, got {shown(columns)}"
        )
    own: dict[str, Any] = {name: float(values[name]) for name in ("frame_rate", "time_unit", "metres", "smooth")}
    own |= {name: UNITS[name][unit] for name, unit in values["units"].items()} | classes
    own["mixed"] = not (classes["cyclists"] or classes["scooters"])
    return Layout(
        columns={str(name): str(column) for name, column in columns.items() if name not in _OF_ROWS},
        **own,
        heading=values["heading"],
        y_down=values["y_down"],
    )
