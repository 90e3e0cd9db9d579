"""One episode of a bag as a picture: all ways on the scenario's ground, CurvTTC, speeds and distance over time.

Of several pedestrians CurvTTC and distance are the least at each time.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import BagEpisode, bag_episodes, chosen_episode, read_episodes
from vpsci_ros.bags.reader import Bag, opened
from vpsci_ros.data.episode import Episode
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.canvas import blank_figure, save_png
from vpsci_ros.report.trajectories import draw_episode, draw_speed_bars
from vpsci_ros.safety import CRITICAL_TTC, HORIZON

VEHICLE, PEDESTRIAN, TTC, CONTROLLED = "#08519c", "#a50f15", "#333333", "#fee8c8"
Floats = NDArray[np.float64]


def save_episode(bag: str | Path | Bag, episode: str, path: str | Path) -> BagEpisode:
    """Draw an episode and write it as a PNG, whole or not at all; return what was drawn.

    :param episode: "12" or "6:12".
    :raises InvalidInput: no such bag or episode, or the folder of `path` does not exist.
    """
    bag = opened(bag)
    one = chosen_episode(bag_episodes(bag), episode)
    found = next(read_episodes(bag, [one]), None)
    frames = 0 if found is None else len(found)
    if found is None or frames < 2:
        raise InvalidInput(f"{bag}: episode {episode} has {frames} frames in the bag, expected at least two to draw")
    drawn = found.filled()
    time = drawn.time

    figure = blank_figure(11.5, 6.6)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.15, 1.0))
    where = figure.add_subplot(grid[:, 0])
    draw_episode(where, _title(drawn), drawn)
    series: list[Axes] = []
    for row in range(3):
        series.append(figure.add_subplot(grid[row, 1], sharex=series[0] if series else None))
    draw_speed_bars(figure, where, series)
    _draw_curvttc(series[0], time, drawn.known_curvttc.min(axis=0))
    _draw_speeds(series[1], drawn)
    series[2].plot(time, np.fmin.reduce(drawn.distance), color=TTC, linewidth=1.4)
    series[2].set_ylabel("distance of centres [m]", fontsize=8)
    series[2].set_ylim(bottom=0.0)
    series[2].set_xlabel("time since the spawn [s]", fontsize=8)
    for axis in series:
        _mark(axis, drawn)
    series[0].legend(fontsize=7, loc="upper right")
    series[1].legend(handles=series[1].get_lines()[:2], fontsize=7, loc="upper right")
    save_png(figure, path, 120)
    return one


def _title(episode: Episode) -> str:
    least = episode.least_curvttc
    how = "outcome unknown" if episode.outcome == "none" else episode.outcome
    near = f"least CurvTTC {least:.2f} s" if np.isfinite(least) else "never critical"
    place = episode.scenario.name if episode.scenario else "recorded odometry"
    return f"{place}, episode {episode.name}\n{how}, {near}"


def _draw_curvttc(axis: Axes, time: Floats, curvttc: Floats) -> None:
    axis.plot(time, np.where(np.isfinite(curvttc), curvttc, np.nan), color=TTC, linewidth=1.4)
    axis.axhline(
        CRITICAL_TTC, color="#888888", linewidth=0.9, linestyle="--", label=f"critical below {CRITICAL_TTC:g} s"
    )
    axis.set_ylim(0.0, HORIZON)
    axis.set_ylabel("CurvTTC [s]", fontsize=8)
    if not np.isfinite(curvttc).any():
        axis.text(0.5, 0.3, "no contact ahead at any time", transform=axis.transAxes, ha="center", fontsize=8)


def _draw_speeds(axis: Axes, episode: Episode) -> None:
    axis.plot(episode.time, episode.speed, color=VEHICLE, linewidth=1.4, label="vehicle")
    several = episode.pedestrians > 1
    for n, walking in enumerate(np.hypot(episode.ped_vx, episode.ped_vy)):
        label = ("pedestrians" if several else "pedestrian") if n == 0 else "_"
        axis.plot(episode.time, walking, color=PEDESTRIAN, linewidth=0.9 if several else 1.4, label=label)
    axis.set_ylabel("speed [m/s]", fontsize=8)
    axis.set_ylim(bottom=0.0)


def _mark(axis: Axes, episode: Episode) -> None:
    """Shade when the policies control the agents; the same look for all series."""
    time, controlled = episode.time, episode.controlled.any(axis=0)
    if controlled.any():
        low, high = axis.get_ylim()
        where, label = controlled.tolist(), "the policies drive"
        axis.fill_between(time, low, high, where=where, color=CONTROLLED, linewidth=0.0, zorder=0, label=label)
        axis.set_ylim(low, high)
    axis.set_xlim(0.0, time[-1])
    axis.tick_params(labelsize=7)
    axis.grid(linewidth=0.4, color="#dddddd")
    axis.set_axisbelow(True)
