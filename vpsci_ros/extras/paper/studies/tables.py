"""Tables 3 and 9 beside the paper's values, as text and as pictures."""

from pathlib import Path
from typing import Any

import polars as pl
from matplotlib.axes import Axes
from rich.console import Console

from vpsci_ros.evaluation.error_table import share_text
from vpsci_ros.extras.paper.published import TABLE_3, TABLE_9
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.runs.text_table import text_table
from vpsci_ros.world.observation import AGENTS

VEHICLE, PEDESTRIAN, PAPER, GREEN, ORANGE = "#08519c", "#cb181d", "#8c8c8c", "#2ca02c", "#e6550d"
_COLOURS = dict(zip(AGENTS, (VEHICLE, PEDESTRIAN), strict=True))

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


def save_table_9(result: dict[str, Any], path: Path) -> None:
    """Draw both protocols' errors, as shares of the control's with 95% intervals, by model, as a PNG."""
    figure, (axes,) = new_figure(11.0, max(4.2, 0.22 * len(result["models"])), 1, 2)
    for axis, protocol, colour in zip(axes, ("reconstruction", "closed_loop"), (GREEN, ORANGE), strict=True):
        left_out = {"constant_velocity"} | ({"constant_velocity_tracked"} if protocol == "reconstruction" else set())
        rows = [(name, errors[protocol]) for name, errors in result["models"].items() if name not in left_out][::-1]
        places, share = list(range(len(rows))), [of["ade_ratio"] for _, of in rows]
        ends = list(zip(*(of["ade_ratio_interval"] for _, of in rows), strict=True))
        spread = [[abs(end - s) for end, s in zip(side, share, strict=True)] for side in ends]
        axis.barh(places, share, xerr=spread, color=colour, alpha=0.75, ecolor="#404040", capsize=2)
        axis.axvline(1.0, color=PAPER, linestyle="--")
        axis.set_xlim(left=0.0)
        axis.set_yticks(places, [name for name, _ in rows])
        axis.set_xlabel("ADE as a share of repeat_velocity's; 95%", fontsize=9)
        _finish(axis, protocol.replace("_", " "), "")
    save_png(figure, path, 110)


def save_table_3(table: pl.DataFrame, path: Path) -> None:
    """Draw rewards, critic losses and held-out errors over the number of interactions, as a PNG."""
    figure, ((rewards, losses, errors),) = new_figure(13.8, 4.2, 1, 3)
    rows = [row for row in table.iter_rows(named=True) if row.get("vehicle_reward") is not None]
    sizes = [_size(row) for row in rows]
    for agent in AGENTS:
        look: Row = {"color": _COLOURS[agent], "marker": "o", "markersize": 4}
        held_out = [row.get(f"{agent}_held_out_reward") for row in rows]
        rewards.plot(sizes, [row[f"{agent}_reward"] for row in rows], label=f"{agent}, in training", **look)
        if any(value is not None for value in held_out):
            rewards.plot(sizes, _gaps(held_out), linestyle=":", label=f"{agent}, held-out clips", **look)
        losses.plot(sizes, [row[f"{agent}_critic_loss"] for row in rows], label=f"{agent}'s critic", **look)
    losses.plot(list(TABLE_3), [p.critic_loss for p in TABLE_3.values()], color=PAPER, linestyle="--", label="paper's")
    losses.set_yscale("log")
    for agent, column in zip(AGENTS, ("vehicle_reward", "pedestrian_reward"), strict=True):
        paper = [getattr(row, column) for row in TABLE_3.values()]
        line: Row = {"linestyle": "--", "linewidth": 0.9, "color": _COLOURS[agent], "alpha": 0.6}
        rewards.plot(list(TABLE_3), paper, label=f"{agent}, paper's", **line)
    control = table.row(-1, named=True)
    for protocol, colour in (("closed_loop", ORANGE), ("reconstruction", GREEN)):
        values = [row.get(f"{protocol}_ade") for row in rows]
        if any(value is not None for value in values):
            of = control[f"{protocol}_ade"]
            label = f"{protocol.replace('_', ' ')}, of {of:.3g} m"
            errors.plot(sizes, [v / of for v in _gaps(values)], color=colour, marker="o", markersize=4, label=label)
    errors.axhline(1.0, color=PAPER, linestyle="--", label="last velocity repeated")
    errors.set_ylim(bottom=0.0)
    _finish(rewards, "reward of an interaction", "reward")
    _finish(losses, "critic loss", "loss")
    _finish(errors, "ADE on held-out clips", "share of the control's")
    for axis in (rewards, losses, errors):
        axis.set_xlabel("interactions learned from", fontsize=9)
    save_png(figure, path, 110)


def _size(row: Row) -> int:
    return int(row["interactions"]) if row["interactions"].isdigit() else 0


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"


def _gaps(values: list[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]


def _finish(axis: Axes, title: str, beside: str) -> None:
    axis.set_title(title, fontsize=10)
    axis.set_ylabel(beside, fontsize=9)
    axis.tick_params(labelsize=8)
    axis.grid(color="#e4e4e4", linewidth=0.7)
    axis.set_axisbelow(True)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=7, frameon=False)
