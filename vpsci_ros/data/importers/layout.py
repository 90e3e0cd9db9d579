"""Tables of tracks with any column names: a layout gives the column and the unit of each quantity.

`clip_of` takes a table by its `Layout`, compares every speed, velocity and heading with the positions, and gives tracks
at 0.1 s.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.courses import Floats, courses, slope
from vpsci_ros.data.importers.agreement import Names, checked_table, said_speed, steps
from vpsci_ros.data.importers.layout_file import BOX, TICKS, Layout
from vpsci_ros.data.importers.tracks import (
    BACKWARDS,
    GAPS,
    LARGEST,
    LINE,
    MAX_GAP,
    Checks,
    Clip,
    LeftOut,
    Track,
    Unusable,
    alike,
    hypot,
    longest_gap,
    merged,
    require_columns,
    resample,
    spaces,
    spacing,
)
from vpsci_ros.data.near_misses import TURN_LIMIT, WALKER
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

# Counts of `Clip.left_out`:
NAMELESS, PLACELESS = "rows without an id", "rows without a position"
CHANGES = "road users that change their class for some frames, and count by the class of most"
TURNS = "jumps of a vehicle's heading, such as those of reversing, at which tracks are cut"

CLASS = "class of the road user"  # a column with the class that counts
REVERSING = -0.1  # [m/s] slower than this is driving backwards, not the noise of a standing car
REVERSAL = 2.0  # [rad] between two directions of motion, one of which is backwards
FASTEST_PEDESTRIAN, FASTEST_VEHICLE = 12.0, 60.0  # [m/s] faster is a jump: another road user has the track's id
_CHANGES_WITHIN = 2.0  # [s] from one row to the next a road user may change its class; later it is another one
_COARSE = 0.03  # [s] between two numbers in which times of frames fall together
_FEW = 100  # rows, of which each may be a road user of its own
_DATE = r"^\d{4}-\d\d?-\d\d?|^\d\d?:\d\d"  # how a date or a time of day begins


def clip_of(name: str, parts: Mapping[Path, tuple[pl.DataFrame, Layout]]) -> Clip:
    """Return a clip made of one or several tables, given by file; `road_users` counts those that checks leave out.

    :raises InvalidInput: a column that is missing, dates in place of numbers, rows without tracks or too far apart, or
        times that have lost their precision.
    """
    return merged([_clip_of(name, path, table, layout) for path, (table, layout) in parts.items()])


def _clip_of(name: str, path: Path, table: pl.DataFrame, layout: Layout) -> Clip:
    require_columns(table, layout.columns.values(), path)
    _require_tracks(table, layout, path)
    table, left_out = _steady(table, layout)
    rate, assumed, vehicles = layout.rate, list[str](), list[Track]()
    known, users = layout.vehicles | layout.kinds.keys(), classes_in(table, layout)
    checks = Checks({f"road users of class {own}": LeftOut(n) for own, n in users.items() if own not in known})

    def pieces(whose: str, fastest: float, tracks: pl.DataFrame, names: Names, kinds: Names) -> Iterator[Track]:
        gap = longest_gap(tracks, rate, path)
        tracks, jumps = _without_fast_rows(tracks, layout, fastest, whose, path, names, checks)
        left_out[f"speeds of {whose} above {fastest:g} m/s (jumps), at which tracks are cut"] += jumps
        left_out[GAPS] += spaces(tracks, rate).filter(pl.col("seconds") > gap).height
        if gap > MAX_GAP:
            assumed.append(
                f"rows are {spacing(tracks, rate):.2g} s apart, between them motion is interpolated; "
                f"tracks are cut at gaps of more than {gap:.2g} s"
            )
        for track in resample(tracks, rate, "heading", gap, fastest):
            name, kind = names.get(track.number, ""), kinds.get(track.number, WALKER)
            yield replace(smoothed(track, layout.smooth), name=name, kind=kind)

    walkers, *people = _canonical(table, layout, "pedestrians", path, checks)
    cars, *drivers = _canonical(table, layout, "vehicles", path, checks)
    pedestrians = list[Track]()
    for track in pieces("pedestrians", FASTEST_PEDESTRIAN, walkers, *people):
        own = {name: track.values[name] for name in "xy"} | dict(
            zip(("vx", "vy"), _velocity(track.values), strict=True)
        )
        pedestrians.append(replace(track, values=own))
    if walkers.height and "vx" not in walkers.columns:
        assumed.append("velocities of pedestrians are slopes of positions over 0.4 s")
    if cars.height:
        said = cars.columns
        forward = cars.filter(_along(cars) >= REVERSING)
        left_out[BACKWARDS] = cars.height - forward.height
        for track in pieces("vehicles", FASTEST_VEHICLE, forward, *drivers):
            vehicles += _cut_at_turns(_vehicle(track), left_out, reverses="heading" not in cars.columns)
        without = len({track.number for track in vehicles if track.size is None})
        sizes = f"of {without} vehicles that have none" if "length" in cars.columns else "of vehicles"
        assumed += ["velocities of vehicles are slopes of positions over 0.4 s"] * (not {"vx", "speed"} & {*said})
        assumed += ["headings are directions of motion"] * ("heading" not in said)
        assumed += [f"sizes {sizes} are the format's"] * ("length" not in said or without > 0)
    return Clip(name, vehicles, pedestrians, left_out, tuple(assumed), road_users=checks, described=layout.described)


def _require_tracks(table: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse a table in which most road users have a single row."""
    column = layout.columns.get("id", "")
    if column and table.height >= _FEW and 2 * (count := table[column].n_unique()) > table.height:
        raise Unusable(
            "clips in which most road users have one row",
            f"{path}: column {column} has {count:,} ids in {table.height:,} rows, so most road users have one row; "
            "expected an id that a road user has in every frame",
        )


