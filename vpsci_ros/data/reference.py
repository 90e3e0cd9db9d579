"""Columns that follow from the other columns of a near-miss table, and the rows around critical steps.

A near-miss table has the whole joint track of a pair. Four flags mark interactions that are bad examples: a `standing`
car does not drive into a pedestrian; a track that `begins_critical` has no onset and no approach; a `contact` in a
recording without accidents is an error of size or position; two agents whose paths stay `apart` never met, but the
circle that CurvTTC predicted for the car led to a pedestrian on another arm. `around_critical` cuts the rows that
learning takes.
"""

from collections.abc import Mapping

import numpy as np
import polars as pl

from vpsci_ros.data.courses import Floats, trailing_slope
from vpsci_ros.safety import (
    CRITICAL_TTC,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvature_from_yaw_rate,
    curvttc,
)

WALKER, CYCLIST, SCOOTER = KINDS = ("walker", "cyclist", "scooter")  # of pedestrians; people learn from walkers
STANDING_SPEED = 0.5  # [m/s] a vehicle below it at the first critical step stands
APART = 5.0  # [m] two paths that never come so near to each other are apart
LEAST_BEFORE = 3  # steps before the first critical one; with fewer a track begins critical
BEFORE = 10  # steps before the first critical one that learning takes
AFTER = 10  # steps after the last critical one that learning takes
_STATE = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy")
_BLOCK = 512  # steps of one path in each block of distances to the other path
_SIZES = ("veh_length", "veh_width")
_FIRST = (pl.col("curvttc") < CRITICAL_TTC).arg_max()  # the first critical row of an interaction
FLAG_RULES = {
    "standing": (pl.col("veh_speed").get(_FIRST) < STANDING_SPEED).over("interaction"),
    "begins_critical": (_FIRST < LEAST_BEFORE).over("interaction"),
    "contact": (pl.col("curvttc").min() <= 0.0).over("interaction"),
}


def curvttc_of(
    columns: Mapping[str, Floats], yaw_rate: Floats, length: float | Floats, width: float | Floats
) -> Floats:
    """Return CurvTTC [s], float64[T], of rows of a near-miss table, for a yaw rate [rad/s] at each of them.

    :param columns: veh_x, veh_y, veh_heading, veh_speed, ped_x, ped_y, ped_vx, ped_vy, float64[T] each.
    :param length, width: of the vehicle [m], one for all rows or float64[T].
    """
    x, y, heading, speed, *pedestrian = (columns[name] for name in _STATE)
    vehicle = x, y, heading, speed, curvature_from_yaw_rate(yaw_rate, speed)
    return curvttc(*vehicle, *pedestrian, length=length, width=width, radius=PEDESTRIAN_RADIUS)


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


def around_critical(table: pl.DataFrame) -> pl.DataFrame:
    """Return each interaction's rows from `BEFORE` steps before its first critical step to `AFTER` after its last one.

    Ten before, because closed loops start at the first critical step after up to ten observed ones, and the policies'
    attention spans ten; ten after, for the motion after the danger. Steps between two critical spells stay, as part of
    one interaction. More steps would fill the buffer with undisturbed motion, and did not help: stage 1 with all 546
    pairs below 10 s of CurvTTC and 30 steps after had the same held-out errors (two folds).
    """
    step = pl.int_range(pl.len()).over("interaction")
    critical = pl.when(pl.col("curvttc") < CRITICAL_TTC).then(step)
    first, last = critical.min().over("interaction"), critical.max().over("interaction")
    return table.filter((step >= first - BEFORE) & (step <= last + AFTER))
