"""Conducting a standard protocol beside the learned pedestrians: its tests driven, rated, and set beside the exam.

Until a system brakes with 3 m/s2 or more, robots hold the speed of the test and the lane, as on a proving ground: a
system that would rather drive more slowly is tested at the protocol's speed all the same. From then on it has the car.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam import euro_ncap
from vpsci_ros.exam.cockpit import Cockpit
from vpsci_ros.exam.collect import episodes_of
from vpsci_ros.exam.conduct import loop_with, run_with_all
from vpsci_ros.exam.config import EURO_NCAP
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_process import InProcess
from vpsci_ros.exam.measures import RunResult, episode_table
from vpsci_ros.exam.report import ADS, BASELINE, Conduct
from vpsci_ros.exam.sight import Watcher
from vpsci_ros.exam.view import exam_sources
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.files import write_text
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.view.page import write_view
from vpsci_ros.view.sources import LIMIT
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.autopilot import too_near
from vpsci_ros.world.kinematics import MAX_DECELERATION
from vpsci_ros.world.observation import to_heading_frame

PROTOCOLS = ("euro-ncap",)
FOLDER = "protocol"
_VIEW = "view.html"
_STRAIGHT_AHEAD = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS + 0.25  # [m] to either side, as the autopilot's


class AutopilotBrake:
    """The rule by which the world's autopilot brakes: fully, for whoever is straight ahead and near."""

    near = 4.0  # [m] before the front

    def reset(self, begin: Any) -> None:
        """Begin an episode."""

    def act(self, observation: Any) -> float:
        """Return full braking or nothing [m/s2]."""
        car = observation.vehicle
        places = (to_heading_frame(car.yaw, each.x - car.x, each.y - car.y) for each in observation.pedestrians)
        ahead = (0.5 * VEHICLE_LENGTH, _STRAIGHT_AHEAD, self.near)
        return -MAX_DECELERATION if any(too_near(*place, *ahead) for place in places) else 0.0


def protocol_exam(exam: Exam, folder: Path) -> Exam:
    """Return the exam on the protocol's tests, a scenario each, whose files are written into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for cell in euro_ncap.cells():
        files.append(str(folder / f"{cell.name}.yaml"))
        write_text(Path(files[-1]), yaml.safe_dump(euro_ncap.document(cell), sort_keys=False))
    own = {name: value for name, value in exam.sections.values.get("world_simulator", {}).items()
           if not name.startswith(("crowd.", "kinds."))}  # fmt: skip
    changed = {
        "scenarios": [cell.number for cell in euro_ncap.cells()], "scenario_files": files, "episodes": 1,
        "first_episode": 0, "only": [], "spawn": "paper", "pedestrians": 1, "episode_time": euro_ncap.EPISODE_TIME,
        "held_until": euro_ncap.RELEASED,
    }  # fmt: skip
    sections = dataclasses.replace(exam.sections, values={**exam.sections.values, "world_simulator": own | changed})
    run, world = sections.get(RunConfig, "world_simulator"), sections.get(WorldConfig, "world_simulator")
    return dataclasses.replace(exam, sections=sections, run=run, world=world, part=0, whole=None)


def conduct_protocol(exam: Exam, folder: Path, *, workers: int, quiet: bool) -> dict[str, Any]:
    """Have the system and the autopilot's brake drive the protocol's tests in `folder`; return it for the report.

    :raises VpsciError: a node has failed.
    """
    tests = protocol_exam(exam, folder / "scenarios")
    found = {ADS: run_with_all(tests, folder, [EURO_NCAP], workers=workers, quiet=quiet, what="protocol: ")[EURO_NCAP]}
    if exam.config.baseline:
        found[BASELINE] = _autopilot(tests, folder)
    tables = [episode_table(run, [], exam.config, driver=name, pedestrian=EURO_NCAP) for name, run in found.items()]
    view = ""
    if found[ADS].episodes:
        view = f"{FOLDER}/{_VIEW}"
        drivers = {name: _episodes(run.episodes) for name, run in found.items()}
        sources = exam_sources(pl.concat(tables), drivers, LIMIT, print)
        write_view(folder / _VIEW, sources, f"{euro_ncap.VERSION}: {exam.config.examined}")
    return {
        "name": PROTOCOLS[0],
        "version": euro_ncap.VERSION,
        "view": view,
        "failure": found[ADS].conduct.failure,
        "hidden": exam.perception is not None and exam.perception.least_visible > 0.0,
        "left_out": list(euro_ncap.LEFT_OUT),
        "drivers": {name: euro_ncap.rated(_speeds(run.episodes)) for name, run in found.items()},
    }


def _episodes(episodes: Sequence[Episode]) -> Any:
    return lambda _: episodes


def _speeds(episodes: Sequence[Episode]) -> dict[int, float]:
    """Return the scenario's number -> impact speed [km/h]."""
    return {episode.key[0]: round(euro_ncap.impact_speed(episode), 3) for episode in episodes}


def _autopilot(exam: Exam, folder: Path) -> RunResult:
    """Return what the autopilot's braking rule comes to, in the same robots' hands."""
    loop = loop_with(exam, EURO_NCAP, "external", exam.episodes, len(exam.episodes))
    brake = type("AutopilotBrake", (AutopilotBrake,), {"near": exam.world.proximity_distance})
    cockpit = Cockpit(brake, exam.scenarios, len(exam.episodes), 0.0)
    steps = InProcess(loop, cockpit.answers, None, folder / "autopilot.log").episodes(exam.episodes, lambda _: None)
    ticks = ((step.tick.state, step.assessment.curvttc, step.assessment.distance) for step in steps)
    found, sight = episodes_of(exam, ticks, Watcher(exam.scenarios), BASELINE)
    return RunResult(found, Conduct(len(exam.episodes)), sight=sight)


def beside_people(protocol: Mapping[str, Any], scores: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return, for each driver, what the protocol says of it beside how often it hits each pedestrian of the exam.

    :param scores: driver -> pedestrian -> measures.
    """
    rows = []
    each = [(driver, name) for driver in protocol["drivers"] for name in scores.get(driver, {})]
    for driver, pedestrian in each:
        rated, rate = protocol["drivers"][driver], scores[driver][pedestrian]["moving_collision_rate"]
        if rate["value"] is None:
            continue
        hits = rate["value"] > 0.0
        said = {
            (True, True): "passes the protocol and fails with people",
            (True, False): "passes the protocol, and hits nobody here",
            (False, True): "fails both",
            (False, False): "fails the protocol, and hits nobody here",
        }[rated["passed"], hits]
        rows.append({"driver": driver, "pedestrian": pedestrian, "points": rated["points"], "of": rated["of"],
                     "passed": rated["passed"], "moving_collision_rate": rate, "says": said})  # fmt: skip
    return rows


def summary_lines(protocol: Mapping[str, Any]) -> list[str]:
    """Return the protocol's result as Markdown."""
    text = [f"{protocol['version']}, tests by day that a kinematic world can conduct:", ""]
    text += [
        f"| {' | '.join(['', 'points', 'passed', *euro_ncap.TITLES])} |",
        "|---" * (3 + len(euro_ncap.TITLES)) + "|",
    ]
    for driver, rated in protocol["drivers"].items():
        each = [f"{test['points']:.2f} of {test['of']:.1f}" for test in rated["tests"].values()]
        cells = [driver, f"{rated['points']:.2f} of {rated['of']:.1f}", "yes" if rated["passed"] else "no", *each]
        text.append(f"| {' | '.join(cells)} |")
    text += ["", *(f"- {row['driver']}: {row['says']} ({row['pedestrian']})" for row in protocol["beside"])]
    return text
