"""`vpsci safety compare`: how often each safety measure sees the conflicts that the others see, and how much earlier.

Every measure flags an interaction as a conflict at the first step at which it passes its threshold. Interactions of one
clip share agents and traffic, so the intervals come from resampling whole clips. The interactions were selected by
CurvTTC: what another measure sees outside of them is not in the table, and no share here is a detection rate.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray
from rich.console import Console
from rich.padding import Padding

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.extras.paper.section_4.measure_series import MEASURES, THRESHOLDS, first_flags
from vpsci_ros.runs.tables import text_table

Floats = NDArray[np.float64]
RESAMPLES = 1000


@dataclass(frozen=True)
class Agreement:
    """What the measures see of each other's conflicts; M measures, all in the order of `names`.

    :ivar names: of the measures.
    :ivar interactions, clips: in the table.
    :ivar pet_defined: interactions whose paths cross within the rows of the table.
    :ivar conflicts: int[M], interactions that each measure flags.
    :ivar both: int[M, M], interactions that row and column flag.
    :ivar share: float64[M, M], part of the column's conflicts that the row flags as well; NaN without any.
    :ivar share_interval: float64[M, M, 2], 95% of it over resampled clips.
    :ivar lead: float64[M, M], median time [s] by which the row flags earlier than the column, where both flag.
    :ivar lead_interval: float64[M, M, 2], 95% of it over resampled clips.
    """

    names: tuple[str, ...]
    interactions: int
    clips: int
    pet_defined: int
    conflicts: NDArray[np.int64]
    both: NDArray[np.int64]
    share: Floats
    share_interval: Floats
    lead: Floats
    lead_interval: Floats


def agreement(table: pl.DataFrame, *, seed: int = 0) -> Agreement:
    """Compare the measures on a near-miss table.

    :param table: columns of `vpsci_ros.data.near_misses.NEAR_MISS_COLUMNS`.
    :param seed: of the resampling of clips.
    """
    times, pet_defined, clip = first_flags(table)
    flagged = np.isfinite(times)
    clips = int(clip.max()) + 1
    per_clip = np.stack([flagged[clip == c].T.astype(float) @ flagged[clip == c] for c in range(clips)])
    both = per_clip.sum(axis=0)
    drawn = cluster_counts(np.arange(clips), seed, RESAMPLES)
    resampled = np.einsum("rc,cij->rij", drawn, per_clip)
    count = len(MEASURES)
    lead, lead_interval = np.full((count, count), np.nan), np.full((count, count, 2), np.nan)
    for i in range(count):
        for j in range(count):
            pair = flagged[:, i] & flagged[:, j]
            if i != j and pair.any():
                earlier = times[pair, j] - times[pair, i]
                lead[i, j] = np.median(earlier)
                medians = _weighted_medians(earlier, drawn[:, clip[pair]])
                lead_interval[i, j] = interval(medians)
    return Agreement(
        names=MEASURES,
        interactions=len(times),
        clips=clips,
        pet_defined=int(pet_defined.sum()),
        conflicts=flagged.sum(axis=0),
        both=both.astype(np.int64),
        share=_share(both),
        share_interval=np.apply_along_axis(interval, 0, _share(resampled)).transpose(1, 2, 0),
        lead=lead,
        lead_interval=lead_interval,
    )


def compare(path: str | Path, console: Console | None = None) -> None:
    """Print the agreement matrix and the lead times of the near misses in the table `path`.

    :raises InvalidInput: `path` is not a near-miss table.
    """
    result = agreement(read_near_misses(path))
    console = console or Console()
    console.print(
        f"{result.interactions} interactions of {result.clips} clips, selected by CurvTTC < 5 s. "
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
        f"Intervals: whole clips resampled. PET is known only when the second agent arrives; the paths of "
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
    heads = [f"{name}\nn={conflicts}" for name, conflicts in zip(result.names, result.conflicts, strict=True)]
    rows = [
        (name, *("-" if i == j or np.isnan(value) else form.format(value) for j, value in enumerate(values[i])))
        for i, name in enumerate(result.names)
    ]
    return text_table(title, ("", *heads), rows)


def _beside_curvttc(result: Agreement) -> Padding:
    heads = ("conflicts", "both", "of its conflicts,\nCurvTTC flags", "of CurvTTC's,\nit flags", "CurvTTC earlier [s]")
    rows = [
        (
            *(name, str(result.conflicts[j]), str(result.both[0, j])),
            _with_interval(result.share[0, j], result.share_interval[0, j], "{:.2f}"),
            _with_interval(result.share[j, 0], result.share_interval[j, 0], "{:.2f}"),
            _with_interval(result.lead[0, j], result.lead_interval[0, j], "{:+.1f}"),
        )
        for j, name in enumerate(result.names[1:], start=1)
    ]
    return text_table("Beside CurvTTC, with 95% intervals", ("", *heads), rows)


def _with_interval(value: float, interval: Floats, form: str) -> str:
    if np.isnan(value):
        return "-"
    low, high = (form.format(bound) for bound in interval)
    return f"{form.format(value)} ({low} to {high})"
