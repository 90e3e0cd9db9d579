"""Figures of a training's log: rewards, outcomes of episodes, held-out errors, losses.

The first panel of stage 2 is the paper's Figure 6: the rolling mean of the reward of an episode, by agent.
"""

from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vpsci_ros.data.published import RATES
from vpsci_ros.learning import online, pretrain, refine
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.world.observation import AGENTS

PICTURE = "learning.png"
COLOURS = {"vehicle": "#08519c", "pedestrian": "#cb181d"}
GREY, GREEN, ORANGE = "#6e6e6e", "#2ca02c", "#e6550d"
_ACTOR_LOSSES = {
    "velocity_error": "next velocity [m/s]",
    "vehicle_actor_loss": "vehicle",
    "pedestrian_actor_loss": "pedestrian",
}
_EPISODES = 100  # of stage 2 in a rolling mean
_BELOW = "critical episodes learned from"
_WINDOWS = 30  # rolling means of stage 1 span the run's length over this

Floats = NDArray[np.float64]


def save_learning(folder: str | Path) -> Path | None:
    """Draw the log of a run's folder as `learning.png` in it, and return its path; None without a log."""
    folder = Path(folder)
    figure, axes = new_figure(11.0, 7.0, 2, 2)
    if (folder / online.LOG).exists():
        log, episodes = map(read_log, (folder / online.LOG, folder / online.EPISODES))
        _draw_stage_2(axes.ravel().tolist(), log, episodes, _held_out(folder / refine.WEIGHTS))
    elif (folder / pretrain.LOG).exists():
        log = read_log(folder / pretrain.LOG)
        _draw_stage_1(axes.ravel().tolist(), log)
    else:
        return None
    save_png(figure, folder / PICTURE, 110)
    return folder / PICTURE


def read_log(path: Path) -> pl.DataFrame:
    """Return the table of a run's CSV file; empty if nothing was logged, as before a critical episode."""
    data = path.read_bytes()  # polars opens paths in UTF-8 alone
    return pl.read_csv(data, infer_schema_length=None) if data.strip() else pl.DataFrame()


def draw_rewards(axis: Axes, episodes: pl.DataFrame) -> None:
    """Draw the rolling mean of an episode's reward, by agent."""
    window = min(_EPISODES, max(1, episodes.height // 5))
    for agent in AGENTS:
        rewards = _rolling(_column(episodes, agent), window)
        _line(axis, _column(episodes, "episode")[window - 1 :], rewards[window - 1 :], agent, COLOURS[agent])
    _finish(axis, f"Figure 6: episodic reward, mean of the last {window}", _BELOW, "reward of an episode")


def _draw_stage_1(axes: list[Axes], log: pl.DataFrame) -> None:
    x = _column(log, "episode")
    for agent in AGENTS:
        _line(axes[0], x, _rolling(_column(log, f"{agent}_reward")), agent, COLOURS[agent])
        _line(axes[2], x, _rolling(_column(log, f"{agent}_critic_loss")), f"{agent}'s critic", COLOURS[agent])
    for name, label in _ACTOR_LOSSES.items():
        _line(axes[3], x, _rolling(_column(log, name)), label, None)
    for name, colour in (("closed_loop_ade", ORANGE), ("reconstruction_ade", GREEN)):
        values, control = _column(log, name), _column(log, f"control_{name}")
        known = np.isfinite(values / control)
        if known.any():
            label = f"{name.removesuffix('_ade').replace('_', ' ')}, of {control[known][-1]:.3g} m"
            _line(axes[1], x[known], (values / control)[known], label, colour, marker="o")
    _level(axes[1], 1.0 if axes[1].lines else None, "last velocity repeated", GREY)
    _finish(axes[0], "rewards of the actors' own actions, rolling mean", "training episode", "reward of an interaction")
    _finish(axes[1], "ADE on held-out clips", "training episode", "share of the control's", zero=True)
    _finish(axes[2], "critics, rolling mean", "training episode", "loss", log_scale=True)
    _finish(axes[3], "actors, rolling mean", "training episode", "loss")


def _draw_stage_2(
    axes: list[Axes], log: pl.DataFrame, episodes: pl.DataFrame, held_out: dict[str, dict[str, float]]
) -> None:
    x = _column(log, "episodes")
    for agent in AGENTS:
        _line(axes[3], x, _column(log, f"{agent}_critic_loss"), f"{agent}'s critic", COLOURS[agent])
    _line(axes[3], x, _column(log, "gradient_norm"), "norm of the gradient", GREY)
    for name, colour in (("collision", ORANGE), ("goal", GREEN)):
        if f"{name}_rate" in log.columns:
            _line(axes[1], x, 100.0 * _column(log, f"{name}_rate"), name, colour)
            _level(axes[1], 100.0 * RATES[name], f"{name}, the paper's at the end", colour)
    _line(axes[2], x, _column(log, "held_out_closed_loop_ade"), "mean actors", ORANGE)
    _level(axes[2], held_out.get("stage_1", {}).get("closed_loop_ade"), "before stage 2", COLOURS["vehicle"])
    _level(axes[2], held_out.get("control", {}).get("closed_loop_ade"), "last velocity repeated", GREY)
    draw_rewards(axes[0], episodes)
    _finish(axes[1], "critical episodes under exploration, the last 1,000", _BELOW, "share [%]", zero=True)
    _finish(axes[2], "closed-loop error on held-out clips", _BELOW, "ADE [m]", zero=True)
    what = "loss, norm" if any(f"{agent}_critic_loss" in log.columns for agent in AGENTS) else "norm"
    _finish(axes[3], "last update of each portion", _BELOW, what, log_scale=True)


def _held_out(weights: Path) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = load_weights(weights).facts.get("held_out", {}) if weights.exists() else {}
    return found


def _column(log: pl.DataFrame, name: str) -> Floats:
    """Return a column, float64[rows]; NaN where there is no value, or no such column."""
    if name not in log.columns:
        return np.full(log.height, np.nan)
    values: Floats = log[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
    return values


def _rolling(values: Floats, window: int = 0) -> Floats:
    """Return the mean of the last `window` values at each row, float64[rows]; of fewer values in the first rows."""
    window = window or max(1, len(values) // _WINDOWS)
    means: Floats = pl.Series(values, dtype=pl.Float64).rolling_mean(window, min_samples=1).to_numpy()
    return means


def _line(axis: Axes, x: Floats, y: Floats, label: str, colour: str | None, marker: str = "") -> None:
    if np.isfinite(y).any():
        marker = marker or ("o" if len(x) == 1 else "")
        axis.plot(x, y, color=colour, label=label, linewidth=1.6, marker=marker, markersize=3)


def _level(axis: Axes, value: float | None, label: str, colour: str) -> None:
    if value is not None:
        axis.axhline(value, color=colour, linestyle="--", linewidth=1.1, label=label)


def _finish(axis: Axes, title: str, below: str, beside: str, *, zero: bool = False, log_scale: bool = False) -> None:
    axis.set_title(title, fontsize=10)
    axis.set_xlabel(below, fontsize=9)
    axis.set_ylabel(beside, fontsize=9)
    axis.tick_params(labelsize=8)
    axis.grid(color="#e4e4e4", linewidth=0.7)
    if not axis.lines:
        axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", color=GREY)
        return
    if log_scale:
        axis.set_yscale("log", nonpositive="clip")
    if zero:
        axis.set_ylim(bottom=0.0)
    axis.legend(fontsize=8, frameon=False)
