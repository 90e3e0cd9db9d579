"""What a dataset holds: by scenario episodes, collisions, least CurvTTC, who yielded; and beside Table 10."""

from pathlib import Path

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import yields
from vpsci_ros.data.episode_block import REASONS
from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC, TABLE_10
from vpsci_ros.runs.tables import quartiles_text, short_name, text_table
from vpsci_ros.safety.yielding import Yielded

_COUNTED = (
    *("episodes", "kept", "collisions", "kept_collisions"),
    *("vehicle_yields", "pedestrian_yields", "both_yield", "nobody_yields"),
)


def summarise(folder: str | Path) -> pl.DataFrame:
    """Return a row for each scenario of a dataset, and one of all together ("all") where there are several.

    Columns: scenario; how many episodes were simulated and kept, and how many of either ended in a collision; in how
    many kept ones the vehicle, the pedestrian, both, or nobody gave way (of several pedestrians the most critical one
    counts); and quartiles, of the kept ones' least CurvTTC [s], empty without one.

    :raises InvalidInput: the folder is no dataset, or a file of it is missing or damaged.
    """
    data = Dataset(folder)
    kept = data.index().filter(pl.col("reason") == "kept")
    rows = []
    for name, counts in data.scenarios.items():
        of_code = np.bincount(yields(data.read(scenario=name)), minlength=4)
        rows.append(
            {
                "scenario": name,
                "episodes": counts["simulated"],
                "kept": counts["kept"],
                "collisions": counts["outcomes"]["collision"],
                "kept_collisions": counts["kept_outcomes"]["collision"],
                "vehicle_yields": int(of_code[Yielded.VEHICLE]),
                "pedestrian_yields": int(of_code[Yielded.PEDESTRIAN]),
                "both_yield": int(of_code[Yielded.BOTH]),
                "nobody_yields": int(of_code[Yielded.NONE]),
                "quartiles": _quartiles(kept.filter(pl.col("scenario") == counts["number"])),
            }
        )
    if len(rows) > 1:
        sums = {name: sum(row[name] for row in rows) for name in _COUNTED}
        rows.append({"scenario": "all", **sums, "quartiles": _quartiles(kept)})
    return pl.DataFrame(rows, schema_overrides={"quartiles": pl.List(pl.Float64)})


def _quartiles(kept: pl.DataFrame) -> list[float]:
    return np.quantile(kept["least_curvttc"].to_numpy(), (0.25, 0.5, 0.75)).tolist() if kept.height else []


def print_summary(summary: pl.DataFrame, console: Console) -> None:
    """Print what `summarise` returned; yields are percentages of the kept episodes."""
    heads = ("scenario", "episodes", "kept", "collisions\n(kept)", "least CurvTTC [s]\nQ1 median Q3")
    rows: list[list[str] | None] = []
    for row in summary.iter_rows(named=True):
        codes = (row["vehicle_yields"], row["pedestrian_yields"], row["both_yield"])
        shares = "  ".join(f"{100.0 * code / row['kept']:3.0f}" for code in codes) if row["kept"] else "-"
        collisions = f"{row['collisions']:,} ({row['kept_collisions']:,})"
        counts = [f"{row['episodes']:,}", f"{row['kept']:,}", collisions]
        rows += [None] if row["scenario"] == "all" else []
        rows.append([short_name(row["scenario"]), *counts, quartiles_text(row["quartiles"]), shares])
    console.print(text_table("", (*heads, "yield [%]\nveh ped both"), rows))


def print_rejections(folder: str | Path, console: Console) -> None:
    """Print how many episodes each condition of section 3.3 rejected, and how many of those were collisions."""
    data = Dataset(folder)
    counts = list(data.scenarios.values())
    rows = []
    for reason in REASONS[1:]:
        rejected, collisions = (sum(row[of][reason] for row in counts) for of in ("rejected", "rejected_collisions"))
        if rejected:
            rows.append((reason, f"{rejected:,}", f"{collisions:,}"))
    if rows:
        console.print(text_table("", ("rejected, by the first condition that fails", "episodes", "collisions"), rows))
    if unfinished := data.description["unfinished"]:
        console.print(f"{unfinished:,} episodes had not ended.")


def print_info(folder: str | Path, console: Console) -> None:
    """Print Table 10 with the paper's numbers, the rejections, and the least CurvTTC with and without the third filter.

    :raises InvalidInput: no dataset.
    """
    data = Dataset(folder)
    _print_table_10(data, console)
    print_rejections(folder, console)
    total, kept = data.description["all"], sum(row["kept"] for row in data.scenarios.values())
    early = total["with_early_collisions"]
    collided = sum(row["kept_outcomes"]["collision"] for row in data.scenarios.values())
    least = data.description["filters"]["least_frames"]
    known = not kept or any(sum(row["kept_outcomes"].values()) for row in data.scenarios.values())
    rows = [
        (name, f"{count:,}", *_collisions(collisions, count, known), quartiles_text(quartiles))
        for name, count, collisions, quartiles in (
            ("kept", kept, collided, total["least_curvttc"]),
            (f"and collisions before {least}", early["kept"], early["collisions"], early["least_curvttc"]),
        )
    ]
    published = sum(row.kept for row in TABLE_10.values())
    rows.append(("paper, kept", f"{published:,}", "", "", quartiles_text(LEAST_CURVTTC)))
    rows.append(("paper, real near misses", "336", "", "", quartiles_text(REAL_LEAST_CURVTTC)))
    console.print(text_table("", ("", "episodes", "collisions", "share", "least CurvTTC\nQ1 median Q3 [s]"), rows))


def _collisions(collisions: int, episodes: int, known: bool) -> tuple[str, str]:
    """Return the number and the share; dashes where nobody knows how episodes ended, as of the authors' files."""
    return (f"{collisions:,}", f"{collisions / max(1, episodes):.2%}") if known else ("-", "-")


def _print_table_10(data: Dataset, console: Console) -> None:
    heads = ("", "kept", "paper", "passed", "vehicle\nkm", "m each\n(paper)", "walker\nkm", "m each\n(paper)")
    scenarios = data.scenarios.values()
    rows: list[list[str] | None] = [
        _row(short_name(name), row, *(TABLE_10.get(row["number"]) or (0, 0.0, 0.0)))
        for name, row in data.scenarios.items()
    ]
    names = ("kept", "simulated", "vehicle_km", "pedestrian_km")
    together = {name: sum(row[name] for row in scenarios) for name in names}
    together["acceptance_rate"] = together["kept"] / max(1, together["simulated"])
    rows += [None, _row("all", together, *(sum(column) for column in zip(*TABLE_10.values(), strict=True)))]
    console.print(text_table("", heads, rows))


def _row(name: str, row: dict[str, float], kept: float, vehicle_km: float, pedestrian_km: float) -> list[str]:
    """Return the cells of a row of Table 10 beside what the paper published; 0 kept: nothing."""
    cells = [name, f"{row['kept']:,}", f"{kept:,}" if kept else "-", f"{row['acceptance_rate'] or 0.0:.1%}"]
    for key, km in (("vehicle_km", vehicle_km), ("pedestrian_km", pedestrian_km)):
        published = f"{1000.0 * km / kept:.1f}" if kept else "-"
        cells += [f"{row[key]:,.1f}", f"{1000.0 * row[key] / max(1, row['kept']):.1f} ({published})"]
    return cells
