"""Sequential snapshots in the manner of the paper's Figure 5: a row an episode, from the approach to the clearance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.report.world_figures import GROUND, PEDESTRIAN, VEHICLE, draw_ground, outlines
from vpsci_ros.safety import CRITICAL_TTC

STAGES = ("approach", "entry", "critical", "clearance")
HALF = 12.0  # [m] half a panel's width
_BEFORE = 1.0  # [s] from the approach to the entry
_EDGE = 2.0  # [m] from a panel's edge


def save_snapshots(episodes: Sequence[tuple[str, Episode]], path: str | Path) -> None:
    """Draw four frames of each episode under its title, and write them as a PNG, whole or not at all.

    :param episodes: at least one.
    :raises InvalidInput: the folder of `path` does not exist.
    """
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
    """Return the frames of the four stages, and the picture's centre [m]: between both agents at the third stage.

    The stages: 1 s before CurvTTC falls below 5 s, when it falls below, at its least, and when both agents are within
    the picture for the last time. In an episode that is never critical, the least CurvTTC (or, without any, the least
    distance) stands for the fall below 5 s.
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