def _steady(table: pl.DataFrame, layout: Layout) -> tuple[pl.DataFrame, Counter[str]]:
    """Return the rows that have an id and a position, with `LINE` and `CLASS`, and counts of what was left out.

    A road user whose class changes from one row to the next has the class of most of its rows. Road users that have one
    id after another, or at once, keep their classes.
    """
    left_out = Counter[str]()
    if LINE not in table.columns:
        table = table.with_columns(pl.int_range(2, 2 + pl.len()).alias(LINE))
    for what, names in ((NAMELESS, ("id",)), (PLACELESS, ("x", "y", *BOX))):
        columns = [pl.col(layout.columns[name]).cast(pl.String) for name in names if name in layout.columns]
        empty = [column.str.strip_chars().str.to_lowercase().fill_null("").is_in(["", "nan"]) for column in columns]
        known = table.filter(~pl.any_horizontal(empty)) if empty else table
        left_out[what], table = table.height - known.height, known
    table = table.with_columns(_classes(table, layout).alias(CLASS))
    rows = table.select(CLASS, LINE, id=_names(table, layout))
    several = rows.select("id", CLASS).unique().filter(pl.col("id").is_duplicated())["id"]
    if several.is_empty():
        return table, left_out
    rows = rows.filter(pl.col("id").is_in(several.unique().implode()))
    clock, seconds = ("frame", 1.0 / layout.rate) if "frame" in layout.columns else ("time", layout.time_unit)
    wanted = {"t": (clock, seconds)} | {n: (n if n in layout.columns else f"{n}_min", layout.metres) for n in "xy"}
    numbers = {n: pl.col(layout.columns[c]).cast(pl.Float64, strict=False) * unit for n, (c, unit) in wanted.items()}
    rows = rows.join(table.select(LINE, **numbers), on=LINE).sort("id", "t", maintain_order=True)
    alone = pl.struct("id", "t").is_unique().all().over("id")
    dx, dy, dt = (pl.col(name).diff().over("id") for name in "xyt")
    cut = (dt > _CHANGES_WITHIN) | (hypot(dx, dy) > FASTEST_VEHICLE * dt)
    rows = rows.with_columns(piece=(cut.fill_null(True)).cum_sum()).filter(alone)
    most = pl.col(CLASS).drop_nulls().mode(maintain_order=True).first().over("piece")
    changed = rows.with_columns(most=most).filter(pl.col("most") != pl.col(CLASS).fill_null(""))
    left_out[CHANGES] = changed["id"].n_unique()
    table = table.join(changed.select(LINE, "most"), on=LINE, how="left", maintain_order="left")
    return table.with_columns(pl.coalesce("most", CLASS).alias(CLASS)).drop("most"), left_out


