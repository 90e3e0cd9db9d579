"""Recorded and generated near misses beside each other, drawn at random and drawn alike."""

from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.panels import Panel
from vpsci_ros.report.trajectories import draw_panel, draw_speed_bars
from vpsci_ros.runs.files import written_whole
from vpsci_ros.safety import CRITICAL_TTC

EACH, COLUMNS = 12, 6
BEFORE, AFTER = 10, 50  # steps around the onset that are drawn: 1 s and 5 s
HALF = 14.0  # [m] half a panel's width


def save_beside(recorded: pl.DataFrame, generated: pl.DataFrame, path: str | Path, seed: int = 0) -> None:
    """Draw `EACH` interactions of either table, chosen at random, and write a PNG, whole or not at all.

    Each is drawn without its street from 1 s before the onset to 5 s after it, the vehicle at the onset heading up.

    :param recorded, generated: near-miss tables, with `curvttc_causal`.
    :raises InvalidInput: a table has no interaction with an onset, or the folder of `path` does not exist.
    """
    rows = -(-EACH // COLUMNS)
    figure = Figure(figsize=(2.6 * COLUMNS, 2.8 * 2 * rows + 1.2), layout="constrained")
    FigureCanvasAgg(figure)
    halves = np.asarray(figure.subfigures(2, 1))
    for part, (name, table) in zip(halves, (("recorded", recorded), ("generated", generated)), strict=True):
        part.suptitle(f"{name}, {EACH} at random", fontsize=12)
        axes = part.subplots(rows, COLUMNS, squeeze=False)
        panels = _panels(table, name, np.random.default_rng([seed, len(name)]))
        for axis, one in zip(axes.flat, panels, strict=False):
            draw_panel(axis, one, None)
            axis.set_xlim(-HALF, HALF)
            axis.set_ylim(-HALF, HALF)
            axis.set(xlabel="", ylabel="", xticks=[], yticks=[])
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
    draw_speed_bars(part, axes[:, : COLUMNS // 2], axes[:, COLUMNS // 2 :])
    with written_whole(path) as part_file:
        figure.savefig(part_file, format="png", dpi=100)


def _panels(table: pl.DataFrame, name: str, rng: np.random.Generator) -> list[Panel]:
    parts = table.filter((pl.col("curvttc_causal") < CRITICAL_TTC).any().over("interaction")).partition_by(
        "interaction", maintain_order=True
    )
    if not parts:
        raise InvalidInput(f"{name}: expected an interaction with CurvTTC below {CRITICAL_TTC:g} s, got none")
    return [_panel(parts[i]) for i in rng.permutation(len(parts))[:EACH]]


def _panel(whole: pl.DataFrame) -> Panel:
    onset = int((whole["curvttc_causal"].to_numpy() < CRITICAL_TTC).argmax())
    part = whole[max(0, onset - BEFORE) : onset + AFTER + 1]
    at = min(onset, BEFORE)
    vehicle, pedestrian = (part.select(f"{who}_x", f"{who}_y").to_numpy() for who in ("veh", "ped"))
    turn = 0.5 * np.pi - float(part["veh_heading"][at])
    centre = 0.5 * (vehicle[at] + pedestrian[at])
    ttc = part["curvttc_causal"].to_numpy()
    return Panel(
        title=f"least CurvTTC {ttc.min():.1f} s",
        scenario=0,
        vehicle=_turned(vehicle - centre, turn),
        vehicle_speed=part["veh_speed"].to_numpy(),
        heading=part["veh_heading"].to_numpy() + turn,
        pedestrian=_turned(pedestrian - centre, turn),
        pedestrian_speed=np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy()),
        nearest=int(ttc.argmin()),
    )


def _turned(points: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    cos, sin = np.cos(angle), np.sin(angle)
    turned: NDArray[np.float64] = points @ np.array([[cos, sin], [-sin, cos]])
    return turned
