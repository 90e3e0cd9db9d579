"""The result of an import: the near misses, and a summary of each source, printed and stored with the table."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.data.importers.tracks import FAST
from vpsci_ros.documents import counted
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.text_table import text_table
from vpsci_ros.safety import CRITICAL_TTC, HORIZON, PEDESTRIAN_RADIUS
from vpsci_ros.world.observation import STEP


@dataclass(frozen=True)
class SourceSummary:
    """The counts of an import from one source.

    :ivar pairs: vehicles and pedestrians that are there at the same time.
    :ivar near_misses: pairs whose CurvTTC falls below 5 s, of at least `LEAST_STEPS` rows.
    :ivar steps: rows of the table; `critical_steps` of them have a CurvTTC below 5 s.
    :ivar quartiles: of the least CurvTTC of each near miss [s], NaN where there is none.
    :ivar vehicle_length, vehicle_width: the rectangle that CurvTTC was computed with [m], unless a track has its own.
    :ivar left_out: what was left out of the recordings -> how often.
    :ivar assumed: a text for each fact that the recordings do not hold.
    :ivar vehicles, pedestrians: unbroken tracks; `fast` of the pedestrians have a median speed above 2.5 m/s.
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
    vehicles: int = 0
    pedestrians: int = 0
    fast: int = 0

    @property
    def speeds(self) -> str:
        """A line that says how many pedestrians are as fast as bicycles, and how to leave them out."""
        share = f"{self.fast:,} of {self.pedestrians:,} pedestrians ({self.fast / max(self.pedestrians, 1):.1%})"
        hint = f"; --fastest {FAST:g} leaves them out" if self.fast else ""
        return f"{share} are faster than {FAST:g} m/s (median while they move){hint}"


@dataclass(frozen=True)
class ImportResult:
    """A near-miss table and the summaries of the sources it came from."""

    table: pl.DataFrame
    summaries: tuple[SourceSummary, ...]

    @property
    def metadata(self) -> dict[str, Any]:
        """The metadata that `write_near_misses` should store beside the rows."""
        return {
            "sources": {summary.source: asdict(summary) for summary in self.summaries},
            "step": STEP,
            "critical_ttc": CRITICAL_TTC,
            "horizon": HORIZON,
            "pedestrian_radius": PEDESTRIAN_RADIUS,
            "versions": software_versions(),
        }


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
        console.print(f"{row.source}: {row.speeds}")
        for text, count in row.left_out.items():
            console.print(f"{row.source}: left out: {text}: {count:,}")
        for text in row.assumed:
            console.print(f"{row.source}: {text}")


def require_near_misses(result: ImportResult) -> None:
    """Refuse an import without a near miss.

    :raises InvalidInput: says what was read of each source, what was left out of it, and the likely cause.
    """
    if result.table.height:
        return
    found = []
    for one in result.summaries:
        left_out = "; ".join(f"{what}: {count:,}" for what, count in one.left_out.items()) or "nothing"
        found.append(
            f"{one.source}: {counted(one.clips, 'clip')}, {counted(one.vehicles, 'track')} of vehicles, "
            f"{one.pedestrians:,} of pedestrians, {counted(one.pairs, 'pair')} at the same time, none below "
            f"{CRITICAL_TTC:g} s of CurvTTC; left out: {left_out}"
        )
    cause = (
        "nobody meets a vehicle closely; if they should, check units, axes and headings (--check draws pairs)"
        if any(one.pairs for one in result.summaries)
        else "no vehicle is there when a pedestrian is; check the times of both, and which classes are named"
    )
    raise InvalidInput(f"no near miss: {'; '.join(found)}; {cause}")
