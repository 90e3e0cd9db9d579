"""Pictures of a report: least CurvTTC (Figure 8), conflicts by speed (Figure 11), yielding (Figures 9, 12, 13)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.mlab import GaussianKDE
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from vpsci_ros.extras.paper.section_4.bins import LEAST_IN_BIN
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.safety import CRITICAL_TTC

Floats = NDArray[np.float64]
SHARES = Normalize(0.0, 100.0)
WARM = "YlOrRd"  # the warmer, the likelier
CONTOURS = (20.0, 40.0, 60.0, 80.0)  # [%]
_FINE = 6  # cells of a smooth surface in a bin's width
_BAND = 0.25  # [s] of the histogram


class Axis(NamedTuple):
    """A column of `encounters.SCHEMA`, its name in a picture, and its bins: first and last bound, and width."""

    column: str
    label: str
    first: float
    last: float
    width: float

    @property
    def edges(self) -> Floats:
        """The bounds of the axis's bins."""
        return np.arange(self.first, self.last + 0.5 * self.width, self.width)


VEHICLE_SPEED = Axis("vehicle_speed", "vehicle speed [m/s]", 0.0, 5.0, 0.5)
PEDESTRIAN_SPEED = Axis("pedestrian_speed", "pedestrian speed [m/s]", 0.0, 4.0, 0.5)
DISTANCE = Axis("distance", "distance [m]", 0.0, 27.0, 3.0)
SIDES = (
    VEHICLE_SPEED,
    Axis("vehicle_acceleration", "vehicle acceleration [m/s²]", -2.5, 2.5, 0.5),
    PEDESTRIAN_SPEED,
    Axis("pedestrian_acceleration", "pedestrian acceleration [m/s²]", -2.5, 3.0, 0.5),
)


def save_nearness(sources: Mapping[str, pl.DataFrame], path: Path) -> None:
    """Draw the distribution of the least CurvTTC of each source, in the manner of Figure 8, as a PNG.

    :param sources: title -> encounters, at least one row each.
    """
    figure, axes = new_figure(3.7 * len(sources), 3.9, 1, len(sources), sharey=True)
    for axis, (title, table) in zip(axes.flat, sources.items(), strict=True):
        _draw_nearness(axis, table["least_curvttc"].to_numpy(), title)
    axes[0, 0].set_ylabel("least CurvTTC [s]", fontsize=8)
    save_png(figure, path)


def save_conflicts(sources: Mapping[str, pl.DataFrame], path: Path) -> None:
    """Draw the share of conflicts by the speeds at the onset, in the manner of Figure 11, as a PNG."""
    figure, axes = new_figure(3.7 * len(sources) + 0.8, 3.7, 1, len(sources))
    for axis, (title, table) in zip(axes.flat, sources.items(), strict=True):
        _draw_conflicts(axis, table)
        axis.set_title(f"{title}, n = {table.height:,}", fontsize=9)
    _add_bar(figure, axes, "conflicts (CurvTTC < 2 s) [%]")
    save_png(figure, path)


def save_yielding(sources: Mapping[str, pl.DataFrame], agent: str, path: Path, sides: Sequence[Axis] = SIDES) -> None:
    """Draw how often `agent` yields, by distance and each of `sides` at the onset (Figures 9, 12, 13), as a PNG.

    A row a source, or, where there is one side alone, a column.
    """
    rows, columns = (len(sources), len(sides)) if len(sides) > 1 else (1, len(sources))
    figure, axes = new_figure(3.0 * columns + 1.0, 2.75 * rows + 0.3, rows, columns)
    for row, (title, table) in zip(axes if len(sides) > 1 else axes.T, sources.items(), strict=True):
        for axis, side in zip(row, sides, strict=True):
            _draw_surface(axis, table, side, f"{agent}_yields")
        row[0].set_title(f"{title}, n = {table.height:,}", fontsize=9, loc="left")
    _add_bar(figure, axes, f"{agent} yields [%]")
    save_png(figure, path)


