"""The near-miss table: recorded interactions with CurvTTC below 5 s, one row for each step of 0.1 s.

An interaction is one vehicle and one pedestrian of one clip, for as long as both are seen. Its rows lie together,
`step` counts them without a gap. Your own recordings enter the package by this table.

Four flags mark interactions that are bad examples: a `standing` car does not drive into a pedestrian; a track that
`begins_critical` has no onset and no approach; a `contact` in a recording without accidents is an error of size or
position; two agents whose paths stay `apart` never met, but the circle that CurvTTC predicted for the car led to a
pedestrian on another arm.
"""

import math
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.courses import Floats, trailing_slope
from vpsci_ros.data.parquet import Column, read_metadata, read_parquet, write_parquet
from vpsci_ros.documents import require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import RIGHT_TURNS, near_misses_part
from vpsci_ros.safety import CRITICAL_TTC, VEHICLE_LENGTH, VEHICLE_WIDTH, curvature_from_yaw_rate, curvttc
from vpsci_ros.world.observation import STEP

NEAR_MISS_COLUMNS: dict[str, Column] = {
    "interaction": Column(pl.Int64, "", "number of the interaction; its rows lie together"),
    "source": Column(pl.String, "", "data set the interaction comes from"),
    "clip": Column(pl.String, "", "recording within the source; the unit by which data are held out"),
    "step": Column(pl.Int64, "", "number of the row within its interaction, without a gap"),
    "time": Column(pl.Float64, "s", "time in the clip"),
    "veh_id": Column(pl.Int64, "", "number of the vehicle in its clip"),
    "ped_id": Column(pl.Int64, "", "number of the pedestrian in its clip"),
    "veh_x": Column(pl.Float64, "m", "centre of the vehicle"),
    "veh_y": Column(pl.Float64, "m", "centre of the vehicle"),
    "veh_heading": Column(pl.Float64, "rad", "counter-clockwise from x; may exceed pi, never jumps"),
    "veh_speed": Column(pl.Float64, "m/s", "along the heading, not below 0"),
    "veh_vx": Column(pl.Float64, "m/s", "velocity of the vehicle"),
    "veh_vy": Column(pl.Float64, "m/s", "velocity of the vehicle"),
    "ped_x": Column(pl.Float64, "m", "centre of the pedestrian"),
    "ped_y": Column(pl.Float64, "m", "centre of the pedestrian"),
    "ped_vx": Column(pl.Float64, "m/s", "velocity of the pedestrian"),
    "ped_vy": Column(pl.Float64, "m/s", "velocity of the pedestrian"),
    "curvttc": Column(pl.Float64, "s", "curvilinear time to collision, infinity where there is none within 10 s"),
    "distance": Column(pl.Float64, "m", "between the two centres"),
    "curvttc_causal": Column(pl.Float64, "s", "CurvTTC as known at the step: the yaw rate looks back alone"),
    "standing": Column(pl.Boolean, "", "the vehicle stands (below 0.5 m/s) at the first step with CurvTTC < 5 s"),
    "begins_critical": Column(pl.Boolean, "", "fewer than 3 steps before that one: the onset was not seen"),
    "contact": Column(pl.Boolean, "", "CurvTTC is 0 at some step"),
    "apart": Column(pl.Boolean, "", "the two recorded paths never come within 5 m of each other"),
    "group": Column(pl.Int64, "", "one number for all interactions of one vehicle at one time"),
    "veh_name": Column(pl.String, "", "id of the vehicle in its recording"),
    "ped_name": Column(pl.String, "", "id of the pedestrian in its recording"),
    "veh_length": Column(pl.Float64, "m", "length of the vehicle"),
    "veh_width": Column(pl.Float64, "m", "width of the vehicle"),
    "kind": Column(pl.String, "", "what the pedestrian is: walker, cyclist or scooter"),
}
MOTION = ("veh_x", "veh_y", "veh_heading", "veh_vx", "veh_vy", "ped_x", "ped_y", "ped_vx", "ped_vy")  # of both agents
WORKED_OUT = ("curvttc_causal", "standing", "begins_critical", "contact")  # where a table does not have them
DERIVED = ("apart", "group", "veh_name", "ped_name", "veh_length", "veh_width", "kind")  # likewise, without a warning
_WHAT = "a near-miss table"
_FLOATS = [name for name, column in NEAR_MISS_COLUMNS.items() if column.dtype is pl.Float64]
_SIZES = ("veh_length", "veh_width")
_PAIR = ("source", "clip", "veh_id", "ped_id")
_CONSTANT = (*_PAIR, "standing", "begins_critical", "contact", *DERIVED)  # within an interaction
TURN_LIMIT = 1.0  # [rad] a heading turns by less than this in one step, or it is wrapped or in degrees
WALKER, CYCLIST, SCOOTER = KINDS = ("walker", "cyclist", "scooter")  # of pedestrians; people learn from walkers
STANDING_SPEED = 0.5  # [m/s] a vehicle below it at the first critical step stands
APART = 5.0  # [m] two paths that never come so near to each other are apart
LEAST_BEFORE = 3  # steps before the first critical one; with fewer a track begins critical
_STATE = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy")
_BLOCK = 512  # steps of one path in each block of distances to the other path
_FIRST = (pl.col("curvttc") < CRITICAL_TTC).arg_max()  # the first critical row of an interaction
FLAG_RULES = {
    "standing": (pl.col("veh_speed").get(_FIRST) < STANDING_SPEED).over("interaction"),
    "begins_critical": (_FIRST < LEAST_BEFORE).over("interaction"),
    "contact": (pl.col("curvttc").min() <= 0.0).over("interaction"),
}


