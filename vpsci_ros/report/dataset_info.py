"""What a dataset holds, beside Table 10 of the paper."""

from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC, TABLE_10
from vpsci_ros.report.summary import print_rejections


def print_info(folder: str | Path, console: Console | None = None) -> None:
    """Print Table 10 with the paper's numbers, the rejections, and the least CurvTTC with and without the third filter.

    :raises InvalidInput: no dataset.
    """
    console = console or Console()
    data = Dataset(folder)
    rows = data.scenarios.values()
    console.print(_table_10(data))
    print_rejections(folder, console)
    kept = sum(row["kept"] for row in rows)
    collided = sum(row["kept_outcomes"]["collision"] for row in rows)
    total = data.description["all"]
    early = total["with_early_collisions"]
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for head in ("", "episodes", "collisions", "share", "least CurvTTC\nQ1 median Q3 [s]"):
        view.add_column(head, justify="right" if head else "left", no_wrap=True)
    view.add_row("kept", f"{kept:,}", f"{collided:,}", f"{collided / max(1, kept):.2%}", _three(total["least_curvttc"]))
    least = data.description["filters"]["least_frames"]
    view.add_row(
        f"and collisions before {least}",
        f"{early['kept']:,}",
        f"{early['collisions']:,}",
        f"{early['collisions'] / max(1, early['kept']):.2%}",
        _three(early["least_curvttc"]),
    )
    view.add_row("paper, kept", f"{sum(row.kept for row in TABLE_10.values()):,}", "", "", _three(LEAST_CURVTTC))
    view.add_row("paper, real near misses", "336", "", "", _three(REAL_LEAST_CURVTTC))
    console.print(view)


def _table_10(data: Dataset) -> Table:
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)
    view.add_column("", no_wrap=True)
    for head in ("kept", "paper", "passed", "vehicle\nkm", "m each\n(paper)", "walker\nkm", "m each\n(paper)"):
        view.add_column(head, justify="right", no_wrap=True)
    rows = data.scenarios
    for name, row in rows.items():
        published = TABLE_10.get(row["number"])
        cells = ["-", "-", "-"]
        if published is not None:
            lengths = published.vehicle_km, published.pedestrian_km
            cells = [f"{published.kept:,}", *(f"{1000.0 * km / published.kept:.1f}" for km in lengths)]
        view.add_row(name.removeprefix("Location").replace("_PedCross_", " "), *_cells(row, cells))
    view.add_section()
    names = ("kept", "simulated", "vehicle_km", "pedestrian_km")
    everything = {name: sum(row[name] for row in rows.values()) for name in names}
    everything["acceptance_rate"] = everything["kept"] / max(1, everything["simulated"])
    kept = sum(row.kept for row in TABLE_10.values())
    km = [sum(row.vehicle_km for row in TABLE_10.values()), sum(row.pedestrian_km for row in TABLE_10.values())]
    view.add_row("all", *_cells(everything, [f"{kept:,}", *(f"{1000.0 * length / kept:.1f}" for length in km)]))
    return view


def _cells(row: dict[str, float], paper: list[str]) -> list[str]:
    """Return the cells of a row of Table 10: `paper` holds its count and its lengths per episode."""
    cells = [f"{row['kept']:,}", paper[0], f"{row['acceptance_rate'] or 0.0:.1%}"]
    for name, published in zip(("vehicle_km", "pedestrian_km"), paper[1:], strict=True):
        cells += [f"{row[name]:,.1f}", f"{1000.0 * row[name] / max(1, row['kept']):.1f} ({published})"]
    return cells


def _three(quartiles: tuple[float, ...] | list[float]) -> str:
    return "  ".join(f"{value:.2f}" for value in quartiles)
