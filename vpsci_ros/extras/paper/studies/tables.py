"""Table 3 beside the paper's values, as text."""

from typing import Any

import polars as pl
from rich.console import Console

from vpsci_ros.extras.paper.published import TABLE_3
from vpsci_ros.runs.text_table import text_table
from vpsci_ros.world.observation import AGENTS

Row = dict[str, Any]


def print_table_3(table: pl.DataFrame, console: Console) -> None:
    """Print what `sample_size_study` returned, in 80 columns; the paper's values in brackets."""
    learned, errors = [], []
    for row in table.iter_rows(named=True):
        paper = TABLE_3.get(_size(row))
        if row.get("vehicle_reward") is not None:
            published = [f"[{value:.3g}]" for value in paper] if paper else [""] * 3
            rewards = [f"{row[f'{agent}_reward']:.1f}" for agent in AGENTS]
            losses = [f"{row[f'{agent}_critic_loss']:.3g}" for agent in AGENTS]
            cells = [rewards[0], published[0], rewards[1], published[1], *losses, published[2]]
            learned.append((row["interactions"], *cells))
        names = [f"{protocol}_{error}" for protocol in ("reconstruction", "closed_loop") for error in ("ade", "fde")]
        cells = [_number(row.get(name), ".4f" if name.startswith("r") else ".3f") for name in names]
        cells += [_number(row.get(f"{agent}_held_out_reward"), ".1f") for agent in AGENTS]
        errors.append((row["interactions"], *cells))
    title = "in training, mean of the run's last tenth [paper's]"
    heads = ["vehicle\nreward", "", "pedestrian\nreward", "", "critics:\nvehicle", "loss of\npedestrian", ""]
    console.print(text_table(title, ["inter-\nactions", *heads], learned))
    heads = ["recon-\nstr. ADE", "\nFDE", "closed\nloop ADE", "\nFDE", "vehicle\nreward", "pedestrian\nreward"]
    console.print(text_table("on held-out clips: ADE, FDE in metres", ["interactions", *heads], errors))
    console.print(
        "Rewards and losses depend on the data, so the paper's show a trend only. Rewards in training are measured "
        "against the subset's own deviations, those on held-out clips against the whole table's. '-': all clips are "
        "needed to learn from, so none is held out. repeat_velocity and fading_acceleration are controls.",
        highlight=False,
    )


def _size(row: Row) -> int:
    return int(row["interactions"]) if row["interactions"].isdigit() else 0


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"
