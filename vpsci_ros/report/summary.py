"""What a dataset holds, per scenario: episodes, kept ones, collisions, least CurvTTC, who yielded."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import yields
from vpsci_ros.data.filters import REASONS
from vpsci_ros.safety.yielding import Yielded

Quartiles = tuple[float, float, float]


@dataclass(frozen=True)
class ScenarioSummary:
    """One scenario of a dataset; quartiles and yields are those of the kept episodes.

    :ivar collisions: of all simulated episodes, `kept_collisions` of the kept ones: what the filters hide.
    :ivar quartiles: of the least CurvTTC [s], NaN without a kept episode.
    :ivar yielded: episodes in which the vehicle, the pedestrian, both, or nobody gave way; of several
        pedestrians the most critical one counts.
    """

    name: str
    episodes: int
    kept: int
    collisions: int
    kept_collisions: int
    quartiles: Quartiles
    vehicle_yields: int
    pedestrian_yields: int
    both_yield: int
    nobody_yields: int
    vehicle_km: float
    pedestrian_km: float


def summarise(folder: str | Path) -> list[ScenarioSummary]:
    """Return a summary of each scenario of a dataset, and one of all together ("all") where there are several.

    :raises InvalidInput: the folder is no dataset, or a file of it is missing or damaged.
    """
    data = Dataset(folder)
    kept = data.index().filter(pl.col("reason") == "kept")
    rows = []
    for name, counts in data.scenarios.items():
        code = yields(data.read(scenario=name))
        least = kept.filter(pl.col("scenario") == counts["number"])["least_curvttc"].to_numpy()
        rows.append(
            ScenarioSummary(
                name,
                episodes=counts["simulated"],
                kept=counts["kept"],
                collisions=counts["outcomes"]["collision"],
                kept_collisions=counts["kept_outcomes"]["collision"],
                quartiles=_quartiles(least),
                vehicle_yields=int((code == Yielded.VEHICLE).sum()),
                pedestrian_yields=int((code == Yielded.PEDESTRIAN).sum()),
                both_yield=int((code == Yielded.BOTH).sum()),
                nobody_yields=int((code == Yielded.NONE).sum()),
                vehicle_km=counts["vehicle_km"],
                pedestrian_km=counts["pedestrian_km"],
            )
        )
    return [*rows, _together(rows, kept["least_curvttc"].to_numpy())] if len(rows) > 1 else rows


def _together(rows: Sequence[ScenarioSummary], least: np.ndarray) -> ScenarioSummary:
    names = [name for name in ScenarioSummary.__dataclass_fields__ if name not in ("name", "quartiles")]
    sums = {name: sum(getattr(row, name) for row in rows) for name in names}
    return ScenarioSummary(name="all", quartiles=_quartiles(least), **sums)


def _quartiles(least: np.ndarray) -> Quartiles:
    low, median, high = np.quantile(least, (0.25, 0.5, 0.75)) if len(least) else (np.nan,) * 3
    return float(low), float(median), float(high)


def print_summary(rows: Sequence[ScenarioSummary], console: Console | None = None) -> None:
    """Print the table; yields are percentages of the kept episodes."""
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    view.add_column("scenario", no_wrap=True)
    for head in (
        "episodes",
        "kept",
        "collisions\n(kept)",
        "least CurvTTC [s]\nQ1 median Q3",
        "yield [%]\nveh ped both",
    ):
        view.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        if row.name == "all":
            view.add_section()
        codes = (row.vehicle_yields, row.pedestrian_yields, row.both_yield)
        shares = "  ".join(f"{100.0 * code / row.kept:3.0f}" for code in codes) if row.kept else "-"
        view.add_row(
            row.name.removeprefix("Location").replace("_PedCross_", " "),
            f"{row.episodes:,}",
            f"{row.kept:,}",
            f"{row.collisions:,} ({row.kept_collisions:,})",
            "  ".join(f"{value:.2f}" for value in row.quartiles) if row.kept else "-",
            shares,
        )
    (console or Console()).print(view)


def print_rejections(folder: str | Path, console: Console | None = None) -> None:
    """Print how many episodes each condition of section 3.3 rejected, and how many of those were collisions."""
    data = Dataset(folder)
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for head in ("rejected, by the first condition that fails", "episodes", "collisions"):
        view.add_column(head, justify="left" if head.startswith("rejected") else "right", no_wrap=True)
    counts = list(data.scenarios.values())
    for reason in REASONS[1:]:
        rejected = sum(row["rejected"][reason] for row in counts)
        collisions = sum(row["rejected_collisions"][reason] for row in counts)
        if rejected:
            view.add_row(reason, f"{rejected:,}", f"{collisions:,}")
    console = console or Console()
    if view.row_count:
        console.print(view)
    if unfinished := data.description["unfinished"]:
        console.print(f"{unfinished:,} episodes had not ended.")
