"""Tables of tracks with any column names: a layout gives the column and the unit of each quantity.

`clip_of` takes a table by its `Layout`, compares every speed, velocity and heading with the positions, and gives tracks
at 0.1 s.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.episode import directions
from vpsci_ros.data.importers.agreement import require_headings, require_sizes, require_speeds, steps
from vpsci_ros.data.importers.layout_file import BOX, TICKS, Layout
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
from vpsci_ros.data.near_misses import TURN_LIMIT
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

UNREADABLE = "road users that cannot be read"  # a count of `Clip.left_out`
NAMELESS = "rows without an id"  # a count of `Clip.left_out`
TURNS = (
    "jumps of a vehicle's heading, such as those of reversing, at which tracks are cut"  # a count of `Clip.left_out`
)
REVERSING = -0.1  # [m/s] slower than this is driving backwards, not the noise of a standing car
REVERSAL = 2.0  # [rad] between two directions of motion, one of which is backwards
MOVING = 1.0  # [m/s] above it the direction of motion says what the heading must be
FASTEST_PEDESTRIAN, FASTEST_VEHICLE = 12.0, 60.0  # [m/s] faster is a jump: another road user has the track's id
DRIVEN = 0.5  # [m] that a vehicle without a heading drives before its heading changes
_STANDING = 0.3  # [m/s] a vehicle that takes longer than that for `DRIVEN` has stood
_FEW = 100  # rows, of which each may be a road user of its own
_DATE = r"^\d{4}-\d\d?-\d\d?|^\d\d?:\d\d"  # how a date or a time of day begins


def clip_of(name: str, parts: Mapping[Path, tuple[pl.DataFrame, Layout]], *, lenient: bool = False) -> Clip:
    """Return a clip made of one or several tables, given by file.

    :param lenient: leave out, and count, road users with a value that is no number or a frame that comes twice, if
        they are fewer than half, and neither all vehicles nor all pedestrians.
    :raises InvalidInput: a column that is missing, a value that is no number, frames of a road user that come twice,
        or frame rate, units or headings that contradict the motion.
    """
    return merged([_clip_of(name, path, table, layout, lenient) for path, (table, layout) in parts.items()])


def _clip_of(name: str, path: Path, table: pl.DataFrame, layout: Layout, lenient: bool) -> Clip:
    require_columns(table, layout.columns.values(), path)
    rate, left_out, assumed = layout.rate, Counter(_other_classes(table, layout)), list[str]()
    _require_tracks(table, layout, path)
    if lenient and "id" in layout.columns and (known := table.drop_nulls(layout.columns["id"])).height:
        left_out[NAMELESS] += table.height - known.height
        table = known

    def pieces(tracks: pl.DataFrame, names: Mapping[int, str], whose: str, fastest: float) -> Iterator[Track]:
        gap = longest_gap(tracks, rate, path)
        tracks, jumps = _without_fast_rows(tracks, rate, fastest)
        if 2 * jumps > tracks.height:
            raise InvalidInput(
                f"{path}: {jumps:,} of {tracks.height:,} rows of {whose} are faster than {fastest:g} m/s; the unit of "
                "positions or times is another (metres, time_unit, frame_rate), or they are relative to a moving sensor"
            )
        left_out[f"speeds of {whose} above {fastest:g} m/s (jumps), at which tracks are cut"] += jumps
        left_out[GAPS] += spaces(tracks, rate).filter(pl.col("seconds") > gap).height
        if gap > MAX_GAP:
            assumed.append(
                f"rows are {spacing(tracks, rate):.2g} s apart, between them motion is interpolated; "
                f"tracks are cut at gaps of more than {gap:.2g} s"
            )
        for track in resample(tracks, rate, "heading", gap, fastest):
            yield replace(smoothed(track, layout.smooth), name=names.get(track.number, ""))

    vehicles, pedestrians = list[Track](), list[Track]()
    walkers, names, lost_walkers = _canonical(table, layout, layout.pedestrians, path, lenient)
    cars, car_names, lost_cars = _canonical(table, layout, layout.vehicles, path, lenient)
    if lost := [*lost_walkers.values(), *lost_cars.values()]:
        left = [part["id"].n_unique() for part in (walkers, cars)]
        if len(lost) >= sum(left) or (lost_walkers and not left[0]) or (lost_cars and not left[1]):
            raise InvalidInput(lost[0])
        left_out[UNREADABLE] += len(lost)
        assumed.append(f"the first left out: {lost[0]}")
    if walkers.height:
        pedestrians = [_pedestrian(track) for track in pieces(walkers, names, "pedestrians", FASTEST_PEDESTRIAN)]
        if "vx" not in walkers.columns:
            assumed.append("velocities of pedestrians are slopes of positions over 0.4 s")
    if cars.height:
        forward, left_out[BACKWARDS] = _forward(cars)
        for track in pieces(forward, car_names, "vehicles", FASTEST_VEHICLE):
            vehicles += _cut_at_turns(_vehicle(track), left_out, reverses="heading" not in cars.columns)
        if not {"vx", "speed"} & set(cars.columns):
            assumed.append("velocities of vehicles are slopes of positions over 0.4 s")
        assumed += ["headings are directions of motion"] if "heading" not in cars.columns else []
        assumed += ["sizes of vehicles are the format's"] if "length" not in cars.columns else []
        without = len({track.number for track in vehicles if track.size is None})
        if "length" in cars.columns and without:
            assumed.append(f"sizes of {without} vehicles that have none are the format's")
    return Clip(name, vehicles, pedestrians, left_out, tuple(assumed))


def _require_tracks(table: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse a table in which most road users have a single row."""
    if "id" not in layout.columns or table.height < _FEW:
        return
    column = layout.columns["id"]
    if 2 * (count := table[column].n_unique()) > table.height:
        raise InvalidInput(
            f"{path}: column {column} has {count:,} ids in {table.height:,} rows, so most road users have one row; "
            "expected an id that a road user has in every frame"
        )


