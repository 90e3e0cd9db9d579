"""Tables of tracks with any column names: a layout gives the column and the unit of each quantity.

What differs between most published recordings is names, units, axes and classes. A `Layout` holds these; `clip_of`
takes a table by it, compares frame rate, units and headings with the motion itself, and gives tracks at 0.1 s.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.episode import directions
from vpsci_ros.data.importers.tracks import (
    BACKWARDS,
    GAPS,
    LARGEST,
    LINE,
    MAX_GAP,
    WHOLE,
    Clip,
    Floats,
    Track,
    longest_gap,
    merged,
    require_columns,
    resample,
    slope,
    spaces,
    spacing,
)
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

REVERSING = -0.1  # [m/s] slower than this is driving backwards, not the noise of a standing car
MOVING = 1.0  # [m/s] above it the direction of motion says what the heading must be
WALKING = 0.5  # [m/s] above it speeds show the frame rate and the units
RATE_TOLERANCE = 0.1  # by which way and speed may differ (median)
ASKEW = 0.5  # [rad] by which headings may differ from the motion (median)
FASTEST_PEDESTRIAN, FASTEST_VEHICLE = 12.0, 60.0  # [m/s] faster is a jump: another road user has the track's id
DRIVEN = 0.5  # [m] that a vehicle without a heading drives before its heading changes
_STANDING = 0.3  # [m/s] a vehicle that takes longer than that for `DRIVEN` has stood
BOX = ("x_min", "y_min", "x_max", "y_max")
_TICKS = 1e6  # [1/s] resolution of times that are no frame numbers


@dataclass(frozen=True)
class Layout:
    """The columns of a table of tracks, and their units.

    :ivar columns: of `id`, `frame` or `time`, `class`, `x`, `y` (or `x_min`, `y_min`, `x_max`, `y_max` of a box), and
        optionally `vx`, `vy`, `speed` (of vehicles, along their heading), `heading`, `length`, `width`: the name of the
        column.
    :ivar vehicles, pedestrians: values of `class` that count as such, in small letters; others are left out. Without a
        column `class` one of both is empty, and every track is of the other kind.
    :ivar frame_rate: frames a second, where there is `frame`.
    :ivar time_unit: seconds in one unit of `time`.
    :ivar metres: metres in one unit of positions, speeds (a second) and sizes.
    :ivar degrees: headings are in degrees.
    :ivar compass: headings are measured clockwise from north, which is up even with `y_down`.
    :ivar y_down: y points down, or to the right of x: y changes its sign, and so do headings unless `compass`.
    :ivar speeds_agree: refuse a table whose speeds disagree with its positions, as by a wrong frame rate or unit; false
        for online tracking, whose speeds may disagree.
    """

    columns: Mapping[str, str]
    vehicles: frozenset[str]
    pedestrians: frozenset[str]
    frame_rate: float = 0.0
    time_unit: float = 1.0
    metres: float = 1.0
    degrees: bool = False
    compass: bool = False
    y_down: bool = False
    speeds_agree: bool = True

    def __post_init__(self) -> None:
        for name in ("vehicles", "pedestrians"):
            object.__setattr__(self, name, frozenset(value.lower() for value in getattr(self, name)))


def clip_of(name: str, parts: Mapping[Path, tuple[pl.DataFrame, Layout]]) -> Clip:
    """Return a clip made of one or several tables, given by file.

    :raises InvalidInput: a column that is missing, a value that is no number, frames of a road user that come twice,
        or frame rate, units or headings that contradict the motion.
    """
    return merged([_clip_of(name, path, table, layout) for path, (table, layout) in parts.items()])


def _clip_of(name: str, path: Path, table: pl.DataFrame, layout: Layout) -> Clip:
    require_columns(table, layout.columns.values(), path)
    rate, left_out, assumed = _rate(layout), Counter(_other_classes(table, layout)), list[str]()

    def pieces(tracks: pl.DataFrame, names: Mapping[int, str], whose: str, fastest: float) -> Iterator[Track]:
        gap = longest_gap(tracks, rate, path)
        tracks, jumps = _without_fast_rows(tracks, rate, fastest)
        left_out[f"speeds of {whose} above {fastest:g} m/s (jumps), at which tracks are cut"] += jumps
        left_out[GAPS] += spaces(tracks, rate).filter(pl.col("seconds") > gap).height
        if gap > MAX_GAP:
            assumed.append(
                f"rows are {spacing(tracks, rate):.2g} s apart, between them motion is interpolated; "
                f"tracks are cut at gaps of more than {gap:.2g} s"
            )
        found = resample(tracks, rate, "heading", gap, fastest)
        return (replace(track, name=names.get(track.number, "")) for track in found)

    vehicles, pedestrians = list[Track](), list[Track]()
    walkers, names = _canonical(table, layout, layout.pedestrians, path)
    if walkers.height:
        pedestrians = [_pedestrian(track) for track in pieces(walkers, names, "pedestrians", FASTEST_PEDESTRIAN)]
    cars, names = _canonical(table, layout, layout.vehicles, path)
    if cars.height:
        if "heading" in cars.columns:
            _check_heading(cars, layout, path)
        forward, backwards = _forward(cars)
        left_out[BACKWARDS] += backwards
        vehicles = [_vehicle(track) for track in pieces(forward, names, "vehicles", FASTEST_VEHICLE)]
        assumed += ["headings are directions of motion"] if "heading" not in cars.columns else []
        assumed += ["sizes of vehicles are the format's"] if "length" not in cars.columns else []
        without = len({track.number for track in vehicles if track.size is None})
        if "length" in cars.columns and without:
            assumed.append(f"sizes of {without} vehicles that have none are the format's")
    if "vx" not in layout.columns:
        whose = "velocities of pedestrians" if "speed" in layout.columns else "velocities"
        assumed.append(f"{whose} are slopes of positions over 0.4 s")
    return Clip(name, vehicles, pedestrians, left_out, tuple(assumed))


def _rate(layout: Layout) -> float:
    return layout.frame_rate if "frame" in layout.columns else _TICKS


def classes_in(table: pl.DataFrame, layout: Layout) -> Counter[str]:
    """Return the number of road users of each class."""
    rows = pl.DataFrame({"class": _classes(table, layout), "id": table[layout.columns["id"]]})
    return Counter(dict(rows.group_by("class").agg(pl.col("id").n_unique()).sort("class").rows()))


def _classes(table: pl.DataFrame, layout: Layout) -> pl.Series:
    if "class" not in layout.columns:
        return pl.Series("class", [next(iter(layout.vehicles | layout.pedestrians))]).new_from_index(0, table.height)
    text = table[layout.columns["class"]].cast(pl.String).str.strip_chars()
    return text.str.replace(WHOLE, "${1}").str.to_lowercase()


def _other_classes(table: pl.DataFrame, layout: Layout) -> dict[str, int]:
    """Return the number of road users of each class that is neither a vehicle nor a pedestrian."""
    known = layout.vehicles | layout.pedestrians
    counts = classes_in(table, layout)
    return {f"road users of class {name}": count for name, count in counts.items() if name not in known}


def _canonical(
    table: pl.DataFrame, layout: Layout, kinds: frozenset[str], path: Path
) -> tuple[pl.DataFrame, dict[int, str]]:
    """Return the rows of the classes `kinds` in metres and radians, and the names of ids that are no numbers.

    The rows have id, frame, x, y, and those of vx, vy, speed, heading, length, width that the layout has. The names are
    given by the numbers in the column id.
    """
    line = table[LINE] if LINE in table.columns else pl.Series("line", np.arange(2, table.height + 2))
    mine = _classes(table, layout).is_in(list(kinds))
    rows, line = table.filter(mine), line.filter(mine)
    names = [name for name in layout.columns if name not in ("id", "class", "frame", "time")]
    if kinds == layout.pedestrians:
        names = [name for name in names if name in ("x", "y", *BOX, "vx", "vy")]
    found, own = {"id": _ids(rows, line, layout.columns["id"], path)}, rows[layout.columns["id"]]
    texts = own.cast(pl.Float64, strict=False).null_count()
    named = dict(pl.DataFrame({"id": found["id"], "name": own.cast(pl.String)}).unique().rows()) if texts else {}
    clock = layout.columns["frame" if "frame" in layout.columns else "time"]
    ticks = _numbers(rows, line, clock, path)
    if "time" in layout.columns:
        ticks = (ticks * (layout.time_unit * _TICKS)).round()
    found["frame"] = _whole(ticks, line, clock, path)
    for name in names:
        found[name] = _numbers(rows, line, layout.columns[name], path) * (1.0 if name == "heading" else layout.metres)
    if "x_min" in found:
        low_x, low_y, high_x, high_y = (found.pop(name) for name in BOX)
        found |= {"x": 0.5 * (low_x + high_x), "y": 0.5 * (low_y + high_y)}
    if "heading" in found and layout.degrees:
        found["heading"] = found["heading"].radians()
    if "heading" in found and layout.compass:
        found["heading"] = 0.5 * np.pi - found["heading"]
    if layout.y_down:
        turned = ("y", "vy") if layout.compass else ("y", "vy", "heading")
        found |= {name: -found[name] for name in turned if name in found}
    tracks = pl.DataFrame(found).with_columns(line=line).sort("id", "frame", maintain_order=True)
    twice = tracks.filter(pl.struct("id", "frame").is_duplicated())
    if twice.height:
        raise InvalidInput(f"{path}: line {twice['line'][0]}: this frame of this road user comes twice; keep one")
    tracks = tracks.drop("line")
    if "vx" in found and layout.speeds_agree:
        check_rate(tracks, _rate(layout), path)
    return tracks, named


def _ids(rows: pl.DataFrame, line: pl.Series, column: str, path: Path) -> pl.Series:
    """Return ids as whole numbers; where there are names among them, their places in alphabetical order."""
    ids = rows[column]
    if ids.null_count():
        at = line[int(ids.is_null().arg_max() or 0)]
        raise InvalidInput(f"{path}: line {at}, column {column}: expected an id, got nothing")
    numbers = ids.cast(pl.Float64, strict=False)
    if numbers.null_count():
        return ids.cast(pl.String).rank("dense").cast(pl.Int64)
    whole = ids.cast(pl.Int64, strict=False)
    return _whole(numbers, line, column, path) if whole.null_count() or ids.dtype.is_float() else whole


def _whole(numbers: pl.Series, line: pl.Series, column: str, path: Path) -> pl.Series:
    bad = (numbers != numbers.round()) | (numbers.abs() >= LARGEST)
    if bad.any():
        at = int(bad.arg_max() or 0)
        raise InvalidInput(
            f"{path}: line {line[at]}, column {column}: expected a whole number (below 2^53), got {numbers[at]:g}"
        )
    return numbers.cast(pl.Int64)


def _numbers(rows: pl.DataFrame, line: pl.Series, column: str, path: Path) -> pl.Series:
    given = rows[column]
    if given.dtype.is_temporal():
        raise InvalidInput(
            f"{path}: column {column} holds timestamps ({given.dtype}); expected numbers: write it as seconds, or in "
            "another unit with time_unit"
        )
    text = given.str.strip_chars() if given.dtype == pl.String else given
    numbers = text.cast(pl.Float64, strict=False)
    bad = ~numbers.is_finite().fill_null(False)
    if bad.any():
        row = int(bad.arg_max() or 0)
        raise InvalidInput(
            f"{path}: line {line[row]}, column {column}: expected a finite number, got {shown(given[row])}; "
            "correct the file or remove that road user's rows"
        )
    return numbers


def steps(tracks: pl.DataFrame, rate: float) -> pl.DataFrame:
    """Return the rows of road users, but the last of each, with dx, dy [m] and seconds to the next row."""
    ahead = {f"d{name}": pl.col(name).shift(-1).over("id") - pl.col(name) for name in ("x", "y")}
    seconds = (pl.col("frame").shift(-1).over("id") - pl.col("frame")) / rate
    return tracks.with_columns(**ahead, seconds=seconds).drop_nulls()


def check_rate(tracks: pl.DataFrame, rate: float, path: Path) -> None:
    """Refuse times or units that contradict the road users' speeds.

    :param tracks: id, frame, x, y [m], vx, vy [m/s].
    :param rate: frames a second.
    """
    speed = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt()
    moving = steps(tracks, rate).with_columns(speed=speed).filter(pl.col("speed") > WALKING)
    if moving.is_empty():
        return
    came = (moving["dx"] ** 2 + moving["dy"] ** 2).sqrt() / moving["seconds"]
    ratio = float(np.median((came / moving["speed"]).to_numpy()))
    if abs(ratio - 1.0) > RATE_TOLERANCE:
        raise InvalidInput(
            f"{path}: by positions and times road users move {ratio:.3g} times as fast as their speeds say (median); "
            f"frame rate ({rate:g} a second here) or units are others"
        )


def _check_heading(cars: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse headings that are not radians counter-clockwise from x, by comparing them with the motion."""
    moved = steps(cars, _rate(layout))
    way = (moved["dx"] ** 2 + moved["dy"] ** 2).sqrt()
    if "vx" in moved.columns:
        moved = moved.with_columns(speed=(pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt())
    moved = moved.filter((moved["speed"] > MOVING) & (way > 0.0) if "speed" in moved.columns else way > 0.05)
    if moved.is_empty():
        return
    direction = np.arctan2(moved["dy"].to_numpy(), moved["dx"].to_numpy())
    apart = np.abs(np.angle(np.exp(1j * (direction - moved["heading"].to_numpy()))))
    if np.median(apart) > ASKEW:
        raise InvalidInput(
            f"{path}: column {layout.columns['heading']}: headings differ from the direction of motion by "
            f"{np.median(apart):.2f} rad (median); expected {'degrees' if layout.degrees else 'radians'} "
            f"{'clockwise from north' if layout.compass else 'counter-clockwise from x'}; they may be in "
            f"{'radians' if layout.degrees else 'degrees'}, measured from another axis, or with y down"
        )


def _forward(cars: pl.DataFrame) -> tuple[pl.DataFrame, int]:
    """Return the rows in which a car does not drive backwards, and the number of the other rows."""
    if "speed" in cars.columns:
        along = pl.col("speed")
    elif {"vx", "heading"} <= set(cars.columns):
        along = pl.col("vx") * pl.col("heading").cos() + pl.col("vy") * pl.col("heading").sin()
    else:
        return cars, 0
    forward = cars.filter(along >= REVERSING)
    return forward, cars.height - forward.height


def _without_fast_rows(tracks: pl.DataFrame, rate: float, fastest: float) -> tuple[pl.DataFrame, int]:
    """Return the rows whose speed is at most `fastest` [m/s], and the number of the other rows and of jumps.

    A jump is a step between two rows of a road user that would take a higher speed than `fastest`.
    """
    if "vx" in tracks.columns:
        tracks, whole = tracks.filter((pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt() <= fastest), tracks.height
    elif "speed" in tracks.columns:
        tracks, whole = tracks.filter(pl.col("speed") <= fastest), tracks.height
    else:
        whole = tracks.height
    way = (pl.col("dx") ** 2 + pl.col("dy") ** 2).sqrt()
    jumps = steps(tracks, rate).filter(way > fastest * pl.col("seconds")).height
    return tracks, whole - tracks.height + jumps


def _velocity(own: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    return (own["vx"], own["vy"]) if "vx" in own else (slope(own["x"]), slope(own["y"]))


def _pedestrian(track: Track) -> Track:
    vx, vy = _velocity(track.values)
    return replace(track, values={"x": track.values["x"], "y": track.values["y"], "vx": vx, "vy": vy})


def _vehicle(track: Track) -> Track:
    """Return the track of a vehicle; its heading is NaN where nothing says it, see `Clip`."""
    own, size = track.values, None
    vx, vy = _velocity(own)
    heading = own["heading"] if "heading" in own else _courses(own["x"], own["y"], vx, vy)
    speed = np.maximum(own["speed"] if "speed" in own else vx * np.cos(heading) + vy * np.sin(heading), 0.0)
    if "length" in own and own["length"][0] > 0.0 and own["width"][0] > 0.0:
        size = float(np.median(own["length"])), float(np.median(own["width"]))
    values = {"x": own["x"], "y": own["y"], "heading": heading, "speed": speed}
    return replace(track, values=values, size=size)


def _courses(x: Floats, y: Floats, vx: Floats, vy: Floats) -> Floats:
    """Return directions of motion [rad], unwrapped, float64[T]; NaN where the vehicle never drives `DRIVEN`.

    Above `MOVING` the velocity says the direction, below it the last `DRIVEN` metres of the way. Until a vehicle has
    driven so far it keeps its heading, since the velocity of a standing vehicle is noise. Before its first direction it
    has this one.
    """
    anchors = _anchors(x, y)
    if len(anchors) < 2:
        return np.full(len(x), np.nan)
    begins, ends = anchors[:-1], anchors[1:]
    took = STEP * np.diff([*anchors, len(x) - 1])
    brisk = took[np.searchsorted(ends, np.arange(len(x)), side="right")] < DRIVEN / _STANDING
    direction = np.arctan2(vy, vx)
    known = (np.hypot(vx, vy) > MOVING) & brisk
    late = ~known[ends]
    chord = np.arctan2(y[ends] - y[begins], x[ends] - x[begins])
    direction[ends[late]] = chord[late]
    known[ends] = True
    return directions(direction, known)


def _anchors(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Return the first step, and each step that is at least `DRIVEN` [m] away from the place of the one before."""
    found = [0]
    ax, ay = x[0], y[0]
    for step, (px, py) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
        if math.hypot(px - ax, py - ay) >= DRIVEN:
            found.append(step)
            ax, ay = px, py
    return np.array(found, np.int64)
