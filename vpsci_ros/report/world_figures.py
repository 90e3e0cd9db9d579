"""A picture of a scenario: lane, crosswalk, spawns, routes and goals of both agents.

What is drawn of the spawns are spawns: the first episodes of the scenario, not the intervals of its file.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from vpsci_ros.report.canvas import new_figure, save_png, show_all
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.world import Scenario, World, WorldConfig
from vpsci_ros.world.paths import Path as Line
from vpsci_ros.world.surroundings import surroundings_of

Floats = NDArray[np.float64]
GROUND, ROAD, VEHICLE, PEDESTRIAN, GOAL = "#f1f1ee", "#cfcfcb", "#08519c", "#a50f15", "#2ca02c"
TOWN, KERB, MARK = "#e6e6e2", "#b9b9b4", "#f8f8f6"  # of the roads around the lane
SPAWNS = 200  # episodes whose spawns are drawn
PARKED = "#8a8f8c"
_SIGNS = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])


def save_scenario(scenario: Scenario, path: str | Path, seed: int = 1) -> None:
    """Draw a scenario and write it as a PNG, whole or not at all.

    :param seed: of the spawns that are drawn, those of episodes 0 to 199.
    :raises InvalidInput: the folder of `path` does not exist.
    """
    figure, ((axis,),) = new_figure(8.0, 8.0)
    axis.set_facecolor(GROUND)
    axis.set_aspect("equal")
    axis.set_title(f"{scenario.number}  {scenario.name}\n{scenario.description}", fontsize=10)
    axis.set_xlabel("x, east [m]")
    axis.set_ylabel("y, north [m]")
    draw_ground(axis, scenario)
    _draw_spawns(axis, scenario, seed)
    _draw_line(axis, scenario.vehicle.path, scenario.vehicle.goal, scenario.vehicle.lane_width, VEHICLE, "vehicle")
    _draw_line(axis, scenario.pedestrian.path, scenario.pedestrian.goal, 2.0, PEDESTRIAN, "pedestrian")
    axis.plot(*scenario.pedestrian.path.at(scenario.pedestrian.conflict), "*", color="black", markersize=11)
    axis.plot([], [], "*", color="black", markersize=11, label="conflict point")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=4, fontsize=8, frameon=False)
    routes = scenario.vehicle.path.points, scenario.pedestrian.path.points
    show_all(axis, np.concatenate([*routes, scenario.crosswalk]), 3.0)
    save_png(figure, path, 120)


def draw_ground(axis: Axes, scenario: Scenario) -> None:
    """Draw the lane, the crosswalk, the parked vehicles, and the roads around those of a shipped scenario."""
    kerbs, marks = surroundings_of(scenario).values()
    if kerbs:
        town = Outline.make_compound_path(*(Outline(np.concatenate([kerb, kerb[:1]]), closed=True) for kerb in kerbs))
        lines = Outline.make_compound_path(*map(Outline, marks))
        axis.add_artist(PathPatch(town, facecolor=TOWN, edgecolor=KERB, linewidth=0.8, zorder=-2))
        axis.add_artist(PathPatch(lines, facecolor="none", edgecolor=MARK, linewidth=0.8, zorder=-1))
    lane = scenario.vehicle.path.band(scenario.vehicle.lane_width)
    axis.add_patch(Polygon(lane, facecolor=ROAD, edgecolor="none", zorder=0))
    if len(scenario.crosswalk):
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "#a9a9a4", "hatch": "////", "linewidth": 0.8}
        axis.add_patch(Polygon(scenario.crosswalk, zorder=0.5, **look))
    for outline in outlines(scenario.parked):
        axis.add_patch(Polygon(outline, facecolor=PARKED, edgecolor="white", linewidth=0.6, zorder=1.5))


def outlines(boxes: Floats) -> Floats:
    """Return the corners, float64[K, 4, 2] [m], of rectangles float64[K, 5]: x, y, heading, length, width."""
    corners = 0.5 * _SIGNS * boxes[:, None, 3:]
    c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    turned: Floats = corners @ np.array([[c, s], [-s, c]]).transpose(2, 0, 1) + boxes[:, None, :2]
    return turned


def _draw_spawns(axis: Axes, scenario: Scenario, seed: int) -> None:
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot")
    state = World(config, [scenario], [(scenario.number, e) for e in range(SPAWNS)], SPAWNS, seed).state
    places = np.stack([state[f"vehicle_{name}"][:40] for name in ("x", "y", "heading")], axis=1)
    size = np.broadcast_to([VEHICLE_LENGTH, VEHICLE_WIDTH], (len(places), 2))
    for outline in outlines(np.concatenate([places, size], axis=1)):
        axis.add_patch(Polygon(outline, facecolor="none", edgecolor=VEHICLE, linewidth=0.5, alpha=0.35, zorder=2))
    waiting = state["start_delay"] > 0.0
    for which, filled, name in ((~waiting, PEDESTRIAN, "on its way"), (waiting, "none", "waiting")):
        axis.scatter(
            state["pedestrian_x"][which],
            state["pedestrian_y"][which],
            s=14,
            facecolors=filled,
            edgecolors=PEDESTRIAN,
            linewidths=0.7,
            alpha=0.7,
            zorder=3,
            label=f"pedestrian spawned {name}",
        )
    axis.plot([], [], "s", markerfacecolor="none", markeredgecolor=VEHICLE, label="vehicle spawned")


def _draw_line(axis: Axes, line: Line, goal: float, width: float, colour: str, name: str) -> None:
    """Draw a path with its direction, its arc length every 10 m and its goal across it."""
    axis.plot(*line.points.T, color=colour, linewidth=1.2, zorder=4, label=f"{name}'s route, arc length [m]")
    for s in np.arange(0.0, line.length + 1e-9, 10.0):
        axis.plot(*line.at(s), ".", color=colour, markersize=5, zorder=5)
        axis.annotate(f"{s:.0f}", line.beside(s, 0.5 * width + 0.5), fontsize=7, color=colour, ha="center", va="center")
    ends = np.array([line.beside(goal, side * 0.5 * width) for side in (1, -1)])
    axis.plot(*ends.T, color=GOAL, linewidth=3.0, zorder=6)
    axis.annotate(
        "", line.at(line.length), line.at(line.length - 2.0), arrowprops={"arrowstyle": "-|>", "color": colour}
    )
    if name == "vehicle":
        axis.plot([], [], color=GOAL, linewidth=3.0, label="goals")
