"""All figures and tables of the paper that can be drawn from a dataset and from results of other commands.

Figures 4, 5, 7 to 9 and 11 to 13 and Tables 6, 7 and 10 come from a dataset, from recorded near misses, and from a
dataset of the rule-based pair, which stands for CARLA's default controller. Figures 6 and 10 and Tables 3, 9 and 11
are those of finished runs. Whatever was not given is named on the page, with the command that makes it. Figures 1 to 3
and Tables 1, 2, 4 and 8 show the method, not results; Table 5 is in docs/results.md.
"""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.published import TABLE_10
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.published import TABLE_3, TABLE_9
from vpsci_ros.extras.paper.section_4.encounters import generated_encounters, recorded_encounters
from vpsci_ros.extras.paper.section_4.figures import SIDES, save_conflicts, save_nearness, save_yielding
from vpsci_ros.extras.paper.section_4.snapshots import save_snapshots
from vpsci_ros.extras.paper.section_4.typical_episodes import typical_episodes
from vpsci_ros.extras.paper.trajectories import save_trajectories
from vpsci_ros.learning import online
from vpsci_ros.report import html
from vpsci_ros.report.canvas import new_figure, save_png, show_all
from vpsci_ros.report.learning import draw_rewards, read_log
from vpsci_ros.report.world_figures import GROUND, PEDESTRIAN, VEHICLE, draw_ground
from vpsci_ros.runs.files import require_empty_folder, write_text
from vpsci_ros.world import Scenario
from vpsci_ros.world.paths import Path as Line
from vpsci_ros.world.scenario import shipped_scenarios

PAGE, NUMBERS = "paper.html", "paper.json"
CAPTIONS = {
    "figure_4": "Figure 4 (b): both locations, the vehicle's lane and the pedestrians' eight ways.",
    "figure_5": "Figure 5: sequential snapshots of a typical episode of each scenario. Disc twice its size.",
    "figure_6": "Figure 6: rolling average of the episodic reward in stage 2.",
    "figure_7": "Figure 7: trajectories by speed, vehicle blue, pedestrian red, the darker the faster.",
    "figure_8": "Figure 8: least CurvTTC, density and histogram; lines are quartiles.",
    "figure_9": "Figure 9: how often the pedestrian yields by distance and own speed at the onset.",
    "figure_10": "Figure 10: scores of the Turing test by clip and by source.",
    "figure_11": "Figure 11: share of conflicts (CurvTTC below 2 s) by both speeds at the onset.",
    "figure_12": "Figure 12: how often the pedestrian yields by distance and by the vehicle's speed and acceleration.",
    "figure_13": "Figure 13: how often the pedestrian yields by distance and by its own speed and acceleration.",
}
RUNS = {  # what a finished run leaves -> what it is called here, and the command that makes it
    online.EPISODES: ("figure_6", "vpsci refine"),
    "figure_10.png": ("figure_10", "vpsci turing score"),
    "turing.json": ("table_11", "vpsci turing score"),
    "table_3.csv": ("table_3", "vpsci study samples"),
    "models.json": ("table_9", "vpsci study models"),
}


