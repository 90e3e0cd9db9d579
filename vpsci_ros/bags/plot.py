"""One episode of a bag as a picture: all ways on the scenario's ground, CurvTTC, speeds and distance over time.

Of several pedestrians CurvTTC and distance are the least at each time.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import BagEpisode, bag_episodes, chosen_episode, episode_ticks
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.tick import RecordedTick
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.panels import Panel
from vpsci_ros.report.trajectories import draw_panel, draw_speed_bars
from vpsci_ros.runs.files import written_whole
from vpsci_ros.safety import CRITICAL_TTC, HORIZON
from vpsci_ros.world.scenario import every_scenario

VEHICLE, PEDESTRIAN, TTC, HELD = "#08519c", "#a50f15", "#333333", "#fee8c8"
Floats = NDArray[np.float64]


def save_episode(bag: str | Path, episode: str, path: str | Path, *, recover: bool = False) -> BagEpisode:
    """Draw an episode and write it as a PNG, whole or not at all; return what was drawn.

    :param episode: "12" or "6:12".
    :raises InvalidInput: no such bag or episode, or the folder of `path` does not exist.
    """
    one = chosen_episode(bag_episodes(Bag(bag, recover=recover), recover=recover), episode)
    ticks = list(episode_ticks(bag, one, recover=recover))
    if len(ticks) < 2:
        raise InvalidInput(
            f"{bag}: episode {episode} has {len(ticks)} frames in the bag, expected at least two to draw"
        )
    state = np.stack([tick.state for tick in ticks])  # [T, pedestrians]
    curvttc, distance = (np.stack([getattr(tick, name) for tick in ticks]) for name in ("curvttc", "distance"))
    curvttc = np.where(np.isnan(curvttc), np.inf, curvttc)
    time = _time(ticks)
    own = bag_run(Bag(bag, recover=recover)).own_scenarios
    scenarios = {scenario.number: scenario for scenario in every_scenario(own, str(bag))}
    ground = scenarios.get(one.scenario)

    figure = Figure(figsize=(11.5, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.15, 1.0))
    where = figure.add_subplot(grid[:, 0])
    draw_panel(where, _panel(one, state, curvttc, ground.name if ground else "recorded odometry"), ground)
    series: list[Axes] = []
    for row in range(3):
        series.append(figure.add_subplot(grid[row, 1], sharex=series[0] if series else None))
    draw_speed_bars(figure, where, series)
    _draw_curvttc(series[0], time, curvttc.min(axis=1))
    _draw_speeds(series[1], time, state)
    series[2].plot(time, np.fmin.reduce(distance, axis=1), color=TTC, linewidth=1.4)
    series[2].set_ylabel("distance of centres [m]", fontsize=8)
    series[2].set_ylim(bottom=0.0)
    series[2].set_xlabel("time since the spawn [s]", fontsize=8)
    for axis in series:
        _mark(axis, time, state)
    series[0].legend(fontsize=7, loc="upper right")
    series[1].legend(handles=series[1].get_lines()[:2], fontsize=7, loc="upper right")
    with written_whole(path) as part:
        figure.savefig(part, format="png", dpi=120)
    return one


def _time(ticks: list[RecordedTick]) -> Floats:
    frames = np.array([int(tick.state["frame"][0]) for tick in ticks], np.float64)
    return frames * ticks[0].period


def _panel(one: BagEpisode, state: NDArray[np.void], curvttc: Floats, name: str) -> Panel:
    least = f"least CurvTTC {one.least_curvttc:.2f} s" if np.isfinite(one.least_curvttc) else "never critical"
    how = "outcome unknown" if one.outcome == "none" else one.outcome
    nearest, faced = (int(place) for place in np.unravel_index(curvttc.argmin(), curvttc.shape))
    ways = np.stack([state["pedestrian_x"], state["pedestrian_y"]], axis=-1)
    speeds = np.hypot(state["pedestrian_vx"], state["pedestrian_vy"])
    return Panel(
        title=f"{name}, episode {one.name}\n{how}, {least}",
        scenario=one.scenario,
        vehicle=np.column_stack([state["vehicle_x"][:, 0], state["vehicle_y"][:, 0]]),
        vehicle_speed=state["vehicle_speed"][:, 0].copy(),
        heading=state["vehicle_heading"][:, 0].copy(),
        pedestrian=ways[:, faced],
        pedestrian_speed=speeds[:, faced],
        nearest=nearest,
        others=[(ways[:, n], speeds[:, n]) for n in range(state.shape[1]) if n != faced],
    )


def _draw_curvttc(axis: Axes, time: Floats, curvttc: Floats) -> None:
    axis.plot(time, np.where(np.isfinite(curvttc), curvttc, np.nan), color=TTC, linewidth=1.4)
    axis.axhline(
        CRITICAL_TTC, color="#888888", linewidth=0.9, linestyle="--", label=f"critical below {CRITICAL_TTC:g} s"
    )
    axis.set_ylim(0.0, HORIZON)
    axis.set_ylabel("CurvTTC [s]", fontsize=8)
    if not np.isfinite(curvttc).any():
        axis.text(0.5, 0.3, "no contact ahead at any time", transform=axis.transAxes, ha="center", fontsize=8)


def _draw_speeds(axis: Axes, time: Floats, state: NDArray[np.void]) -> None:
    axis.plot(time, state["vehicle_speed"][:, 0], color=VEHICLE, linewidth=1.4, label="vehicle")
    several = state.shape[1] > 1
    for n, walking in enumerate(np.hypot(state["pedestrian_vx"], state["pedestrian_vy"]).T):
        label = ("pedestrians" if several else "pedestrian") if n == 0 else "_"
        axis.plot(time, walking, color=PEDESTRIAN, linewidth=0.9 if several else 1.4, label=label)
    axis.set_ylabel("speed [m/s]", fontsize=8)
    axis.set_ylim(bottom=0.0)


def _mark(axis: Axes, time: Floats, state: NDArray[np.void]) -> None:
    """Shade when the policies held the agents; the same look for all series."""
    held = (state["controlled"] != 0).any(axis=1)
    if held.any():
        low, high = axis.get_ylim()
        axis.fill_between(
            time, low, high, where=held.tolist(), color=HELD, linewidth=0.0, zorder=0, label="the policies drive"
        )
        axis.set_ylim(low, high)
    axis.set_xlim(0.0, time[-1])
    axis.tick_params(labelsize=7)
    axis.grid(linewidth=0.4, color="#dddddd")
    axis.set_axisbelow(True)
