"""`vpsci safety compare`: how often each safety measure detects the others' conflicts, and how much earlier.

Every measure flags an interaction as a conflict at the first step at which it passes its threshold. Interactions of one
clip share agents and traffic, so the intervals resample clips, or groups where these are few. The interactions were
selected by CurvTTC: what another measure sees outside of them is not in the table, and no share here is a detection
rate.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray
from rich.console import Console
from rich.padding import Padding

from vpsci_ros.data.corpus import around_critical
from vpsci_ros.data.courses import slope
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.recorded import size_of
from vpsci_ros.evaluation.statistics import Units, cluster_counts, interval, units_of
from vpsci_ros.runs.text_table import table_console, text_table
from vpsci_ros.safety import (
    CONFLICT_TTC,
    closest_encounter,
    curvature_from_yaw_rate,
    curvttc,
    drac,
    post_encroachment_time,
    second_order_ttc,
    ttc_2d,
)
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
MEASURES = ("CurvTTC", "center", "TTC 2D", "2nd order", "DRAC", "TTCE", "PET")
CLOSEST = 2.0  # [m] distance of the centres below which a TTCE is a conflict
BRAKING = 3.4  # [m/s2] DRAC above which braking is no longer comfortable
ENCROACHMENT = 2.0  # [s] PET below which it is a conflict
RESAMPLES = 1000
THRESHOLDS = (
    f"TTC < {CONFLICT_TTC:g} s; DRAC > {BRAKING:g} m/s2; TTCE < {CONFLICT_TTC:g} s with DCE < {CLOSEST:g} m; "
    f"PET < {ENCROACHMENT:g} s"
)


def first_flags(table: pl.DataFrame) -> tuple[Floats, NDArray[np.bool_], Units]:
    """Return when each measure first flags each interaction [s], whether PET is defined, and the resampled units.

    :param table: a near-miss table. Vehicles have the size of their source, else the default size.
    :returns: float64[N, len(MEASURES)], time since the interaction's first row in `around_critical` [s], infinity where
        never; bool[N]; and the units of the N interactions. PET's time is that of the second agent's arrival.
    """
    parts = around_critical(table).partition_by("interaction", maintain_order=True)
    found = [_flags(part) for part in parts]
    clips = np.array([f"{part['source'][0]}/{part['clip'][0]}" for part in parts])
    times, defined = np.stack([times for times, _ in found]), np.array([defined for _, defined in found])
    return times, defined, units_of(clips, np.array([part["group"][0] for part in parts]))


def _flags(part: pl.DataFrame) -> tuple[Floats, bool]:
    length, width = size_of(part)
    column = {name: part[name].to_numpy() for name in part.columns if part[name].dtype == pl.Float64}
    x, y, heading, speed = (column[name] for name in ("veh_x", "veh_y", "veh_heading", "veh_speed"))
    walker = tuple(column[name] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy"))
    curvature = curvature_from_yaw_rate(slope(heading), speed)
    curved = column["curvttc"]
    state = (x, y, heading, speed, curvature, *walker)
    center = curvttc(*state, length=length, width=width, method="center")
    straight = ttc_2d(x, y, heading, speed, *walker, length=length, width=width)
    second = second_order_ttc(x, y, heading, speed, slope(speed), curvature, *walker, length=length, width=width)
    ttce, dce = closest_encounter(x, y, speed * np.cos(heading), speed * np.sin(heading), *walker)
    flagged = np.stack(
        [
            curved < CONFLICT_TTC,
            center < CONFLICT_TTC,
            straight < CONFLICT_TTC,
            second < CONFLICT_TTC,
            drac(curved, speed) > BRAKING,
            (ttce < CONFLICT_TTC) & (ttce > 0.0) & (dce < CLOSEST),
        ]
    )
    first = np.where(flagged.any(axis=1), flagged.argmax(axis=1) * STEP, np.inf)
    pet, arrival = post_encroachment_time(x, y, heading, walker[0], walker[1], dt=STEP, length=length, width=width)
    return np.append(first, arrival if pet < ENCROACHMENT else np.inf), not np.isnan(pet)


@dataclass(frozen=True)
class Agreement:
    """Detection of each other's conflicts by M measures, all in the order of `MEASURES`.

    :ivar interactions: in the table; units: their clips or groups, as in "46 clips".
    :ivar pet_defined: interactions whose paths cross within the rows of the table.
    :ivar conflicts: int[M], interactions that each measure flags.
    :ivar both: int[M, M], interactions that row and column flag.
    :ivar share: float64[M, M], part of the column's conflicts that the row flags as well; NaN without any.
    :ivar lead: float64[M, M], median time [s] by which the row flags earlier than the column, where both flag.
    :ivar share_interval: float64[M, 2, 2], 95% over resampled units of `share[0]` and of `share[:, 0]`.
    :ivar lead_interval: float64[M, 2], 95% over resampled units of `lead[0]`.
    """

    interactions: int
    units: str
    pet_defined: int
    conflicts: NDArray[np.int64]
    both: NDArray[np.int64]
    share: Floats
    lead: Floats
    share_interval: Floats
    lead_interval: Floats


def agreement(table: pl.DataFrame) -> Agreement:
    """Return how far the measures agree on the interactions of a near-miss table.

    :param table: columns of `vpsci_ros.data.near_misses.NEAR_MISS_COLUMNS`.
    """
    times, pet_defined, units = first_flags(table)
    flagged, count = np.isfinite(times), len(MEASURES)
    names, unit = np.unique(units.labels, return_inverse=True)
    per_unit = np.stack([flagged[unit == u].T.astype(float) @ flagged[unit == u] for u in range(len(names))])
    drawn = cluster_counts(np.arange(len(names)), 0, RESAMPLES)
    shares = _share(np.einsum("rc,cij->rij", drawn, per_unit))
    lead, lead_interval = np.full((count, count), np.nan), np.full((count, 2), np.nan)
    for i, j in itertools.permutations(range(count), 2):
        pair = flagged[:, i] & flagged[:, j]
        if pair.any():
            earlier = times[pair, j] - times[pair, i]
            lead[i, j] = np.median(earlier)
            if i == 0:
                lead_interval[j] = interval(_weighted_medians(earlier, drawn[:, unit[pair]]))
    both = per_unit.sum(axis=0)
    return Agreement(
        interactions=len(times),
        units=units.text,
        pet_defined=int(pet_defined.sum()),
        conflicts=flagged.sum(axis=0),
        both=both.astype(np.int64),
        share=_share(both),
        lead=lead,
        share_interval=np.array([[interval(shares[:, 0, j]), interval(shares[:, j, 0])] for j in range(count)]),
        lead_interval=lead_interval,
    )


def compare(path: str | Path, console: Console | None = None) -> None:
    """Print the agreement matrix and the lead times of the near misses in the table `path`.

    :raises InvalidInput: `path` is not a near-miss table.
    """
    result = agreement(read_near_misses(path))
    console = console or table_console()
    console.print(
        f"{result.interactions} interactions of {result.units}, selected by CurvTTC < 5 s. "
        f"A measure flags a conflict at: {THRESHOLDS}."
    )
    console.print(
        _matrix(result, "Part of the column's conflicts that the row's measure flags too", result.share, "{:.2f}")
    )
    console.print(
        _matrix(result, "Seconds by which the row flags earlier, median where both flag", result.lead, "{:+.1f}")
    )
    console.print(_beside_curvttc(result))
    console.print(
        f"Intervals: {result.units} resampled. PET is known only when the second agent arrives; the paths of "
        f"{result.pet_defined} of the {result.interactions} interactions cross within the rows of the table."
    )


def _share(both: Floats) -> Floats:
    conflicts = np.diagonal(both, axis1=-2, axis2=-1)[..., None, :]
    empty = np.full(both.shape, np.nan)
    return np.divide(both, conflicts, out=empty, where=conflicts > 0)


def _weighted_medians(values: Floats, weights: Floats) -> Floats:
    """Return the median of `values` [n] under each row of whole `weights` [R, n]; NaN where all are 0."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[:, order], axis=1)
    total = below[:, -1:]
    low = np.argmax(below >= (total + 1) // 2, axis=1)
    high = np.argmax(below >= total // 2 + 1, axis=1)
    middle = 0.5 * (values[order][low] + values[order][high])
    return np.where(total[:, 0] > 0, middle, np.nan)


def _matrix(result: Agreement, title: str, values: Floats, form: str) -> Padding:
    heads = [f"{name}\nn={conflicts}" for name, conflicts in zip(MEASURES, result.conflicts, strict=True)]
    rows = [
        (name, *("-" if i == j or np.isnan(value) else form.format(value) for j, value in enumerate(values[i])))
        for i, name in enumerate(MEASURES)
    ]
    return text_table(title, ("", *heads), rows)


def _beside_curvttc(result: Agreement) -> Padding:
    heads = ("conflicts", "both", "of its conflicts,\nCurvTTC flags", "of CurvTTC's,\nit flags", "CurvTTC earlier [s]")
    rows = [
        (
            *(name, str(result.conflicts[j]), str(result.both[0, j])),
            _with_interval(result.share[0, j], result.share_interval[j, 0], "{:.2f}"),
            _with_interval(result.share[j, 0], result.share_interval[j, 1], "{:.2f}"),
            _with_interval(result.lead[0, j], result.lead_interval[j], "{:+.1f}"),
        )
        for j, name in enumerate(MEASURES[1:], start=1)
    ]
    return text_table("Beside CurvTTC, with 95% intervals", ("", *heads), rows)


def _with_interval(value: float, interval: Floats, form: str) -> str:
    if np.isnan(value):
        return "-"
    low, high = (form.format(bound) for bound in interval)
    return f"{form.format(value)} ({low} to {high})"