def read_near_misses(name: str | Path, kinds: Collection[str] = (WALKER,)) -> pl.DataFrame:
    """Read and check a near-miss table, or a part of it: by default its walkers, since people learn from walkers alone.

    :param name: a path, or "right_turns" for the one shipped with the package; NAME/PART: only clips whose names begin
        with "PART/", such as "right_turns/train", or that one clip.
    :param kinds: of `KINDS`, those of the pedestrians to read.

    Tables from before November 2026, and tables of other programs, may lack the columns `WORKED_OUT`; a warning says
    so. They may also lack the columns `DERIVED`, which follow from the other columns and the metadata.

    :returns: the columns of `NEAR_MISS_COLUMNS` in that order (further ones are left out), see `check_near_misses`.
    :raises InvalidInput: no such file, not Parquet, or not a near-miss table; names file, column, row, and the remedy;
        or no clip of the part, or nobody of these kinds, and names those there are.
    """
    path, part = near_misses_part(name)
    if not path.exists():
        shipped = f"{RIGHT_TURNS}, {RIGHT_TURNS}/train and {RIGHT_TURNS}/dev"
        raise InvalidInput(f"{path}: no such file; expected {_WHAT} in Parquet, or one of the shipped {shipped}")
    table = read_parquet(path, _WHAT)
    if missing := [name for name in WORKED_OUT if name not in table.columns]:
        warnings.warn(
            f"{path}: columns {', '.join(missing)} are worked out from the rows that it has. A table from before "
            "November 2026 ends 1 s after the last critical step: import its recordings again for whole tracks",
            stacklevel=2,
        )
    sizes = {} if set(_SIZES) <= set(table.columns) else _sizes(path)
    table = check_near_misses(table, str(path), sizes)
    chosen = table.filter(pl.col("kind").is_in(list(kinds)))
    if chosen.is_empty():
        others = ", ".join(table["kind"].unique().sort())
        raise InvalidInput(
            f"{path}: no near miss of a {' or '.join(kinds)}, but of {others}; import its recordings by `--kinds "
            f"{','.join(kinds)}`, or take another table"
        )
    if not part:
        return chosen
    table, clip = chosen, pl.col("clip")
    chosen = table.filter((clip == part) | clip.str.starts_with(f"{part}/"))
    if chosen.is_empty():
        folders = table["clip"].filter(table["clip"].str.contains("/")).str.split("/").list.first().unique().sort()
        has = f"its parts are {', '.join(folders)}" if len(folders) else "its clips have no parts (no / in their names)"
        raise InvalidInput(f"{path}/{part}: {path.name} has no clip {part} and none that begins with {part}/; {has}")
    return chosen


def write_near_misses(
    table: pl.DataFrame, path: str | Path, metadata: Mapping[str, Any] | None = None, *, compact: bool = False
) -> None:
    """Check `table` and write it as Parquet (zstd), whole or not at all, with units and `metadata` in the schema.

    :param compact: round to four decimals (0.1 mm), in single precision wherever that holds them: a third of the size,
        half of it with coordinates of a map (UTM).

    :raises InvalidInput: `table` is not a near-miss table, or the folder of `path` does not exist.
    """
    table, columns = check_near_misses(table, str(path)), NEAR_MISS_COLUMNS
    if compact:
        table = table.with_columns(pl.col(_FLOATS).round(4))
        rounded = table.select(pl.col(_FLOATS).cast(pl.Float32).cast(pl.Float64))
        motion = [name for name in _FLOATS if name not in _SIZES]
        single = [n for n in motion if ((table[n] == rounded[n]) | ((table[n] - rounded[n]).abs() <= 5e-5)).all()]
        columns = columns | {name: columns[name]._replace(dtype=pl.Float32) for name in single}
        table = table.with_columns(pl.col(single).cast(pl.Float32))
    write_parquet(table, path, columns, content=_WHAT, **(metadata or {}))


