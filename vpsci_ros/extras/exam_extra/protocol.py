"""Run of a standard protocol: its tests driven, rated, and compared with an exam.

Until a system brakes with 3 m/s2 or more, the speed of the test is held, as by robots on a proving ground: a system
that would rather drive more slowly is tested at the protocol's speed all the same. From then on it has the car.
"""

import dataclasses
import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from vpsci_ros.documents import listed, read_json, require_form
from vpsci_ros.exam.conduct import run_with_all
from vpsci_ros.exam.drivers import Cockpit, DrivenLoop
from vpsci_ros.exam.exam import ADS, BASELINE, Exam, identity_of, sealed, take_folder, title_of
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.result import RunResult, block_of_ticks
from vpsci_ros.exam.run import loop_with
from vpsci_ros.exam.view import exam_sources
from vpsci_ros.extras.exam_extra import euro_ncap
from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.lockstep.intervention import Intervention
from vpsci_ros.report import html
from vpsci_ros.runs.files import write_text
from vpsci_ros.runs.run_config import RunConfig
from vpsci_ros.runs.workers import Site
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.view.view_page import LIMIT, write_view
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.drivers.autopilot import too_near
from vpsci_ros.world.kinematics import MAX_DECELERATION
from vpsci_ros.world.observation import to_heading_frame

EURO_NCAP = "euro_ncap"  # the target of the tests, as a pedestrian
IDENTITY = "protocol.json"
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "protocol.html"
_STRAIGHT_AHEAD = 0.5 * VEHICLE_WIDTH + PEDESTRIAN_RADIUS + 0.25  # [m] to either side, as the autopilot's


class AutopilotBrake:
    """The braking rule of the world's autopilot: full braking for a near pedestrian straight ahead."""

    def __init__(self, near: float) -> None:
        self._near = near  # [m] before the front

    def reset(self, begin: Any) -> None:
        """Begin an episode; the rule has no memory."""

    def act(self, observation: Any) -> float:
        """Return the acceleration [m/s2]: full braking or 0."""
        car = observation.vehicle
        places = (to_heading_frame(car.yaw, each.x - car.x, each.y - car.y) for each in observation.pedestrians)
        ahead = (0.5 * VEHICLE_LENGTH, _STRAIGHT_AHEAD, self._near)
        return -MAX_DECELERATION if any(too_near(*place, *ahead) for place in places) else 0.0


