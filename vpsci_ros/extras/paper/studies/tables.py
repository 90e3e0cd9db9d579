"""Tables 3 and 9 beside the paper's values, as text."""

from typing import Any

import polars as pl
from rich.console import Console

from vpsci_ros.evaluation.error_table import share_text
from vpsci_ros.extras.paper.published import TABLE_3, TABLE_9
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


def print_table_9(result: dict[str, Any], console: Console) -> None:
    """Print a result of `model_comparison.compare_models` in 80 columns; `table_9_page` has all columns."""
    rows = []
    for name, of in result["models"].items():
        if name == "constant_velocity":
            continue
        once, loop, paper = of["reconstruction"], of["closed_loop"], TABLE_9.get(name)
        published = f"[{paper.ade:.3f}]" if paper else ""
        share = share_text(loop["ade_ratio"], loop["ade_ratio_interval"])
        rows.append((name.replace("_refined", " +"), f"{once['ade']:.4f}", published, f"{loop['ade']:.3f}", share))
    title = f"{result['interactions']} interactions of {result['clips']} clips, each held out once; ADE in metres"
    heads = ["model", "recon-\nstruction", "paper's", "closed\nloop", "its share of\nthe control's"]
    console.print(text_table(title, heads, rows))
    console.print(
        "+: hybrid learning. ..ddpg: by reinforcement, "
        "the others by supervision. The control is repeat_velocity; constant_velocity_tracked starts its "
        f"closed loop as the models do. Intervals: 95%, {result['units']} resampled, "
        f"{result.get('seeds', 1)} training(s) a fold. The paper's ADE is of its own data. "
        "The other columns: models.md.",
        highlight=False,
    )


def _size(row: Row) -> int:
    return int(row["interactions"]) if row["interactions"].isdigit() else 0


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"
