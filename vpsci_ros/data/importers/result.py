"""What an import returns and prints: the near misses, a summary of each source, and what is stored with the table."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.data.near_misses import concat_near_misses
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.tables import text_table
from vpsci_ros.safety import CRITICAL_TTC, HORIZON, PEDESTRIAN_RADIUS
from vpsci_ros.world.observation import STEP


@dataclass(frozen=True)
class SourceSummary:
    """What one source holds.

    :ivar pairs: vehicles and pedestrians that are there at the same time.
    :ivar near_misses: those of them whose CurvTTC falls below 5 s.
    :ivar steps: rows of the table; `critical_steps` of them below 5 s.
    :ivar quartiles: of the least CurvTTC of each near miss [s], NaN where there is none.
    :ivar vehicle_length, vehicle_width: the rectangle that CurvTTC was computed with [m], unless a track has its own.
    :ivar left_out: what of the recordings is not in `pairs`: what it is -> how often.
    :ivar assumed: what the recordings do not hold.
    """

    source: str
    clips: int
    pairs: int
    near_misses: int
    steps: int
    critical_steps: int
    quartiles: tuple[float, float, float]
    vehicle_length: float
    vehicle_width: float
    left_out: Mapping[str, int]
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class ImportResult:
    """A near-miss table and the summaries of the sources it came from."""

    table: pl.DataFrame
    summaries: tuple[SourceSummary, ...]

    @property
    def metadata(self) -> dict[str, Any]:
        """What `write_near_misses` should store beside the rows."""
        return {
            "sources": {summary.source: asdict(summary) for summary in self.summaries},
            "step": STEP,
            "critical_ttc": CRITICAL_TTC,
            "horizon": HORIZON,
            "pedestrian_radius": PEDESTRIAN_RADIUS,
            "versions": software_versions(),
        }


def joined(results: Sequence[ImportResult]) -> ImportResult:
    """Return several results as one, interactions numbered through.

    :raises InvalidInput: none given, or the same recording twice.
    """
    summaries = tuple(summary for result in results for summary in result.summaries)
    return ImportResult(concat_near_misses([result.table for result in results]), summaries)


def least_quartiles(table: pl.DataFrame) -> tuple[float, float, float]:
    """Return the quartiles of each interaction's least CurvTTC [s]; NaN without interactions."""
    least = table.group_by("interaction").agg(pl.col("curvttc").min())["curvttc"].to_numpy()
    low, median, high = np.quantile(least, (0.25, 0.5, 0.75)) if len(least) else np.full(3, np.nan)
    return float(low), float(median), float(high)


def print_import_summary(result: ImportResult, console: Console | None = None) -> None:
    """Print the table of `vpsci import`: clips, pairs, near misses, steps, quartiles of the least CurvTTC."""
    columns = [
        (one.source, (one.clips, one.pairs, one.near_misses, one.steps, one.critical_steps), one.quartiles)
        for one in result.summaries
    ]
    if len(columns) > 1:
        sums = tuple(sum(counts) for counts in zip(*(counts for _, counts, _ in columns), strict=True))
        columns.append(("together", sums, least_quartiles(result.table)))
    rows: list[list[str] | None] = []
    for i, name in enumerate(("clips", "pairs", "near misses", "steps", "of them critical")):
        rows.append([name, *(f"{counts[i]:,}" for _, counts, _ in columns)])
        if name == "near misses":
            rows.append(["share of pairs", *(f"{counts[2] / max(counts[1], 1):.1%}" for _, counts, _ in columns)])
    rows.append(None)
    for i, name in enumerate(("first quartile", "median", "third quartile")):
        rows.append([f"least CurvTTC, {name} [s]", *(f"{quartiles[i]:.2f}" for *_, quartiles in columns)])
    title = f"Near misses: pairs whose CurvTTC falls below {CRITICAL_TTC:g} s"
    console = console or Console()
    console.print(text_table(title, ("", *(source for source, _, _ in columns)), rows))
    for row in result.summaries:
        for text, count in row.left_out.items():
            console.print(f"{row.source}: left out {count:,} {text}")
        for text in row.assumed:
            console.print(f"{row.source}: {text}")