def _sizes(path: str | Path) -> dict[str, tuple[float, float]]:
    """Return length and width [m] of the vehicles of each source that an import has stored with its table."""
    sources = read_metadata(path).get("sources", {})
    number = (int, float)
    require_form(sources, {"*": {"vehicle_length": number, "vehicle_width": number}}, f"{path}, metadata, sources")
    return {name: (own["vehicle_length"], own["vehicle_width"]) for name, own in sources.items()}


def check_near_misses(
    table: pl.DataFrame, where: str, sizes: Mapping[str, tuple[float, float]] | None = None
) -> pl.DataFrame:
    """Check a near-miss table and return it with exactly the columns and types of `NEAR_MISS_COLUMNS`.

    :param where: what the table comes from, the opening of each error message.
    :param sizes: source -> length and width of vehicles [m], for columns that the table does not have; of other
        sources those of the default vehicle.
    :raises InvalidInput: a missing column, a wrong type, a missing or not finite value, rows of an interaction that lie
        apart, are unsorted or have a gap, a heading that jumps, or an interaction that never falls below 5 s.
    """
    given = [name for name in NEAR_MISS_COLUMNS if name in table.columns or name not in (*WORKED_OUT, *DERIVED)]
    table = _typed(table, where, given)
    if table.is_empty():
        raise InvalidInput(f"{where}: {_WHAT} without a row; import recordings that hold near misses")
    for name in (name for name in _FLOATS if name in given):
        value, expected = pl.col(name), "a finite number"
        bad = ~value.is_finite()
        if name in ("curvttc", "curvttc_causal"):
            expected = "a time not below 0, infinity where no collision is predicted, never NaN"
            bad = value.is_nan() | (value < 0.0)
        elif name in ("veh_speed", "distance"):
            bad, expected = bad | (value < 0.0), f"a {name.removeprefix('veh_')} not below 0"
        elif name in _SIZES:
            bad, expected = bad | (value <= 0.0), "a size above 0"
        _refuse_first(table, bad, name, where, expected)
    if "kind" in given:
        _refuse_first(table, ~pl.col("kind").is_in(KINDS), "kind", where, " or ".join(KINDS))
    _check_order(table, where, given)
    _check_motion(table, where)
    if len(given) == len(NEAR_MISS_COLUMNS):
        return table
    return completed(table, sizes).select(list(NEAR_MISS_COLUMNS))


def _typed(table: pl.DataFrame, where: str, given: list[str]) -> pl.DataFrame:
    missing = [name for name in given if name not in table.columns]
    if missing:
        raise InvalidInput(
            f"{where}: {_WHAT} needs column {', '.join(missing)}; it has {', '.join(table.columns) or 'none'}"
        )
    for name in given:
        kind, column = table[name].dtype, NEAR_MISS_COLUMNS[name]
        own = {pl.String: kind == pl.String, pl.Boolean: kind == pl.Boolean, pl.Int64: kind.is_integer()}
        right = own.get(column.dtype, kind.is_numeric())
        if not right:
            raise InvalidInput(f"{where}: column {name} must be {column.dtype.__name__}, got {kind}; cast it")
        _refuse_first(table, pl.col(name).is_null(), name, where, "a value in every row")
        if column.dtype == pl.Int64:
            _refuse_first(table, pl.col(name).cast(pl.Int64, strict=False).is_null(), name, where, "at most 2^63 - 1")
    return table.select(pl.col(name).cast(NEAR_MISS_COLUMNS[name].dtype) for name in given)


def _check_order(table: pl.DataFrame, where: str, given: list[str]) -> None:
    first = pl.col("interaction") != pl.col("interaction").shift(1)
    begins = table.filter(first.fill_null(True))["interaction"]
    if (again := begins.filter(begins.is_duplicated())).len():
        raise InvalidInput(
            f"{where}: the rows of interaction {again[0]} lie apart; sort by interaction and step, and give each "
            "interaction a number of its own"
        )
    inside = ~first.fill_null(True)
    for name in (name for name in _CONSTANT if name in given):
        _refuse_first(table, inside & (pl.col(name) != pl.col(name).shift(1)), name, where, "one value an interaction")
    gap = inside & (pl.col("step") != pl.col("step").shift(1) + 1)
    _refuse_first(table, gap, "step", where, "the step before plus 1: sort the rows, split interactions at gaps")
    late = inside & ((pl.col("time").diff() - STEP).abs() > 1e-3)
    _refuse_first(table, late, "time", where, f"the time before plus {STEP} s: resample to that step")