def classes_in(table: pl.DataFrame, layout: Layout) -> Counter[str]:
    """Return the number of road users of each class."""
    rows = pl.DataFrame({"class": _classes(table, layout), "id": _names(table, layout)})
    return Counter(dict(rows.group_by("class").agg(pl.col("id").n_unique()).sort("class").rows()))


def _names(table: pl.DataFrame, layout: Layout) -> pl.Series:
    """Return the ids of a table's rows as they are there; 1 without a column of them."""
    return table[layout.columns["id"]] if "id" in layout.columns else pl.repeat(1, table.height, eager=True)


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


class _Rows:
    """Columns of some rows of a file as numbers, and the rows that are not readable.

    :ivar bad: bool[n], rows with a value that is not readable; faults: row -> the first fault, in words.
    """

    def __init__(self, rows: pl.DataFrame, path: Path) -> None:
        self.path = path
        self.line = rows[LINE]
        self.table, self.bad = rows, pl.repeat(False, rows.height, dtype=pl.Boolean, eager=True)
        self.faults: dict[int, str] = {}

    def mark(self, bad: pl.Series, text: Callable[[int], str]) -> None:
        """Mark rows; `text` says what is wrong with the row of a number."""
        if bad.any():
            row = int(bad.arg_max() or 0)
            self.faults.setdefault(row, f"{self.path}: line {self.line[row]}{text(row)}")
            self.bad = self.bad | bad

    def numbers(self, column: str) -> pl.Series:
        """Return a column as finite numbers; rows with anything else are marked and have 0."""
        given = self.table[column]
        if given.dtype.is_temporal():
            raise InvalidInput(
                f"{self.path}: column {column} holds timestamps ({given.dtype}); expected numbers: write it as "
                "seconds, or in another unit with time_unit"
            )
        text = given.str.strip_chars() if given.dtype == pl.String else given
        numbers = text.cast(pl.Float64, strict=False)
        bad = ~numbers.is_finite().fill_null(False)
        if bad.any() and given.dtype == pl.String and bool(text.filter(bad).str.contains(_DATE).fill_null(False).all()):
            raise InvalidInput(
                f"{self.path}: column {column} holds dates or times of day, such as {shown(given.filter(bad)[0])}; "
                "expected numbers: write seconds since any instant"
            )
        self.mark(
            bad,
            lambda row: (
                f", column {column}: expected a finite number, got {shown(given[row])}; correct the file or "
                "remove that road user's rows"
            ),
        )
        return numbers.set(bad, 0.0)

    def whole(self, values: pl.Series, column: str) -> pl.Series:
        """Return whole numbers as Int64; rows with others are marked."""
        bad = (values != values.round()) | (values.abs() >= LARGEST)
        self.mark(bad, lambda row: f", column {column}: expected a whole number (below 2^53), got {values[row]}")
        return values.set(bad, 0.0).cast(pl.Int64)