def classes_in(table: pl.DataFrame, layout: Layout) -> Counter[str]:
    """Return the number of road users of each class, the one that counts where the table has it."""
    classes = table[CLASS] if CLASS in table.columns else _classes(table, layout)
    rows = pl.DataFrame({"class": classes, "id": _names(table, layout)})
    return Counter(dict(rows.group_by("class").agg(pl.col("id").n_unique()).sort("class").rows()))


def _names(table: pl.DataFrame, layout: Layout) -> pl.Series:
    """Return the ids of a table's rows as they are there; 1 without a column of them."""
    return table[layout.columns["id"]] if "id" in layout.columns else pl.repeat(1, table.height, eager=True)


def _classes(table: pl.DataFrame, layout: Layout) -> pl.Series:
    if "class" not in layout.columns:
        return pl.Series("class", [next(iter(layout.vehicles | layout.pedestrians))]).new_from_index(0, table.height)
    return alike(table[layout.columns["class"]]).str.to_lowercase()


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
                "seconds since any instant"
            )
        text = given.str.strip_chars() if given.dtype == pl.String else given
        numbers = text.cast(pl.Float64, strict=False)
        bad = ~numbers.is_finite().fill_null(False)
        if bad.any() and given.dtype == pl.String and bool(text.filter(bad).str.contains(_DATE).fill_null(False).all()):
            raise InvalidInput(
                f"{self.path}: column {column} holds dates or times of day, such as {shown(given.filter(bad)[0])}; "
                "expected numbers: write seconds since any instant"
            )
        correct = "correct the file or remove that road user's rows"
        self.mark(bad, lambda n: f", column {column}: expected a finite number, got {shown(given[n])}; {correct}")
        return numbers.set(bad, 0.0)

    def whole(self, values: pl.Series, column: str) -> pl.Series:
        """Return whole numbers as Int64; rows with others are marked."""
        bad = (values != values.round()) | (values.abs() >= LARGEST)
        self.mark(bad, lambda row: f", column {column}: expected a whole number (below 2^53), got {values[row]}")
        return values.set(bad, 0.0).cast(pl.Int64)


def _canonical(
    table: pl.DataFrame, layout: Layout, whose: str, path: Path, checks: Checks
) -> tuple[pl.DataFrame, Names, Names]:
    """Return the rows of vehicles or pedestrians in metres and radians, and their ids and kinds by number, if any.

    The rows have id, frame, x, y, and those of vx, vy, speed, heading, length, width that the layout has.

    :param table: with `LINE` and `CLASS`.
    """
    walk = whose == "pedestrians"
    table = table.filter(pl.col(CLASS).is_in(list(layout.kinds if walk else layout.vehicles)))
    rows = _Rows(table, path)
    wanted = ("x", "y", *BOX, "vx", "vy", *(() if walk else ("speed", "heading", "length", "width")))
    ids, named = _ids(rows, layout)
    clock = layout.columns["frame" if "frame" in layout.columns else "time"]
    ticks = rows.numbers(clock)
    if "time" in layout.columns:
        _require_precision(ticks, layout, path)
        ticks = (ticks * (layout.time_unit * TICKS)).round()
    found = {"id": ids, "frame": rows.whole(ticks, clock)}
    for name in (name for name in layout.columns if name in wanted):
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
    lost, fault = ids.filter(rows.bad).unique().to_list(), min(rows.faults.items(), default=(0, ""))[1]
    checks.report(f"{whose} that cannot be read", ids.n_unique(), lost, fault)
    said = tracks = tracks.filter(~pl.col("id").is_in(lost)).drop("row", "bad")
    if walk and "speed" in layout.columns and layout.speeds_agree:
        speed = table[layout.columns["speed"]].cast(pl.Float64, strict=False) * layout.unit("speed")
        speeds = pl.DataFrame({"id": ids, "frame": found["frame"], "speed": speed}).unique(["id", "frame"])
        said = tracks.join(speeds, ["id", "frame"], "left", maintain_order="left")
    tracks = checked_table(said, layout, whose, str(path), named, checks).select(tracks.columns)
    if "heading" in found:
        tracks = tracks.with_columns(layout.directions(tracks["heading"], layout.angle, layout.heading))
    kinds = table[CLASS].replace_strict(layout.kinds, return_dtype=pl.String) if walk else ()
    return tracks, named, dict(zip(ids, kinds, strict=False))