def _check_motion(table: pl.DataFrame, where: str) -> None:
    inside = pl.col("interaction") == pl.col("interaction").shift(1)
    jump = inside & (pl.col("veh_heading").diff().abs() > TURN_LIMIT)
    _refuse_first(table, jump, "veh_heading", where, "radians, unwrapped: no jump between two steps")
    dx, dy = pl.col("veh_x") - pl.col("ped_x"), pl.col("veh_y") - pl.col("ped_y")
    gap = ((dx * dx + dy * dy).sqrt() - pl.col("distance")).abs()
    _refuse_first(table, gap > 0.01, "distance", where, "metres between (veh_x, veh_y) and (ped_x, ped_y)")
    moving = table.filter(pl.col("veh_speed") > 1.0)
    along = moving["veh_heading"].cos() * moving["veh_vx"] + moving["veh_heading"].sin() * moving["veh_vy"]
    agreement = (along / moving["veh_speed"]).median()
    if isinstance(agreement, float) and agreement < math.cos(0.5):
        raise InvalidInput(
            f"{where}: veh_vx, veh_vy do not point along veh_heading (median cosine {agreement:.2f}); expected "
            "radians counter-clockwise from x, so convert degrees, and headings measured from north or with y down"
        )
    least = table.group_by("interaction", maintain_order=True).agg(pl.col("curvttc").min())
    if (safe := least.filter(pl.col("curvttc") >= CRITICAL_TTC)).height:
        number, value = safe.row(0)
        raise InvalidInput(
            f"{where}: interaction {number} never falls below {CRITICAL_TTC:g} s of CurvTTC (least {value:g} s), so it "
            "is no near miss; leave it out"
        )


def _refuse_first(table: pl.DataFrame, bad: pl.Expr, name: str, where: str, expected: str) -> None:
    row = table.select(bad.fill_null(False).arg_max().alias("row"), bad.fill_null(False).any().alias("any"))
    if row["any"][0]:
        at = int(row["row"][0])
        raise InvalidInput(
            f"{where}: column {name}, row {at} (interaction {table['interaction'][at]}): expected {expected}, "
            f"got {table[name][at]}"
        )


def concat_near_misses(tables: list[pl.DataFrame]) -> pl.DataFrame:
    """Return near-miss tables as one, interactions and groups numbered again from 0 in order.

    :raises InvalidInput: no table, a clip in two of them, or the same interaction of the same source twice.
    """
    if not tables:
        raise InvalidInput("expected at least one near-miss table, got none")
    parts, count, groups, seen = [], 0, 0, set[str]()
    for table in tables:
        if both := seen.intersection(own := clips_of(table)):
            raise InvalidInput(
                f"clip {min(both)} is there twice, in two tables ({len(both)} clips are in both); give each recording "
                "once, or, where they differ, import their folders by one command (vpsci import DIR DIR ...), which "
                "tells clips of one name apart"
            )
        seen.update(own)
        numbers = table["interaction"].rle_id().cast(pl.Int64) + count
        group = table["group"].rank("dense").cast(pl.Int64) - 1 + groups
        parts.append(table.with_columns(numbers.alias("interaction"), group.alias("group")))
        groups += table["group"].n_unique()
        count = 1 + int(numbers.max()) if len(numbers) else count  # type: ignore[arg-type]
    whole = pl.concat(parts)
    begin = [*_PAIR, "time"]
    twice = whole.filter(pl.col("interaction").is_first_distinct()).filter(pl.struct(begin).is_duplicated())
    if twice.height:
        raise InvalidInput(
            f"source {twice['source'][0]}, clip {twice['clip'][0]} is there twice; give each recording once"
        )
    return whole


def clips_of(table: pl.DataFrame) -> list[str]:
    """Return the clips of a near-miss table, as "source/clip", sorted."""
    return sorted("/".join(row) for row in table.select("source", "clip").unique().rows())