def write_paper(
    dataset: Path,
    output: Path,
    *,
    near_misses: Path,
    rules: Path | None,
    runs: Sequence[Path] = (),
    notify: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Write paper.html, paper.json and figure_N.png into `output`; return missing parts: name -> command.

    :param dataset: of `vpsci generate` or `vpsci published`.
    :param near_misses: recorded ones, see `read_near_misses`.
    :param rules: a dataset of the rule-based pair.
    :param runs: folders of finished runs of the commands in `RUNS`.
    :raises InvalidInput: an input cannot be read, or a folder of `runs` holds nothing that this page shows,
        or `output` holds anything but such a page.
    """
    require_empty_folder(output, PAGE, NUMBERS, *(f"{name}.png" for name in CAPTIONS))
    found = _of_runs(runs)
    notify("reading")
    data = Dataset(dataset)
    generated = {"generated": generated_encounters(data)}
    recorded = {"recorded": recorded_encounters(read_near_misses(near_misses))}
    rule_based = {} if rules is None else {"rule-based pair": generated_encounters(Dataset(rules))}
    for name, table in (generated | recorded | rule_based).items():
        if not table.height:
            raise InvalidInput(f"{name}: no interaction with CurvTTC of 5 s or less; nothing to draw")
    pictures = {name: output / f"{name}.png" for name in CAPTIONS}
    notify("drawing")
    roads = data.own_scenarios or [each for each in shipped_scenarios() if each.name in data.scenarios]
    if roads:
        save_locations(roads, pictures["figure_4"])
    typical = typical_episodes(data)
    save_snapshots(typical, pictures["figure_5"])
    save_trajectories(typical, pictures["figure_7"])
    save_nearness(recorded | generated, pictures["figure_8"])
    save_yielding(recorded | generated, "pedestrian", pictures["figure_9"], SIDES[2:3])
    save_conflicts(generated | rule_based, pictures["figure_11"])
    save_yielding(generated | rule_based, "pedestrian", pictures["figure_12"], SIDES[:2])
    save_yielding(generated | rule_based, "pedestrian", pictures["figure_13"], SIDES[2:])
    if "figure_6" in found:
        save_rewards(found["figure_6"], pictures["figure_6"])
    if "figure_10" in found:
        shutil.copyfile(found["figure_10"], pictures["figure_10"])
    tables = {name: _table(path) for name, path in found.items() if name.startswith("table")}
    numbers = {"dataset": str(dataset), "scenarios": data.scenarios, **tables}
    write_text(output / NUMBERS, json.dumps(numbers, indent=1) + "\n")
    missing = {name: command for name, command in RUNS.values() if name not in found}
    missing |= {} if rule_based else {"the rule-based pair in figures 11 to 13": "--rules DIR"}
    html.write_page(
        output / PAGE,
        Path(__file__).resolve().parent / "templates" / "paper.html",
        title="The paper's figures and tables",
        dataset=dataset,
        pictures={name: (path, CAPTIONS[name]) for name, path in pictures.items() if path.is_file()},
        scenarios=[(row, data.scenarios[row.name]) for row in roads],
        columns={name: EPISODE_COLUMNS[name] for name in TABLE_7},
        tables=tables,
        published={"3": TABLE_3, "9": TABLE_9, "10": TABLE_10},
        missing=missing,
        numbers=NUMBERS,
    )
    return missing


def _of_runs(runs: Sequence[Path]) -> dict[str, Path]:
    """Return name of a figure or table, see `RUNS` -> its file in these folders.

    :raises InvalidInput: a folder has none.
    """
    found: dict[str, Path] = {}
    for folder in runs:
        here = {name: folder / file for file, (name, _) in RUNS.items() if (folder / file).is_file()}
        if not here:
            raise InvalidInput(
                f"{folder}: expected the folder of a finished run, with one of {', '.join(RUNS)}; none is"
            )
        found |= here
    return found


def _table(path: Path) -> Any:
    return read_json(path) if path.suffix == ".json" else read_log(path).to_dicts()


def save_locations(scenarios: Sequence[Scenario], path: str | Path) -> None:
    """Draw the lane, crosswalks and routes of each location's scenarios (Figure 4 b), as a PNG."""
    places = list(dict.fromkeys(scenario.location for scenario in scenarios))
    figure, axes = new_figure(5.2 * len(places), 5.4, 1, len(places))
    for axis, place in zip(axes.flat, places, strict=True):
        own = [scenario for scenario in scenarios if scenario.location == place]
        axis.set_facecolor(GROUND)
        axis.set_aspect("equal")
        axis.set_title(f"Location {place}", fontsize=10)
        axis.set_xlabel("x, east [m]", fontsize=8)
        axis.set_ylabel("y, north [m]", fontsize=8)
        for scenario in own:
            draw_ground(axis, scenario)
            _draw_arrow(axis, scenario.vehicle.path, 0.0, VEHICLE, "")
            _draw_arrow(axis, scenario.pedestrian.path, 0.8, PEDESTRIAN, str(scenario.number))
        shown = [(one.vehicle.path.points, one.pedestrian.path.points, one.crosswalk) for one in own]
        show_all(axis, np.concatenate([points for each in shown for points in each]), 3.0)
    save_png(figure, path)


def _draw_arrow(axis: Axes, line: Line, left: float, colour: str, name: str) -> None:
    points = np.array([line.beside(s, left) for s in np.linspace(0.0, line.length, 40)])
    axis.plot(*points.T, color=colour, linewidth=1.6, zorder=4)
    axis.annotate("", points[-1], points[-3], arrowprops={"arrowstyle": "-|>", "color": colour}, zorder=5)
    if name:
        look: dict[str, Any] = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": colour}
        axis.annotate(name, points[0], fontsize=9, color=colour, weight="bold", ha="center", va="center", bbox=look)


def save_rewards(episodes: Path, path: Path) -> None:
    """Draw Figure 6 from `online.EPISODES` of a run of stage 2: the rolling mean of an episode's reward, by agent."""
    figure, ((axis,),) = new_figure(6.5, 3.8)
    draw_rewards(axis, read_log(episodes))
    save_png(figure, path)
