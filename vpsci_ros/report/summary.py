"""Summary of a dataset beside the paper's Table 10: episodes, path lengths, rejections, collisions, least CurvTTC."""

from pathlib import Path

from rich.console import Console

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode_block import REASONS
from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC, TABLE_10
from vpsci_ros.runs.text_table import quartiles_text, short_name, text_table


def _print_rejections(data: Dataset, console: Console) -> None:
    """Print how many episodes were rejected, and how many of these collided, by the first condition of section 3.3."""
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
    """Print a dataset's counts beside the paper's Table 10, its rejections, and quartiles of the least CurvTTC.

    :raises InvalidInput: no dataset.
    """
    data = Dataset(folder)
    if warning := data.warning():
        console.print(f"note: counts are those of the files as written. {warning}", soft_wrap=True, markup=False)
    _print_table_10(data, console)
    _print_rejections(data, console)
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