def curvttc_of(
    columns: Mapping[str, Floats], yaw_rate: Floats, length: float | Floats, width: float | Floats
) -> Floats:
    """Return CurvTTC [s], float64[T], of rows of a near-miss table, for a yaw rate [rad/s] at each of them.

    :param columns: veh_x, veh_y, veh_heading, veh_speed, ped_x, ped_y, ped_vx, ped_vy, float64[T] each.
    :param length, width: of the vehicle [m], one for all rows or float64[T].
    """
    x, y, heading, speed, *pedestrian = (columns[name] for name in _STATE)
    vehicle = x, y, heading, speed, curvature_from_yaw_rate(yaw_rate, speed)
    return curvttc(*vehicle, *pedestrian, length=length, width=width)


def completed(table: pl.DataFrame, sizes: Mapping[str, tuple[float, float]] | None = None) -> pl.DataFrame:
    """Return a near-miss table with all columns that follow from others; columns that it already has do not change.

    :param table: the rows of an interaction lie together.
    :param sizes: source -> length and width of its vehicles [m]; other sources have the default vehicle's.
    """
    for i, name in enumerate(_SIZES):
        if name not in table.columns:
            known = [(sizes or {}).get(source, (VEHICLE_LENGTH, VEHICLE_WIDTH))[i] for source in table["source"]]
            table = table.with_columns(pl.Series(name, known, pl.Float64))
    names = {f"{who}_name": pl.col(f"{who}_id").cast(pl.String) for who in ("veh", "ped")}
    rules = FLAG_RULES | names | {"kind": pl.lit(WALKER)}
    table = table.with_columns(**{name: rule for name, rule in rules.items() if name not in table.columns})
    for name, work_out in (("curvttc_causal", _causal), ("apart", _apart), ("group", _groups)):
        if name not in table.columns:
            table = table.with_columns(work_out(table).alias(name))
    return table


def _causal(table: pl.DataFrame) -> pl.Series:
    columns = {name: table[name].cast(pl.Float64).to_numpy() for name in (*_STATE, *_SIZES)}
    yaw_rate = np.concatenate([trailing_slope(columns["veh_heading"][part]) for part in _parts(table)])
    return pl.Series(curvttc_of(columns, yaw_rate, columns["veh_length"], columns["veh_width"]))


def _apart(table: pl.DataFrame) -> pl.Series:
    columns = {name: table[name].to_numpy() for name in ("veh_x", "veh_y", "ped_x", "ped_y")}
    apart = np.zeros(table.height, np.bool_)
    for part in _parts(table):
        apart[part] = paths_apart({name: column[part] for name, column in columns.items()})
    return pl.Series(apart)


def _parts(table: pl.DataFrame) -> list[slice]:
    """Return the rows of each interaction."""
    lengths = table["interaction"].rle().struct.field("len").to_list()
    return [slice(end - length, end) for length, end in zip(lengths, np.cumsum(lengths).tolist(), strict=True)]


def paths_apart(columns: Mapping[str, Floats]) -> bool:
    """Return whether the two recorded paths never come within `APART` of each other, at whatever times.

    :param columns: veh_x, veh_y, ped_x, ped_y [m], float64[T] each.
    """
    x, y = columns["veh_x"][:, None], columns["veh_y"][:, None]
    for begin in range(0, len(columns["ped_x"]), _BLOCK):
        px, py = (columns[name][begin : begin + _BLOCK] for name in ("ped_x", "ped_y"))
        if (np.hypot(px - x, py - y) < APART).any():
            return False
    return True


def _groups(table: pl.DataFrame) -> pl.Series:
    """Return the number of each row's group, from 0 in the order of rows.

    Interactions of one vehicle of one clip that have a step in common, or are linked by others that have, are a group:
    one vehicle met several pedestrians at once, so these interactions are less evidence than those of as many vehicles.
    """
    vehicle, time = ["source", "clip", "veh_id"], pl.col("time")
    spans = table.group_by("interaction", *vehicle, maintain_order=True).agg(begin=time.min(), end=time.max())
    spans = spans.with_row_index("place").sort(*vehicle, "begin", maintain_order=True)
    before = pl.col("end").cum_max().shift(1).over(vehicle)
    spans = spans.with_columns(group=(pl.col("begin") > before).fill_null(True).cum_sum())
    first = pl.col("place").min().over("group").rank("dense").cast(pl.Int64) - 1
    numbers = spans.select("interaction", group=first)
    return table.select("interaction").join(numbers, on="interaction", how="left", maintain_order="left")["group"]


def clean(table: pl.DataFrame) -> pl.DataFrame:
    """Return the interactions of a near-miss table whose vehicle drives, whose onset was seen and whose paths meet."""
    return table.filter(~pl.col("standing") & ~pl.col("begins_critical") & ~pl.col("apart"))