def _canonical(
    table: pl.DataFrame, layout: Layout, kinds: frozenset[str], path: Path, lenient: bool
) -> tuple[pl.DataFrame, dict[int, str], dict[int, str]]:
    """Return the rows of the classes `kinds` in metres and radians, the names of ids, and what is unreadable of which.

    The rows have id, frame, x, y, and those of vx, vy, speed, heading, length, width that the layout has. The names are
    given by the numbers in the column id; they are there where an id is no number.
    """
    if LINE not in table.columns:
        table = table.with_columns(pl.int_range(2, 2 + pl.len()).alias(LINE))
    table = table.filter(_classes(table, layout).is_in(list(kinds)))
    rows, walk = _Rows(table, path), kinds == layout.pedestrians
    names = [name for name in layout.columns if name not in ("id", "class", "frame", "time")]
    if walk:
        names = [name for name in names if name in ("x", "y", *BOX, "vx", "vy")]
    ids, named = _ids(rows, layout)
    clock = layout.columns["frame" if "frame" in layout.columns else "time"]
    ticks = rows.numbers(clock)
    if "time" in layout.columns:
        ticks = (ticks * (layout.time_unit * TICKS)).round()
    found = {"id": ids, "frame": rows.whole(ticks, clock)}
    for name in names:
        found[name] = rows.numbers(layout.columns[name]) * layout.unit(name)
    if "x_min" in found:
        low_x, low_y, high_x, high_y = (found.pop(name) for name in BOX)
        found |= {"x": 0.5 * (low_x + high_x), "y": 0.5 * (low_y + high_y)}
    if layout.y_down:
        found |= {name: -found[name] for name in ("y", "vy") if name in found}
    tracks = pl.DataFrame(found).with_columns(row=pl.int_range(pl.len()), bad=rows.bad)
    tracks = tracks.sort("id", "frame", maintain_order=True)
    twice = tracks.select("row", twice=(pl.struct("id", "frame").is_duplicated() & ~pl.col("bad"))).sort("row")["twice"]
    rows.mark(twice, lambda row: ": this frame of this road user comes twice; keep one")
    if rows.faults and not lenient:
        raise InvalidInput(next(iter(rows.faults.values())))
    lost = {int(number): min(rows.faults.items())[1] for number in ids.filter(rows.bad).unique()}
    tracks = tracks.filter(~pl.col("id").is_in(list(lost))).drop("row", "bad")
    if walk and "speed" in layout.columns and layout.speeds_agree:
        said = table[layout.columns["speed"]].cast(pl.Float64, strict=False) * layout.unit("speed")
        speeds = pl.DataFrame({"id": ids, "frame": found["frame"], "speed": said}).unique(["id", "frame"])
        require_speeds(tracks.join(speeds, ["id", "frame"], "left", maintain_order="left"), layout, path)
    elif layout.speeds_agree:
        require_speeds(tracks, layout, path)
    if "heading" in found:
        require_headings(tracks, layout, path)
        tracks = tracks.with_columns(layout.directions(tracks["heading"], layout.angle, layout.heading))
    if "length" in found:
        require_sizes(tracks, layout, path)
    return tracks, named, lost


def _ids(rows: _Rows, layout: Layout) -> tuple[pl.Series, dict[int, str]]:
    """Return ids as whole numbers, and the names of those that are none: their places in alphabetical order."""
    ids = _names(rows.table, layout)
    column = layout.columns.get("id", "")
    rows.mark(ids.is_null(), lambda row: f", column {column}: expected an id, got nothing")
    numbers = ids.cast(pl.Float64, strict=False)
    if numbers.null_count() > ids.null_count():
        places = ids.cast(pl.String).rank("dense").cast(pl.Int64).fill_null(0)
        return places, dict(zip(places, ids.cast(pl.String).fill_null(""), strict=True))
    whole = ids.cast(pl.Int64, strict=False)
    exact = whole.null_count() > ids.null_count() or ids.dtype.is_float()
    return rows.whole(numbers.fill_null(0.0), column) if exact else whole.fill_null(0), {}


def smoothed(track: Track, window: float) -> Track:
    """Return a track whose positions lie on parabolas fitted to `window` seconds around each; 0: the track itself."""
    if not window:
        return track
    from scipy.signal import savgol_filter  # slow to import, and rarely needed

    count = len(track.values["x"])
    width = min(2 * round(0.5 * window / STEP) + 1, count - 1 + count % 2)
    if width < 5:
        return track
    fitted = {name: savgol_filter(track.values[name], width, 2) for name in ("x", "y")}
    return replace(track, values=track.values | fitted)


def _cut_at_turns(track: Track, left_out: Counter[str], *, reverses: bool) -> Iterator[Track]:
    """Yield the pieces of a vehicle's track between jumps of its heading, and count these.

    :param reverses: headings are directions of motion, so that a turn on the spot is a change to reverse gear or back.
        Of the two directions the car drives forward in the one in which it goes further; the rest is left out.
    """
    heading, x, y = (track.values[name] for name in ("heading", "x", "y"))
    jumps = np.abs(np.diff(heading))
    cuts = np.flatnonzero(jumps >= TURN_LIMIT) + 1
    left_out[TURNS] += len(cuts)
    pieces = np.split(np.arange(len(heading)), cuts)
    turned = np.concatenate([[0], np.cumsum((jumps[cuts - 1] >= REVERSAL) & reverses)]) % 2
    ways = [np.hypot(np.diff(x[piece]), np.diff(y[piece])).sum() for piece in pieces]
    backwards = np.bincount(turned, ways, 2).argmin() if turned.any() else -1
    for piece, side in zip(pieces, turned, strict=True):
        own = slice(int(piece[0]), int(piece[-1]) + 1)
        if side == backwards:
            left_out[BACKWARDS] += len(piece)
        else:
            yield replace(
                track, first=track.first + own.start, values={name: v[own] for name, v in track.values.items()}
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