def _require_precision(times: pl.Series, layout: Layout, path: Path) -> None:
    """Refuse times of single precision that are so large that frames fall together, such as those of an epoch."""
    if times.is_empty() or not (times.cast(pl.Float32).cast(pl.Float64) == times).all():
        return
    latest = float(times.abs().max())  # type: ignore[arg-type]
    if (step := float(np.spacing(np.float32(latest))) * layout.time_unit) > _COARSE:
        raise Unusable(
            "clips whose times have lost their precision",
            f"{path}: column {layout.columns['time']}: times have lost their precision: as numbers of single precision "
            f"(float32) they are {step:.3g} s apart at {latest:.10g}; write them in double precision (float64), or "
            "count them from the first frame",
        )


def _ids(rows: _Rows, layout: Layout) -> tuple[pl.Series, dict[int, str]]:
    """Return ids as whole numbers, and the names of those that are none: their places in alphabetical order."""
    ids = _names(rows.table, layout)
    numbers, whole = ids.cast(pl.Float64, strict=False), ids.cast(pl.Int64, strict=False)
    if numbers.null_count():
        places = ids.cast(pl.String).rank("dense").cast(pl.Int64)
        return places, dict(zip(places, ids.cast(pl.String), strict=True))
    exact = whole.null_count() or ids.dtype.is_float()
    return rows.whole(numbers, layout.columns.get("id", "")) if exact else whole, {}


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


def _along(cars: pl.DataFrame) -> pl.Expr:
    """Return the speed [m/s] along the heading that rows say; 0 without it."""
    if "speed" in cars.columns:
        return pl.col("speed")
    if {"vx", "heading"} <= set(cars.columns):
        return pl.col("vx") * pl.col("heading").cos() + pl.col("vy") * pl.col("heading").sin()
    return pl.lit(0.0)


def _without_fast_rows(
    tracks: pl.DataFrame, layout: Layout, fastest: float, whose: str, path: Path, names: Names, checks: Checks
) -> tuple[pl.DataFrame, int]:
    """Return the rows whose speed is at most `fastest` [m/s], and the number of other rows and of jumps.

    A jump is a step between two rows of a road user that would take a higher speed than `fastest`. Road users most of
    whose rows are so are left out.
    """
    tracks = tracks.with_columns(said=said_speed(tracks))
    slow, said = tracks.filter(pl.col("said") <= fastest), tracks.filter(pl.col("said") > fastest)
    jumps = steps(slow, layout.rate).filter(pl.col("way") > fastest * pl.col("seconds"))
    fast = pl.concat([said.select("id"), jumps.select("id")]).group_by("id").len("fast")
    shares = tracks.group_by("id", maintain_order=True).len("rows").join(fast, "id", "left", maintain_order="left")
    most, text = shares.filter(2 * pl.col("fast") > pl.col("rows")), ""
    if most.height:
        number, count, of = most.select("id", "fast", "rows").row(0)
        text = (
            f"{path}, road user {names.get(number, number)}: {count:,} of {of:,} rows of {whose} are faster than "
            f"{fastest:g} m/s; the unit of positions or times is another"
            + " (metres, time_unit, frame_rate)" * layout.described
            + ", or they are relative to a moving sensor"
        )
    what = f"{whose} faster than {fastest:g} m/s in most of their rows"
    odd = checks.report(what, shares.height, most["id"].to_list(), text)
    others = int(shares["fast"].sum()) - int(most["fast"].sum())
    return slow.filter(~pl.col("id").is_in(odd)).drop("said"), others


def _velocity(own: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    return (own["vx"], own["vy"]) if "vx" in own else (slope(own["x"]), slope(own["y"]))


def _vehicle(track: Track) -> Track:
    """Return the track of a vehicle; its heading is NaN where nothing says it, see `Clip`."""
    own, size = track.values, None
    vx, vy = _velocity(own)
    heading = own["heading"] if "heading" in own else courses(own["x"], own["y"], vx, vy)
    speed = np.maximum(own["speed"] if "speed" in own else vx * np.cos(heading) + vy * np.sin(heading), 0.0)
    if "length" in own and own["length"][0] > 0.0 and own["width"][0] > 0.0:
        size = float(np.median(own["length"])), float(np.median(own["width"]))
    values = {"x": own["x"], "y": own["y"], "heading": heading, "speed": speed}
    return replace(track, values=values, size=size)
