"""Trajectories in the manner of the paper's Figure 7: vehicle blue, pedestrian red, the darker the faster.

Nearly white is nearly standing, so a white stretch is a yield. A green circle is where an agent starts, an arrow shows
its direction, a thin outline where both are at the least CurvTTC; lane and crosswalk lie grey underneath.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Polygon
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.panels import Panel
from vpsci_ros.report.world_figures import draw_parked
from vpsci_ros.runs.files import written_whole
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import Scenario

Floats = NDArray[np.float64]
TOP_SPEED = 8.0  # [m/s] at which the colours are darkest
BLUES = LinearSegmentedColormap.from_list("vehicle", ["#ffffff", "#9ecae1", "#3182bd", "#08306b"])
REDS = LinearSegmentedColormap.from_list("pedestrian", ["#ffffff", "#fcae91", "#de2d26", "#67000d"])
GROUND, ROAD, MARKING, START = "#f1f1ee", "#d5d5d2", "#fafafa", "#2ca02c"
_SPEEDS = Normalize(0.0, TOP_SPEED)
_COLUMNS = 4


def save_trajectories(panels: Sequence[Panel], scenarios: Iterable[Scenario], path: str | Path) -> None:
    """Draw the panels, four a row, and write them as a PNG, whole or not at all.

    :param scenarios: lanes and crosswalks, found by number; a panel without one is drawn on bare ground.
    :raises InvalidInput: no panel, or the folder of `path` does not exist.
    """
    if not panels:
        raise InvalidInput(f"{path}: expected at least one interaction to draw, got none")
    grounds = {scenario.number: scenario for scenario in scenarios}
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.9 * columns, 4.0 * rows + 0.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis, one in zip(axes.flat, panels, strict=False):
        draw_panel(axis, one, grounds.get(one.scenario))
    for axis in axes.flat[len(panels) :]:
        axis.set_axis_off()
    half = columns // 2
    draw_speed_bars(figure, axes[:, : max(half, 1)], axes[:, half:])
    with written_whole(path) as part:
        figure.savefig(part, format="png", dpi=130)


def draw_speed_bars(figure: Figure, below_first: Any, below_second: Any) -> None:
    """Draw the colour bars of vehicle and pedestrian speed below these axes."""
    beside = ((BLUES, "vehicle speed [m/s]", below_first), (REDS, "pedestrian speed [m/s]", below_second))
    for colours, name, over in beside:
        bar = figure.colorbar(
            ScalarMappable(_SPEEDS, colours), ax=over, location="bottom", shrink=0.6, aspect=40, pad=0.02
        )
        bar.set_label(name, fontsize=8)
        bar.ax.tick_params(labelsize=7)


def draw_panel(axis: Axes, one: Panel, ground: Scenario | None) -> None:
    """Draw one interaction on its ground, with speed as colour; bare ground where there is no scenario."""
    axis.set_facecolor(GROUND)
    axis.set_aspect("equal")
    axis.set_title(one.title, fontsize=8)
    axis.tick_params(labelsize=6)
    axis.set_xlabel("x [m]", fontsize=7)
    axis.set_ylabel("y [m]", fontsize=7)
    if ground is not None:
        _draw_ground(axis, ground)
    _draw_path(axis, one.vehicle, one.vehicle_speed, BLUES, "#08306b")
    walkers = [(one.pedestrian, one.pedestrian_speed), *one.others]
    for way, speed in walkers:
        _draw_path(axis, way, speed, REDS, "#67000d")
    _draw_outlines(axis, one)
    for begin in (one.vehicle[0], *(way[0] for way, _ in walkers)):
        axis.plot(*begin, "o", color=START, markersize=6, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
    _frame(axis, np.concatenate([one.vehicle, *(way for way, _ in walkers)]))


def _draw_ground(axis: Axes, ground: Scenario) -> None:
    lane = _band(ground.vehicle.path.points, ground.vehicle.lane_width)
    axis.add_patch(Polygon(lane, closed=True, facecolor=ROAD, edgecolor="none", zorder=0))
    if len(ground.crosswalk):
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "#b4b4b0", "hatch": "////", "linewidth": 0.8}
        axis.add_patch(Polygon(ground.crosswalk, closed=True, zorder=0.5, **look))
    draw_parked(axis, ground)


def _band(points: Floats, width: float) -> Floats:
    """Return the outline of a band of `width` [m] along points float64[K, 2]."""
    along = np.gradient(points, axis=0)
    left = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    return np.concatenate([points + 0.5 * width * left, (points - 0.5 * width * left)[::-1]])


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


def _draw_outlines(axis: Axes, one: Panel) -> None:
    k = one.nearest
    cos, sin = np.cos(one.heading[k]), np.sin(one.heading[k])
    corners = 0.5 * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [VEHICLE_LENGTH, VEHICLE_WIDTH]
    rectangle = corners @ np.array([[cos, sin], [-sin, cos]]) + one.vehicle[k]
    look: dict[str, Any] = {"facecolor": "none", "linewidth": 0.9, "zorder": 4}
    axis.add_patch(Polygon(rectangle, closed=True, edgecolor="#08306b", **look))
    for way in (one.pedestrian, *(way for way, _ in one.others)):
        axis.add_patch(Circle((way[k, 0], way[k, 1]), PEDESTRIAN_RADIUS, edgecolor="#67000d", **look))


def _frame(axis: Axes, points: Floats, margin: float = 3.5) -> None:
    """Show all points in a square window."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * float((high - low).max()) + margin
    centre = 0.5 * (low + high)
    axis.set_xlim(centre[0] - half, centre[0] + half)
    axis.set_ylim(centre[1] - half, centre[1] + half)
