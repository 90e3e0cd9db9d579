"""Flags of near misses, and the rows around their critical steps.

A near-miss table keeps the whole joint track of a pair. Four flags say what an interaction cannot be an example of: a
car that stands does not drive into anybody; a track that begins critical has no onset and no approach; a contact
between two people who both went home is an error of size or place; two agents whose paths stay apart never met, since
the circle on which the car drove for a moment led to somebody on another arm. `around_critical` cuts the rows that
learning takes.
"""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.safety import (
    CRITICAL_TTC,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvature_from_yaw_rate,
    curvttc,
)
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
STANDING_SPEED = 0.5  # [m/s] a vehicle below it at the first critical step stands
APART = 5.0  # [m] two paths that never come so near to each other are apart
LEAST_BEFORE = 3  # steps before the first critical one; with fewer a track begins critical
BEFORE = 10  # steps before the first critical one that learning takes
AFTER = 10  # steps after the last critical one that learning takes
_STATE = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy")
_BLOCK = 512  # steps of one path in each block of distances to the other path
_YAW_WINDOW = 4  # steps back over which the causal yaw rate is a slope


def trailing_slope(values: Floats, window: int = _YAW_WINDOW) -> Floats:
    """Return the slope [1/s] of values on the 0.1 s grid at each step: a least-squares line through the last steps.

    :param values: float64[T]; window: steps back that the line spans, fewer where there are fewer.
    """
    out = np.zeros(len(values))
    for span in range(1, min(window, len(values) - 1) + 1):
        offsets = np.arange(span + 1) - 0.5 * span
        slopes = np.correlate(values, offsets / (STEP * float(offsets @ offsets)), "valid")
        out[span:] = slopes
    return out


def causal_curvttc(columns: Mapping[str, Floats], yaw_rate: Floats, length: float, width: float) -> Floats:
    """Return CurvTTC [s], float64[T], of one pair, by a yaw rate [rad/s] that uses no later step (`trailing_slope`).

    :param columns: veh_x, veh_y, veh_heading, veh_speed, ped_x, ped_y, ped_vx, ped_vy, float64[T] each.
    """
    x, y, heading, speed, *pedestrian = (columns[name] for name in _STATE)
    curvature = curvature_from_yaw_rate(yaw_rate, speed)
    px, py, vx, vy = pedestrian
    state = (x, y, heading, speed, curvature, px, py, vx, vy)
    return curvttc(*state, length=length, width=width, radius=PEDESTRIAN_RADIUS)


def flags(ttc: Floats, speed: Floats) -> dict[str, bool]:
    """Return `standing`, `begins_critical` and `contact` of one interaction.

    :param ttc: float64[T] [s], below 5 s at some step; speed: of the vehicle, float64[T] [m/s].
    """
    first = int(np.argmax(ttc < CRITICAL_TTC))
    return {
        "standing": bool(speed[first] < STANDING_SPEED),
        "begins_critical": first < LEAST_BEFORE,
        "contact": bool(ttc.min() <= 0.0),
    }


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


def with_apart(table: pl.DataFrame) -> pl.DataFrame:
    """Return a near-miss table with the flag `apart`, computed from its rows."""
    columns = {name: table[name].to_numpy() for name in ("veh_x", "veh_y", "ped_x", "ped_y")}
    lengths = table["interaction"].rle().struct.field("len").to_numpy()
    ends = np.cumsum(lengths)
    parts = (slice(end - length, end) for length, end in zip(lengths, ends, strict=True))
    values = [paths_apart({name: column[part] for name, column in columns.items()}) for part in parts]
    return table.with_columns(apart=pl.Series(np.repeat(np.array(values, np.bool_), lengths), dtype=pl.Boolean))


def with_reference(table: pl.DataFrame, sizes: Mapping[str, tuple[float, float]]) -> pl.DataFrame:
    """Return a near-miss table with `curvttc_causal` and all flags except `apart`, computed from its rows.

    :param sizes: source -> length and width of its vehicles [m]; other sources have the default vehicle's.
    """
    parts = []
    for part in table.partition_by("interaction", maintain_order=True):
        columns = {name: part[name].cast(pl.Float64).to_numpy() for name in (*_STATE, "curvttc")}
        size = sizes.get(part["source"][0], (VEHICLE_LENGTH, VEHICLE_WIDTH))
        causal = causal_curvttc(columns, trailing_slope(columns["veh_heading"]), *size)
        own = {name: pl.lit(value) for name, value in flags(columns["curvttc"], columns["veh_speed"]).items()}
        parts.append(part.with_columns(pl.Series("curvttc_causal", causal), **own))
    return pl.concat(parts)


def clean(table: pl.DataFrame) -> pl.DataFrame:
    """Return the interactions of a near-miss table whose vehicle drives, whose onset was seen and whose paths meet."""
    return table.filter(~pl.col("standing") & ~pl.col("begins_critical") & ~pl.col("apart"))


def around_critical(table: pl.DataFrame) -> pl.DataFrame:
    """Return the rows from `BEFORE` steps before the first critical one of each interaction to `AFTER` after the last.

    Ten before, because closed loops start at the first critical step after up to ten observed ones, and the policies'
    attention spans ten; ten after, for how people go on when it is over. Steps between two critical spells stay: they
    are part of one encounter. More would fill the buffer with people who walk undisturbed, and did not help: stage 1
    with all 546 pairs below 10 s and 30 steps after came to the same held-out errors (two folds).
    """
    step = pl.int_range(pl.len()).over("interaction")
    critical = pl.when(pl.col("curvttc") < CRITICAL_TTC).then(step)
    first, last = critical.min().over("interaction"), critical.max().over("interaction")
    return table.filter((step >= first - BEFORE) & (step <= last + AFTER))
