"""The pictures of an exam: measures with intervals, least distances, outcomes, and one episode with each pedestrian."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.config import added_pedestrians, title_of
from vpsci_ros.exam.report import ADS, BASELINE
from vpsci_ros.policy.config import LEARNED
from vpsci_ros.report.canvas import blank_figure, save_png
from vpsci_ros.report.trajectories import draw_episode
from vpsci_ros.safety import HORIZON

# Okabe and Ito's colours, which most people can distinguish
COLOURS = {
    LEARNED: "#d55e00",
    "recorded": "#cc79a7",
    "walker": "#0072b2",
    "constant_velocity": "#56b4e9",
    "social_force": "#009e73",
}
_MORE = ("#8c564b", "#e377c2", "#7f7f7f", "#bcbd22")


def _colour(pedestrian: str) -> str:
    """Return a pedestrian's colour; those that other distributions add take what is left in turn."""
    return COLOURS.get(pedestrian) or _MORE[added_pedestrians().index(pedestrian) % len(_MORE)]


RATES = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate")
_ENDS = (
    ("collision", "collision", "#7f1d1d"),
    ("pedestrian", "only the pedestrian yielded", "#e69f00"),
    ("both", "both yielded", "#f0e442"),
    ("vehicle", "only the vehicle yielded", "#009e73"),
    ("nobody", "nobody yielded", "#c8c8c8"),
)


def save_overview(report: Mapping[str, Any], table: pl.DataFrame, path: Path) -> None:
    """Draw shares with intervals, the distribution of the least CurvTTC and how critical episodes ended, as a PNG."""
    names = list(report["drivers"][ADS])
    figure = blank_figure(11.5, 2.9 + 0.62 * len(names))
    top, bottom = figure.subfigures(
        2, 1, squeeze=False, height_ratios=[0.7 + 0.3 * len(names), 1.9 + 0.25 * len(names)]
    ).flat
    axes = top.subplots(1, len(RATES), sharey=True, squeeze=False)
    for axis, measure in zip(axes.flat, RATES, strict=True):
        _draw_rates(axis, report, measure, names)
    left, right = bottom.subplots(1, 2, width_ratios=[1.0, 1.25])
    _draw_least(left, table, names)
    _draw_ends(right, table, names)
    save_png(figure, path)


def save_one(episode: Episode, path: Path) -> None:
    """Draw an episode by itself, as a PNG."""
    figure = blank_figure(4.4, 3.3)
    draw_episode(figure.subplots(), "", episode.pair())
    save_png(figure, path)


def _draw_rates(axis: Axes, report: Mapping[str, Any], measure: str, names: list[str]) -> None:
    greatest = 0.0
    for driver, shift in ((ADS, -0.13), (BASELINE, 0.17)):
        for row, name in enumerate(names):
            found = report["drivers"].get(driver, {}).get(name, {}).get(measure)
            if found is None or found["value"] is None:
                continue
            value, low, high = (100.0 * found[key] for key in ("value", "low", "high"))
            colour = _colour(name) if driver == ADS else "#999999"
            inside = colour if driver == ADS else "white"
            bars = [[value - low], [high - value]]
            axis.errorbar(
                [value], [row + shift], xerr=bars, fmt="o", color=colour, mfc=inside, capsize=2.5, markersize=5
            )
            greatest = max(greatest, high)
    axis.set_title(report["definitions"][measure]["title"], fontsize=9)
    axis.set_yticks(range(len(names)), [title_of(name) for name in names], fontsize=8)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlim(-2.0, min(100.0, 1.08 * greatest) + 2.0)
    axis.set_xlabel("% of episodes", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.grid(axis="x", color="#e5e5e5")
    axis.set_axisbelow(True)


def _draw_least(axis: Axes, table: pl.DataFrame, names: list[str]) -> None:
    for name in names:
        least = np.sort(_rows(table, ADS, name)["least_curvttc"].to_numpy())
        share = 100.0 * np.arange(1, len(least) + 1) / len(least)
        axis.step([0.0, *least], [0.0, *share], where="post", color=_colour(name), label=title_of(name), linewidth=1.6)
    axis.set_xlim(0.0, HORIZON)
    axis.set_ylim(0.0, 100.0)
    axis.set_title("how near it came", fontsize=9)
    axis.set_xlabel("least CurvTTC of the episode [s]", fontsize=8)
    axis.set_ylabel("% of episodes at or below", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.grid(color="#e5e5e5")
    axis.legend(fontsize=7, loc="lower right", frameon=False)


def _draw_ends(axis: Axes, table: pl.DataFrame, names: list[str]) -> None:
    for row, name in enumerate(names):
        critical = _rows(table, ADS, name).filter(pl.col("critical"))
        ended = critical.select(
            pl.when(pl.col("collision")).then(pl.lit("collision")).otherwise(pl.col("yielded")).alias("end")
        )["end"].to_list()
        begin = 0.0
        for end, _, colour in _ENDS:
            width = 100.0 * ended.count(end) / max(len(ended), 1)
            axis.barh(row, width, left=begin, color=colour, height=0.62, edgecolor="white", linewidth=0.5)
            if width > 6.0:
                dark = end in ("collision", "vehicle")
                axis.text(begin + 0.5 * width, row, f"{width:.0f}", ha="center", va="center", fontsize=7,
                          color="white" if dark else "black")  # fmt: skip
            begin += width
    for _, label, colour in _ENDS:
        axis.barh(0, 0, color=colour, label=label)
    axis.set_yticks(range(len(names)), [title_of(name) for name in names], fontsize=8)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlim(0.0, 100.0)
    axis.set_title("how critical episodes ended, and who gave way", fontsize=9)
    axis.set_xlabel("% of critical episodes (CurvTTC < 5 s)", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.45, -0.2), frameon=False)


def _rows(table: pl.DataFrame, driver: str, pedestrian: str) -> pl.DataFrame:
    return table.filter((pl.col("driver") == driver) & (pl.col("pedestrian") == pedestrian))