def protocol_exam(exam: Exam, folder: Path) -> Exam:
    """Return the exam on the protocol's tests; each cell of a test is a scenario, written as a file into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    cells = euro_ncap.cells()
    for cell in cells:
        files.append(str(folder / f"{cell.name}.yaml"))
        write_text(Path(files[-1]), yaml.safe_dump(euro_ncap.document(cell), sort_keys=False))
    own = {name: value for name, value in exam.sections.values.get("world_simulator", {}).items()
           if not name.startswith(("crowd.", "kinds."))}  # fmt: skip
    changed = {
        "scenarios": [cell.number for cell in cells], "scenario_files": files, "episodes": 1,
        "first_episode": 0, "only": [], "spawn": "paper", "pedestrians": 1, "episode_time": euro_ncap.EPISODE_TIME,
    }  # fmt: skip
    held = {(cell.number, 0): Intervention(held=cell.speed * euro_ncap.KMH) for cell in cells}
    sections = dataclasses.replace(exam.sections, values={**exam.sections.values, "world_simulator": own | changed})
    run, world = sections.get(RunConfig, "world_simulator"), sections.get(WorldConfig, "world_simulator")
    scenarios = load_scenarios(run.scenarios, run.scenario_files)
    tests = dataclasses.replace(exam, sections=sections, run=run, world=world, scenarios=scenarios, interventions=held)
    target = euro_ncap.motion(scenarios, tests.with_pedestrian(EURO_NCAP, "external"))
    return sealed(dataclasses.replace(tests, motions={EURO_NCAP: target}))


def run_protocol(
    exam: Exam, folder: Path, beside: Path | None, fail_below: float, *, workers: Site, quiet: bool
) -> list[str]:
    """Run the protocol's tests, write and print the result, and return the reasons for failing.

    :param beside: folder of an exam of the same system, whose pedestrians are set beside the tests; None: none.
    :param fail_below: fewest points with which the system passes.
    :raises InvalidInput: `folder` holds something else, or `beside` is no exam that is over.
    :raises VpsciError: a node has failed.
    """
    require_own(exam.simulator.engine, "the tests hold the speed by our kinematics")
    people = {} if beside is None else read_json(beside / "report.json")
    if beside is not None:
        require_form(people, {"drivers": dict, "exam": {"ads": str}}, f"--exam {beside}: no exam that is over")
    take_folder(folder, identity_of(exam), IDENTITY)
    report = conduct_protocol(exam, folder, workers=workers, quiet=quiet)
    report["ads"] = exam.config.examined
    report["beside"] = beside_people(report, people.get("drivers", {}))
    points = report["drivers"][ADS]["points"]
    failures = [report["failure"]] if report["failure"] else []
    if points is None:
        failures.append(no_points(report["drivers"][ADS]))
    elif points < fail_below:
        failures.append(f"{points:.2f} points, fewer than {fail_below:g}")
    report["failures"] = failures
    write_text(folder / "report.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    page = folder / "report.html"
    title = f"Euro NCAP's tests: {exam.config.examined}"
    names = {ADS: "the ADS", BASELINE: "the rule-based autopilot"}
    titles = {row["pedestrian"]: title_of(row["pedestrian"]) for row in report["beside"]}
    html.write_page(page, _TEMPLATE, title=title, protocol=report, names=names, titles=titles, no_points=no_points)
    for driver, rated in report["drivers"].items():
        found = no_points(rated) if rated["points"] is None else f"{rated['points']:.2f} of {rated['of']:.1f} points"
        print(f"{names[driver]}: {found}")
    for reason in failures:
        print(f"FAILED  {reason}")
    print(f"report: {page}")
    return failures


def no_points(rated: Mapping[str, Any]) -> str:
    """Return, in words, which cells a driver without points has not driven."""
    count = len(rated["missing"])
    return f"no points, since {count} cell{'s were' if count > 1 else ' was'} not driven: {listed(rated['missing'], 3)}"


def conduct_protocol(exam: Exam, folder: Path, *, workers: Site, quiet: bool) -> dict[str, Any]:
    """Run the protocol's tests in `folder` with the system and with the autopilot's brake; return the results.

    :raises VpsciError: a node has failed.
    """
    tests = protocol_exam(exam, folder / "scenarios")
    found = {ADS: run_with_all(tests, folder, [EURO_NCAP], workers=workers, quiet=quiet, what="protocol: ")[EURO_NCAP]}
    if exam.config.baseline:
        found[BASELINE] = _autopilot(tests, folder)
    tables = [episode_table(run, [], driver=name, pedestrian=EURO_NCAP) for name, run in found.items()]
    view = ""
    if found[ADS].episodes:
        view = "view.html"
        episodes = {name: {EURO_NCAP: run.episodes} for name, run in found.items()}
        sources = exam_sources(pl.concat(tables), episodes, LIMIT)
        write_view(folder / view, sources, f"{euro_ncap.VERSION}: {exam.config.examined}")
    return {
        "version": euro_ncap.VERSION,
        "view": view,
        "failure": found[ADS].conduct.failure,
        "hidden": exam.perception is not None and exam.perception.least_visible > 0.0,
        "left_out": list(euro_ncap.LEFT_OUT),
        "drivers": {
            name: euro_ncap.rated({each.key[0]: round(euro_ncap.impact_speed(each), 3) for each in run.episodes})
            for name, run in found.items()
        },
    }


def _autopilot(exam: Exam, folder: Path) -> RunResult:
    """Return what the autopilot's braking rule comes to, in the same tests."""
    loop = loop_with(exam, EURO_NCAP, "external", exam.episodes, len(exam.episodes))
    brake = partial(AutopilotBrake, exam.world.proximity_distance)
    cockpit = Cockpit(brake, exam.scenarios, len(exam.episodes), exam.world.spawn)
    steps = DrivenLoop(loop, cockpit.answers, None, folder / "autopilot.log").ticks(lambda _: None)
    block = block_of_ticks(steps, exam.scenarios)
    return RunResult(list(block.episodes(exam.world.tick, exam.scenarios, BASELINE)))


def beside_people(protocol: Mapping[str, Any], scores: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each driver and pedestrian: the protocol's points beside the exam's moving collision rate.

    :param scores: driver -> pedestrian -> measures.
    """
    rows = []
    each = [(driver, name) for driver in protocol["drivers"] for name in scores.get(driver, {})]
    for driver, pedestrian in each:
        rated, rate = protocol["drivers"][driver], scores[driver][pedestrian]["moving_collision_rate"]
        if rate["value"] is None or rated["points"] is None:
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