def surface(table: pl.DataFrame, side: Axis, flag: str) -> tuple[Floats, Floats, Floats]:
    """Return a smooth share of `flag` by `DISTANCE` and `side`, float64[X, Y], and both coordinates of its points.

    Kernel regression (Nadaraya and Watson) by a Gaussian of half a bin's width, of `_FINE` cells a bin; NaN where fewer
    than `LEAST_IN_BIN` interactions stand behind a value, (4 pi sx sy) times their density.
    """
    axes = DISTANCE, side
    edges = [np.arange(axis.first, axis.last + 0.5 * axis.width / _FINE, axis.width / _FINE) for axis in axes]
    x, y = (table[axis.column].to_numpy() for axis in axes)
    weights = table[flag].to_numpy().astype(np.float64)
    count, hits = (np.histogram2d(x, y, bins=edges, weights=w)[0] for w in (None, weights))
    spread = 0.5 * _FINE
    behind, share = (gaussian_filter(values, spread, mode="constant") for values in (count, hits))
    enough = 4.0 * np.pi * spread**2 * behind >= LEAST_IN_BIN
    found = np.where(enough, share / np.where(enough, behind, 1.0), np.nan)
    along, high = (0.5 * (each[1:] + each[:-1]) for each in edges)
    return found, along, high


def _draw_surface(axis: Axes, table: pl.DataFrame, side: Axis, flag: str) -> None:
    share, along, high = surface(table, side, flag)
    axis.set_facecolor("#ececea")
    axis.pcolormesh(along, high, 100.0 * share.T, norm=SHARES, cmap=WARM, shading="nearest")
    known = 100.0 * share[np.isfinite(share)]
    if levels := [level for level in CONTOURS if known.size and known.min() < level < known.max()]:
        lines = axis.contour(along, high, 100.0 * share.T, levels=levels, colors="black", linewidths=0.9)
        axis.clabel(lines, fmt="%g%%", fontsize=6)
    _label(axis, DISTANCE, side)
    axis.set_xlim(DISTANCE.first, DISTANCE.last)
    axis.set_ylim(side.first, side.last)


def _draw_nearness(axis: Axes, least: Floats, title: str) -> None:
    """Draw a density curve to the left of 0 and a histogram to the right; lines are quartiles."""
    if np.ptp(least) > 0.0:
        at = np.linspace(0.0, CRITICAL_TTC, 200)
        density = GaussianKDE(least)(at)
        axis.fill_betweenx(at, -density, 0.0, color="#9ecae1", linewidth=0.0)
    bins = np.arange(0.0, CRITICAL_TTC + _BAND, _BAND)
    height, _ = np.histogram(least, bins=bins, density=True)
    axis.barh(bins[:-1], height, height=0.9 * _BAND, align="edge", color="#3182bd")
    low, median, high = np.quantile(least, (0.25, 0.5, 0.75))
    for value, colour in ((low, "#222222"), (median, "#c00000"), (high, "#222222")):
        axis.axhline(value, color=colour, linewidth=1.2)
    axis.set_title(f"{title}, n = {len(least):,}\n{low:.2f}, {median:.2f}, {high:.2f} s", fontsize=9)
    axis.set_ylim(0.0, CRITICAL_TTC)
    axis.set_xlabel("density [1/s]", fontsize=8)
    axis.xaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    axis.tick_params(labelsize=7)


def _draw_conflicts(axis: Axes, table: pl.DataFrame) -> None:
    """Draw the share of conflicts in each bin of both speeds, grey below `LEAST_IN_BIN` interactions."""
    axes = VEHICLE_SPEED, PEDESTRIAN_SPEED
    x, y = (table[each.column].to_numpy() for each in axes)
    conflict, bins = table["conflict"].to_numpy().astype(np.float64), [each.edges for each in axes]
    count, hits = (np.histogram2d(x, y, bins=bins, weights=weights)[0] for weights in (None, conflict))
    share = np.where(count >= LEAST_IN_BIN, hits / np.maximum(count, 1.0), np.nan)
    axis.set_facecolor("#ececea")
    axis.pcolormesh(*bins, 100.0 * share.T, norm=SHARES, cmap=WARM)
    _label(axis, *axes)


def _label(axis: Axes, across: Axis, up: Axis) -> None:
    axis.set_xlabel(across.label, fontsize=8)
    axis.set_ylabel(up.label, fontsize=8)
    axis.tick_params(labelsize=7)


def _add_bar(figure: Figure, axes: NDArray[np.object_], label: str) -> None:
    bar = figure.colorbar(ScalarMappable(SHARES, WARM), ax=axes, shrink=0.8, pad=0.01)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)
