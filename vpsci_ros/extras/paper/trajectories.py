"""Trajectories in the manner of the paper's Figure 7: vehicle blue, pedestrian red, the darker the faster.

Nearly white is nearly standing, so a white stretch is a yield. A green circle is where an agent starts, an arrow shows
its direction, a thin outline where both are at the least CurvTTC; lane and crosswalk lie grey underneath.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.report.canvas import new_figure, save_png, show_all
from vpsci_ros.report.world_figures import GROUND, draw_ground, outlines

Floats = NDArray[np.float64]
TOP_SPEED = 8.0  # [m/s] at which the colours are darkest
BLUES = LinearSegmentedColormap.from_list("vehicle", ["#ffffff", "#9ecae1", "#3182bd", "#08306b"])
REDS = LinearSegmentedColormap.from_list("pedestrian", ["#ffffff", "#fcae91", "#de2d26", "#67000d"])
START = "#2ca02c"
_SPEEDS = Normalize(0.0, TOP_SPEED)
_COLUMNS = 4


def save_trajectories(episodes: Sequence[tuple[str, Episode]], path: str | Path) -> None:
    """Draw episodes under their titles, four a row, and write them as a PNG, whole or not at all.

    :param episodes: at least one.
    :raises InvalidInput: the folder of `path` does not exist.
    """
    columns = min(_COLUMNS, len(episodes))
    rows = -(-len(episodes) // columns)
    figure, axes = new_figure(3.9 * columns, 4.0 * rows + 0.9, rows, columns)
    for axis, (title, episode) in zip(axes.flat, episodes, strict=False):
        draw_episode(axis, title, episode)
    for axis in axes.flat[len(episodes) :]:
        axis.set_axis_off()
    half = columns // 2
    draw_speed_bars(figure, axes[:, : max(half, 1)], axes[:, half:])
    save_png(figure, path)


def draw_speed_bars(figure: Figure, below_first: Any, below_second: Any) -> None:
    """Draw the colour bar of the vehicle's speed below the first axes, and of the pedestrian's below the second."""
    beside = ((BLUES, "vehicle speed [m/s]", below_first), (REDS, "pedestrian speed [m/s]", below_second))
    for colours, name, over in beside:
        bar = figure.colorbar(
            ScalarMappable(_SPEEDS, colours), ax=over, location="bottom", shrink=0.6, aspect=40, pad=0.02
        )
        bar.set_label(name, fontsize=8)
        bar.ax.tick_params(labelsize=7)


def draw_episode(axis: Axes, title: str, episode: Episode) -> None:
    """Draw an episode over its scenario's lane and crosswalk (if it has a scenario), with speed as colour.

    Frames that nobody saw are drawn as the last one seen.
    """
    one = episode.filled()
    axis.set_facecolor(GROUND)
    axis.set_aspect("equal")
    axis.set_title(title, fontsize=8)
    axis.tick_params(labelsize=6)
    axis.set_xlabel("x [m]", fontsize=7)
    axis.set_ylabel("y [m]", fontsize=7)
    if one.scenario is not None:
        draw_ground(axis, one.scenario)
    vehicle = np.column_stack([one.x, one.y])
    walks = np.stack([one.ped_x, one.ped_y], axis=-1)
    _draw_path(axis, vehicle, one.speed, BLUES, "#08306b")
    for walk, speed in zip(walks, np.hypot(one.ped_vx, one.ped_vy), strict=True):
        _draw_path(axis, walk, speed, REDS, "#67000d")
    _draw_outlines(axis, one)
    for begin in (vehicle[0], *walks[:, 0]):
        axis.plot(*begin, "o", color=START, markersize=6, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
    show_all(axis, np.concatenate([vehicle, *walks]), 3.5)


def _draw_path(axis: Axes, points: Floats, speed: Floats, colours: LinearSegmentedColormap, edge: str) -> None:
    segments = np.stack([points[:-1], points[1:]], axis=1)
    axis.plot(
        *points.T, color=edge, linewidth=4.6, solid_capstyle="round", snap=False, zorder=2
    )  # so that white shows on white
    middle = 0.5 * (speed[:-1] + speed[1:])
    line = LineCollection(list(segments), cmap=colours, norm=_SPEEDS, linewidths=3.6, zorder=3, capstyle="round")
    line.set_array(middle)
    line.set_snap(False)
    axis.add_collection(line)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    if length[-1] > 1.0:
        for share in (0.35, 0.97):
            tail, tip = (_point_at(points, length, share * length[-1] + ahead) for ahead in (-0.4, 0.4))
            arrow = FancyArrowPatch(tail, tip, arrowstyle="-|>", mutation_scale=13, color=edge, linewidth=0.0, zorder=5)
            axis.add_patch(arrow)


def _point_at(points: Floats, length: Floats, at: float) -> tuple[float, float]:
    return float(np.interp(at, length, points[:, 0])), float(np.interp(at, length, points[:, 1]))


def _draw_outlines(axis: Axes, one: Episode) -> None:
    k = int(one.known_curvttc.min(axis=0).argmin())
    (rectangle,) = outlines(np.array([[one.x[k], one.y[k], one.heading[k], one.length, one.width]]))
    look: dict[str, Any] = {"facecolor": "none", "linewidth": 0.9, "zorder": 4}
    axis.add_patch(Polygon(rectangle, closed=True, edgecolor="#08306b", **look))
    for x, y in zip(one.ped_x[:, k], one.ped_y[:, k], strict=True):
        axis.add_patch(Circle((x, y), one.radius, edgecolor="#67000d", **look))
