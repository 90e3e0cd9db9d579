"""The pictures of a report: how near they came (Figure 8), conflicts by speed (11), who gave way when (9, 12, 13)."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.mlab import GaussianKDE
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode, yields
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.section_4.bins import LEAST_IN_BIN
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.report.world_figures import GROUND, PEDESTRIAN, VEHICLE, draw_ground, outlines
from vpsci_ros.safety import CRITICAL_TTC, Yielded

Floats = NDArray[np.float64]
SHARES = Normalize(0.0, 100.0)
WARM = "YlOrRd"  # the warmer, the likelier
CONTOURS = (20.0, 40.0, 60.0, 80.0)  # [%]
_FINE = 6  # cells of a smooth surface in a bin's width
_BAND = 0.25  # [s] of the histogram


class Axis(NamedTuple):
    """A column of encounters, its name in a picture, and its bins: first, last and width."""

    column: str
    label: str
    first: float
    last: float
    width: float

    @property
    def edges(self) -> Floats:
        """Bounds of the bins."""
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
        _draw_shares(axis, table, VEHICLE_SPEED, PEDESTRIAN_SPEED, "conflict")
        axis.set_title(f"{title}, n = {table.height:,}", fontsize=9)
    _add_bar(figure, axes, "conflicts (CurvTTC < 2 s) [%]")
    save_png(figure, path)


def save_yielding(sources: Mapping[str, pl.DataFrame], agent: str, path: Path, sides: Sequence[Axis] = SIDES) -> None:
    """Draw how often `agent` yields by distance and by what both do at the onset (Figures 9, 12, 13), as a PNG.

    A row a source, or, where there is one side alone, a column.
    """
    rows, columns = (len(sources), len(sides)) if len(sides) > 1 else (1, len(sources))
    figure, axes = new_figure(3.0 * columns + 1.0, 2.75 * rows + 0.3, rows, columns)
    for row, (title, table) in zip(axes if len(sides) > 1 else axes.T, sources.items(), strict=True):
        for axis, side in zip(row, sides, strict=True):
            _draw_surface(axis, table, DISTANCE, side, f"{agent}_yields")
        row[0].set_title(f"{title}, n = {table.height:,}", fontsize=9, loc="left")
    _add_bar(figure, axes, f"{agent} yields [%]")
    save_png(figure, path)


def shares(table: pl.DataFrame, across: Axis, up: Axis, flag: str) -> Floats:
    """Return the share of `flag` in each bin, float64[bins of across, bins of up]; NaN below `LEAST_IN_BIN`."""
    x, y = (table[axis.column].to_numpy() for axis in (across, up))
    bins = (across.edges, up.edges)
    count, _, _ = np.histogram2d(x, y, bins=bins)
    hits, _, _ = np.histogram2d(x, y, bins=bins, weights=table[flag].to_numpy().astype(np.float64))
    return np.where(count >= LEAST_IN_BIN, hits / np.maximum(count, 1.0), np.nan)


def surface(table: pl.DataFrame, across: Axis, up: Axis, flag: str) -> tuple[Floats, Floats, Floats]:
    """Return a smooth share of `flag`, float64[points across, points up], and both coordinates of its points.

    Kernel regression (Nadaraya and Watson) by a Gaussian of half a bin's width, of `_FINE` cells a bin; NaN where fewer
    than `LEAST_IN_BIN` interactions stand behind a value, (4 pi sx sy) times their density.
    """
    edges = [np.arange(axis.first, axis.last + 0.5 * axis.width / _FINE, axis.width / _FINE) for axis in (across, up)]
    x, y = (table[axis.column].to_numpy() for axis in (across, up))
    weights = table[flag].to_numpy().astype(np.float64)
    count, hits = (np.histogram2d(x, y, bins=edges, weights=w)[0] for w in (None, weights))
    spread = 0.5 * _FINE
    behind, share = (gaussian_filter(values, spread, mode="constant") for values in (count, hits))
    enough = 4.0 * np.pi * spread**2 * behind >= LEAST_IN_BIN
    found = np.where(enough, share / np.where(enough, behind, 1.0), np.nan)
    along, high = (0.5 * (each[1:] + each[:-1]) for each in edges)
    return found, along, high


def _draw_surface(axis: Axes, table: pl.DataFrame, across: Axis, up: Axis, flag: str) -> None:
    share, along, high = surface(table, across, up, flag)
    axis.set_facecolor("#ececea")
    axis.pcolormesh(along, high, 100.0 * share.T, norm=SHARES, cmap=WARM, shading="nearest")
    known = 100.0 * share[np.isfinite(share)]
    if levels := [level for level in CONTOURS if known.size and known.min() < level < known.max()]:
        lines = axis.contour(along, high, 100.0 * share.T, levels=levels, colors="black", linewidths=0.9)
        axis.clabel(lines, fmt="%g%%", fontsize=6)
    _label(axis, across, up)
    axis.set_xlim(across.first, across.last)
    axis.set_ylim(up.first, up.last)


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


def _draw_shares(axis: Axes, table: pl.DataFrame, across: Axis, up: Axis, flag: str) -> None:
    axis.set_facecolor("#ececea")
    share = 100.0 * shares(table, across, up, flag)
    axis.pcolormesh(across.edges, up.edges, share.T, norm=SHARES, cmap=WARM)
    _label(axis, across, up)


def _label(axis: Axes, across: Axis, up: Axis) -> None:
    axis.set_xlabel(across.label, fontsize=8)
    axis.set_ylabel(up.label, fontsize=8)
    axis.tick_params(labelsize=7)


def _add_bar(figure: Figure, axes: NDArray[np.object_], label: str) -> None:
    bar = figure.colorbar(ScalarMappable(SHARES, WARM), ax=axes, shrink=0.8, pad=0.01)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)


# ---- Sequential snapshots in the manner of the paper's Figure 5: a row an episode, from the approach to the
# clearance.


STAGES = ("approach", "entry", "critical", "clearance")
HALF = 12.0  # [m] half a panel's width
_BEFORE = 1.0  # [s] from the approach to the entry
_EDGE = 2.0  # [m] from a panel's edge


def save_snapshots(episodes: Sequence[tuple[str, Episode]], path: str | Path) -> None:
    """Draw four moments of each episode under its title, and write them as a PNG, whole or not at all.

    :raises InvalidInput: no episode, or the folder of `path` does not exist.
    """
    if not episodes:
        raise InvalidInput(f"{path}: expected at least one interaction to draw, got none")
    figure, axes = new_figure(2.5 * len(STAGES), 2.75 * len(episodes), len(episodes), len(STAGES))
    for row, (title, episode) in zip(axes, episodes, strict=True):
        pair = episode.pair().filled()
        at, middle = moments(pair)
        for axis, stage, frame in zip(row, STAGES, at, strict=True):
            _draw(axis, pair, frame, middle)
            axis.set_title(f"{stage}, {frame * pair.period:.1f} s", fontsize=7)
        row[0].set_ylabel(title, fontsize=7)
    save_png(figure, path, 110)


def moments(pair: Episode) -> tuple[tuple[int, int, int, int], tuple[float, float]]:
    """Return the frames of the four stages, and the middle of the picture [m], halfway between both at the third.

    They are 1 s before CurvTTC falls below 5 s, then, at its least, and when both are within the picture for the last
    time. An episode that never is critical has its least CurvTTC, or least distance, in the place of the first ones.
    """
    ttc = pair.known_curvttc[0]
    least = int(ttc.argmin()) if np.isfinite(ttc).any() else int(pair.distance[0].argmin())
    critical = np.flatnonzero(ttc < CRITICAL_TTC)
    first = int(critical[0]) if len(critical) else least
    x, y = 0.5 * (pair.ped_x[0, least] + pair.x[least]), 0.5 * (pair.ped_y[0, least] + pair.y[least])
    off = np.abs([pair.x - x, pair.y - y, pair.ped_x[0] - x, pair.ped_y[0] - y]).max(axis=0)
    last = max(int(np.flatnonzero(off < HALF - _EDGE)[-1]), least) if (off < HALF - _EDGE).any() else least
    return (max(first - round(_BEFORE / pair.period), 0), first, least, last), (float(x), float(y))


def _draw(axis: Axes, pair: Episode, frame: int, middle: tuple[float, float]) -> None:
    axis.set_facecolor(GROUND)
    axis.set_aspect("equal")
    axis.set(xticks=[], yticks=[])
    if pair.scenario is not None:
        draw_ground(axis, pair.scenario)
    until = slice(0, frame + 1)
    axis.plot(pair.x[until], pair.y[until], color=VEHICLE, linewidth=1.4, alpha=0.5)
    axis.plot(pair.ped_x[0, until], pair.ped_y[0, until], color=PEDESTRIAN, linewidth=1.4, alpha=0.5)
    box: NDArray[Any] = np.array([[pair.x[frame], pair.y[frame], pair.heading[frame], pair.length, pair.width]])
    (rectangle,) = outlines(np.nan_to_num(box))
    axis.add_patch(Polygon(rectangle, closed=True, facecolor=VEHICLE, edgecolor="white", linewidth=0.6, zorder=4))
    person = pair.ped_x[0, frame], pair.ped_y[0, frame]
    axis.add_patch(Circle(person, 2.0 * pair.radius, facecolor=PEDESTRIAN, edgecolor="white", linewidth=0.6, zorder=5))
    ttc = pair.known_curvttc[0, frame]
    speeds = f"{pair.speed[frame]:.1f}, {np.hypot(pair.ped_vx[0, frame], pair.ped_vy[0, frame]):.1f} m/s"
    text = f"CurvTTC {ttc:.1f} s\n{speeds}" if np.isfinite(ttc) else speeds
    axis.text(0.03, 0.97, text, transform=axis.transAxes, va="top", fontsize=6, zorder=6)
    axis.set_xlim(middle[0] - HALF, middle[0] + HALF)
    axis.set_ylim(middle[1] - HALF, middle[1] + HALF)


# ---- Which episodes a picture shows: one of each scenario, typical in how near it came and in who gave way.


MOST = 512  # episodes of a scenario among which the typical one is looked for
YIELD_NAMES = {
    Yielded.VEHICLE: "Vehicle-yield",
    Yielded.PEDESTRIAN: "Pedestrian-yield",
    Yielded.BOTH: "Both yield",
    Yielded.NONE: "Nobody yields",
}
_NUMBERS = "①②③④⑤⑥⑦⑧"


def typical_episodes(dataset: Dataset | str | Path) -> list[tuple[str, Episode]]:
    """Return title and episode for each scenario of a dataset that has a kept episode.

    Taken is, among the episodes with the scenario's most frequent kind of yielding (none at all only where there is
    nothing else), the one whose least CurvTTC lies nearest to their median; looked for among the first `MOST`.

    :raises InvalidInput: the folder is no dataset, or not a single episode was kept.
    """
    data = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    kept = (list(itertools.islice(data.read(scenario=name), MOST)) for name in data.scenarios)
    found = [_typical(episodes) for episodes in kept if episodes]
    if not found:
        raise InvalidInput(f"{data.folder}: no episode was kept, so there is nothing to draw; simulate more episodes")
    return found


def _typical(episodes: Sequence[Episode]) -> tuple[str, Episode]:
    codes = yields(episodes)
    counts = np.bincount(codes, minlength=4)
    counts[Yielded.NONE] = min(counts[Yielded.NONE], 0 if counts[1:].any() else 1)
    candidates = np.flatnonzero(codes == counts.argmax())
    least = np.array([episodes[i].least_curvttc for i in candidates.tolist()])
    i = int(candidates[np.abs(least - np.median(least)).argmin()])
    one, number = episodes[i], episodes[i].key[0]
    sign = _NUMBERS[number - 1] if 1 <= number <= len(_NUMBERS) else f"({number})"
    how = f"{YIELD_NAMES[Yielded(codes[i])]}, episode {one.number}, least CurvTTC {one.least_curvttc:.2f} s"
    return f"{sign} {one.group}\n{how}", one
