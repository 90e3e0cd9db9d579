"""The result of an import: the near misses, and a summary of each source, printed and stored with the table."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.data.importers.tracks import FAST, Checks, LeftOut
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
    :ivar used, unused: road users of which the import took tracks, and others.
    :ivar checks: the counts of each check, by whom it leaves out; where it judges nobody, it judges clips.
    """

    source: str
    clips: int = 0
    pairs: int = 0
    near_misses: int = 0
    steps: int = 0
    critical_steps: int = 0
    quartiles: tuple[float, float, float] = (math.nan,) * 3
    vehicle_length: float = 0.0
    vehicle_width: float = 0.0
    left_out: Mapping[str, int] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    vehicles: int = 0
    pedestrians: int = 0
    fast: int = 0
    used: int = 0
    unused: int = 0
    checks: Mapping[str, LeftOut] = field(default_factory=dict)

    def judged(self, what: str) -> int:
        """Return how many road users, or clips, a check judged."""
        return self.checks[what].judged or self.clips

    @property
    def others(self) -> str:
        """What was left out, in one line."""
        return "; ".join(f"{what}: {count:,}" for what, count in self.left_out.items()) or "nothing"

    def lines(self) -> list[str]:
        """Return what the import says of the source: fast pedestrians, what was left out, and what was assumed."""
        share = f"{self.fast:,} of {self.pedestrians:,} pedestrians ({self.fast / max(self.pedestrians, 1):.1%})"
        hint = f"; --fastest {FAST:g} leaves them out" if self.fast else ""
        lines = [f"{share} are faster than {FAST:g} m/s (median while they move){hint}"]
        for what, count in self.left_out.items():
            first = f" of {self.judged(what):,}; the first: {self.checks[what].example}" if what in self.checks else ""
            lines.append(f"left out: {what}: {count:,}{first}")
        return [*lines, *self.assumed]


def summed(parts: Sequence[SourceSummary]) -> SourceSummary:
    """Return the summed counts of parts of one source; quartiles and sizes are those of the first."""
    counts: dict[str, Any] = {
        f.name: sum(getattr(p, f.name) for p in parts) for f in fields(SourceSummary) if f.type is int
    }
    left_out: Counter[str] = sum((Counter(part.left_out) for part in parts), Counter())
    assumed, checks = tuple(dict.fromkeys(text for part in parts for text in part.assumed)), Checks()
    for part in parts:
        checks.add(part.checks)
    return replace(parts[0], **counts, left_out=dict(left_out), assumed=assumed, checks=checks)


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
    lines = [f"{row.source}: {line}" for row in result.summaries for line in row.lines()]
    near, used, unused = (sum(getattr(row, n) for row in result.summaries) for n in ("near_misses", "used", "unused"))
    lines.append(f"{near:,} near misses; {used:,} road users used, {unused:,} left out")
    console.print("\n".join(lines), soft_wrap=True, markup=False, highlight=False)


def require_agreement(summaries: Iterable[SourceSummary]) -> None:
    """Refuse sources in which most of what a check judges fails, or without any vehicle or pedestrian.

    :raises InvalidInput: says the share, and the first that failed; or what was left out.
    """
    for one in summaries:
        for what, own in one.checks.items():
            judged, odd, clips = one.judged(what), own.odd_clips, own.clips if own.judged else one.clips
            if 2 * own.count > judged and 2 * odd > clips:  # not few clips with many road users
                share = f"{own.count:,} of {judged:,} ({own.count / judged:.0%})"
                raise InvalidInput(f"{one.source}: {what}: {share}, so most; the first: {own.example}")
        events = any(what.startswith("events") for what in one.left_out)  # whole pairs, each for a reason of its own
        if one.clips and not (one.vehicles and one.pedestrians) and not events:
            what = "vehicle" if not one.vehicles else "pedestrian"
            raise InvalidInput(
                f"{one.source}: no {what} in {counted(one.clips, 'clip')}; left out: {one.others}; name the classes as "
                "there"
            )


def require_near_misses(result: ImportResult) -> None:
    """Refuse an import without a near miss.

    :raises InvalidInput: says what was read of each source, what was left out of it, and the likely cause.
    """
    if result.table.height:
        return
    found = [
        f"{one.source}: {counted(one.clips, 'clip')}, {counted(one.vehicles, 'track')} of vehicles, "
        f"{one.pedestrians:,} of pedestrians, {counted(one.pairs, 'pair')} at the same time, none below "
        f"{CRITICAL_TTC:g} s of CurvTTC; left out: {one.others}"
        for one in result.summaries
    ]
    cause = (
        "nobody meets a vehicle closely; if they should, check units, axes and headings (--check draws pairs)"
        if any(one.pairs for one in result.summaries)
        else "no vehicle is there when a pedestrian is; check the times of both, and which classes are named"
    )
    raise InvalidInput(f"no near miss: {'; '.join(found)}; {cause}")
