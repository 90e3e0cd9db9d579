"""The exam of a driving system: prepared, conducted, scored and reported.

In the output folder: exam.json (what is examined: parameters, hashes, versions), runs/PEDESTRIAN (bag, logs and
resolved parameters of each run), logs/, episodes.parquet, report.json, report.html, and view.html, in which the
episodes play. The same command goes on with an exam that was stopped: pedestrians that are done do not run again.
"""

import dataclasses
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.parquet import read_parquet, write_parquet
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.episodes import read_episodes
from vpsci_ros.episodes.sources import EXAM
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam import protocol as standard
from vpsci_ros.exam.collect import bags_of
from vpsci_ros.exam.conduct import autopilot_run, run_with_all
from vpsci_ros.exam.config import ALONE, EXTERNAL, NO_SOCKET, PERSON, ExamConfig, added_pedestrians, title_of
from vpsci_ros.exam.criteria import check, parse
from vpsci_ros.exam.earlier import Earlier, compare, compared_with, write_junit
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.failures import again_source, export_smallest, groups_of
from vpsci_ros.exam.measures import COLUMNS, EPISODES, RunResult, episode_table
from vpsci_ros.exam.on_hosts import driver_files
from vpsci_ros.exam.page import write_page
from vpsci_ros.exam.process import OWN
from vpsci_ros.exam.report import ADS, BASELINE, FAILED_BEFORE, make_report
from vpsci_ros.exam.summary import write_summary
from vpsci_ros.exam.view import Driven, exam_sources
from vpsci_ros.exam.why import FOLDER, Search, explain
from vpsci_ros.policy.agent_types import AGENT_TYPES
from vpsci_ros.resources import near_misses_path
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.files import require_empty_folder, sha256, write_json, write_text
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.sections import Sections
from vpsci_ros.view.page import write_view
from vpsci_ros.view.sources import LIMIT, Source
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.engines import EngineConfig
from vpsci_ros.world.safe_stop import ExternalConfig

IDENTITY, VIEW, SUMMARY, JUNIT = EXAM, "view.html", "summary.md", "junit.xml"
_SHOWN = {
    "collision_rate": "colli-\nsions",
    "moving_collision_rate": "vehicle\nmoving",
    "conflict_rate": "con-\nflicts",
    "evasion_success_rate": "evasion\nsuccess",
    "hard_braking_rate": "hard\nbraking",
    "time_lost": "time lost\n\\[s]",
}
"""Measures that are printed, and the heads of their columns."""


def prepare(
    sections: Sections,
    ads: str | None = None,
    ads_class: str | None = None,
    workers: int = 1,
    port: int | None = None,
) -> Exam:
    """Check everything that can be checked before anything runs.

    :param ads, ads_class: the driving system, instead of the one that the parameters name: a command, or MODULE:CLASS.
    :param workers: runs side by side.
    :param port: to which the command connects, see `ExamConfig.socket`.
    :raises InvalidInput: a parameter, the command, the class, weights or recordings are refused.
    """
    if ads is not None and ads_class is not None:
        raise InvalidInput("--ads and --ads-class exclude each other: a driving system is a program or a class")
    given: dict[str, Any] = {"ads": ads, "ads_class": ""} if ads is not None else {}
    given |= {"ads_class": ads_class, "socket": NO_SOCKET} if ads_class else {}
    given |= {"socket": port} if port is not None else {}
    chosen = sections.changed("ads_test", given).changed("world_simulator", {"batch": 1})
    if "weights" not in chosen.values.get("pedestrian_policy", {}):
        chosen = chosen.changed("pedestrian_policy", {"weights": "people"})
    config = chosen.get(ExamConfig, "ads_test")
    run, world = chosen.get(RunConfig, "world_simulator"), chosen.get(WorldConfig, "world_simulator")
    exam = Exam(chosen, config, run, world)
    if config.ads_class and config.socket != NO_SOCKET:
        raise InvalidInput("--socket and --ads-class exclude each other: a class drives in this process")
    if config.socket != NO_SOCKET and (config.ads.strip() == OWN or (config.ads == EXTERNAL) != (config.socket > 0)):
        raise InvalidInput(
            f"--socket {config.socket} with ads = {config.ads}: give a command of your own with port 0, which it finds "
            "in its environment, or 'external' with the port to which you connect it"
        )
    if config.in_process and chosen.get(ExternalConfig, "world_simulator").external_mode != "lock_step":
        raise InvalidInput(
            "world_simulator.external_mode = real_time: a class is called at every tick, however long it takes, and so "
            "is a program behind a socket; examine it as a program that speaks ROS, by --ads"
        )
    if config.in_process or config.baseline:
        what = "a class, a program behind a socket and the autopilot (ads_test.baseline) drive"
        chosen.get(EngineConfig, "world_simulator").require_own(what)
    if config.examined != EXTERNAL:
        exam = dataclasses.replace(exam, files=driver_files(config))
    elif workers > 1:
        raise InvalidInput(f"--workers {workers}: a system that you start yourself (external) drives in one graph only")
    if config.examined.strip() == OWN and world.pedestrians > 1 and not config.perception:
        raise InvalidInput(
            f"ads_test.ads = {OWN}: /pedestrian/odometry holds the first pedestrian only, and "
            f"world_simulator.pedestrians = {world.pedestrians}; set ads_test.perception to true, which lists all"
        )
    if config.recorded:
        chosen.get(EngineConfig, "world_simulator").require_own("recorded people are replayed")
        read_near_misses(config.recorded)
    _ = exam.weights, exam.scenarios
    return exam


def run_exam(
    exam: Exam,
    folder: Path,
    criteria: Sequence[str] = (),
    *,
    workers: int | None = None,
    ray: str | None = None,
    against: Path | None = None,
    guard: int | None = None,
    protocol: str = "",
    why: int = 0,
    quiet: bool = False,
) -> list[str]:
    """Conduct the exam, write and print its report, and return the reasons to fail: none where it is passed.

    :param criteria: as for --fail-if, in addition to those of the parameters.
    :param workers: runs side by side; `ray`: on the hosts of this cluster, on all of its cores unless `workers` says.
    :param against: folder of an earlier exam to compare with; `guard`: see `compared_with`.
    :param protocol: one of `vpsci_ros.exam.protocol.PROTOCOLS`, whose tests are driven as well; empty: none.
    :param why: how many failures with each pedestrian are driven again, for what would have avoided them.
    :raises InvalidInput: a criterion is refused, or `folder` holds something else; nothing has been run then.
    :raises VpsciError: a node has failed.
    """
    if ray is not None and exam.config.ads in (EXTERNAL, PERSON) and not exam.config.ads_class:
        raise InvalidInput(f"--ray {ray}: a system that you start yourself (external) drives on this machine only")
    if ray is not None and (protocol or why):
        raise InvalidInput(f"--ray {ray}: --protocol and --why drive on this machine only; give them without --ray")
    if (protocol or why) and (engine := exam.sections.get(EngineConfig, "world_simulator").engine) != "vpsci":
        raise InvalidInput(
            f"world_simulator.engine = {engine}: --why and --protocol change commands and speeds by our kinematics, "
            "and drive an episode again from its seed; give them with engine: vpsci"
        )
    pedestrians = exam.config.opponents
    understood = partial(parse, opponents=pedestrians, compared=against is not None, protocol=protocol)
    parsed = [understood(text) for text in (*exam.config.fail_if, *criteria)]
    earlier: Earlier | None = None
    if against is not None:
        exam, earlier = compared_with(exam, identity_of(exam), against, guard)
    identity = identity_of(exam)
    take_folder(folder, identity)
    runs = {ADS: run_with_all(exam, folder, exam.opponents, workers=workers, ray=ray, quiet=quiet)}
    if exam.config.baseline:
        runs[BASELINE] = {name: autopilot_run(exam, name) for name in (ALONE, *pedestrians)}
    table = pl.concat(_rows(exam, driver, runs[driver]) for driver in runs)
    report = make_report(table, {name: run.conduct for name, run in runs[ADS].items()}, exam.config, exam.perception)
    if earlier is not None:
        report["against"] = compare(table, earlier, exam)
    searches: list[Search] = []
    if why:
        again = folder / FOLDER
        report["why"], searches = explain(exam, again, runs[ADS], table, why, workers=workers or 1, quiet=quiet)
        report["why"]["groups"] = groups_of(exam, runs[ADS], table)
        report["why"]["not_exported"] = export_smallest(report["why"], runs[ADS], again / "openscenario")
    if protocol:
        report["protocol"] = standard.conduct_protocol(
            exam, folder / standard.FOLDER, workers=workers or 1, quiet=quiet
        )
        report["protocol"]["beside"] = standard.beside_people(report["protocol"], report["drivers"])
    verdicts = check(parsed, report, pedestrians)
    failures = [run.conduct.failure for run in runs[ADS].values() if run.conduct.failure]
    failures += [report["protocol"]["failure"]] if protocol and report["protocol"]["failure"] else []
    failures += [verdict.sentence() for verdict in verdicts if verdict.failed]
    report = {"exam": identity, "failures": failures, "criteria": [each.as_json() for each in verdicts]} | report
    write_parquet(table, folder / EPISODES, COLUMNS, content="episodes of an exam", exam=identity)
    write_text(folder / "report.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    driven = bool(report["drivers"].get(ADS))
    if driven:
        drivers = {driver: _episodes_of(found) for driver, found in runs.items()}
        sources = exam_sources(table, drivers, LIMIT, _note, report["failure"])
        mine = {name: [each for each in searches if each.pedestrian == name] for name in pedestrians}
        sources += [source for name, found in mine.items() if (source := again_source(name, found))]
        write_view(folder / VIEW, sources, f"Exam of {exam.config.examined}")
    episodes = {name: run.episodes for name, run in runs[ADS].items()}
    write_page(folder / "report.html", report, table, episodes, VIEW if driven else "")
    write_summary(folder / SUMMARY, report, VIEW if driven else "")
    if earlier is not None:
        write_junit(folder / JUNIT, report)
    _print(report, folder)
    return failures


def _rows(exam: Exam, driver: str, runs: Mapping[str, RunResult]) -> pl.DataFrame:
    """Return a row for each episode of a driver; of the baseline, those with nobody there are the reference alone."""
    names = [name for name in runs if driver == ADS or name != ALONE]
    alone = runs[ALONE].episodes if ALONE in runs else []
    tables = [episode_table(runs[name], alone, exam.config, driver=driver, pedestrian=name) for name in names]
    return pl.concat(tables)


def _episodes_of(runs: Mapping[str, RunResult]) -> Driven:
    return lambda pedestrian: runs[pedestrian].episodes


def is_exam(path: Path) -> bool:
    """Say whether a path is the folder of an exam."""
    return (path / IDENTITY).is_file()


def read_exam(folder: Path, limit: int) -> list[Source]:
    """Return the episodes of an exam that is over, see `exam_sources`.

    :raises InvalidInput: the exam is not whole, or not one episode of it was driven.
    """
    table = read_parquet(folder / EPISODES, "the episodes of an exam", COLUMNS)
    drivers: dict[str, Driven] = {
        ADS: lambda name: (each for bag in bags_of(folder, name) for each in read_episodes(bag, recover=True))
    }
    try:
        identity = read_json(folder / IDENTITY)
        exam = exam_of(identity)
        if sha256(exam.weights) != identity["weights_sha256"]:
            raise InvalidInput("the weights of its pedestrian are not those of the exam any more")
        drivers[BASELINE] = lambda name: autopilot_run(exam, name).episodes
    except (ValueError, LookupError, TypeError) as error:
        _note(f"the autopilot is left out: {error}")
    path = folder / "report.json"
    failure = read_json(path).get("failure", "collision") if path.is_file() else "collision"
    found = exam_sources(table, drivers, limit, _note, failure)
    if not found:
        raise InvalidInput(f"{folder}: not one episode of this exam was driven, so there is nothing to show")
    return found


def exam_of(identity: Mapping[str, Any]) -> Exam:
    """Return the exam that an identity is of, with nobody examined, so that its pedestrians are the same again.

    :raises InvalidInput: its parameters are refused.
    """
    sections = Sections(identity["parameters"])
    exam = prepare(sections, ads=EXTERNAL, port=NO_SOCKET)
    if "whole" not in identity:
        return exam
    everything = sections.changed("world_simulator", {"only": identity["whole"]})
    return dataclasses.replace(exam, whole=prepare(everything, ads=EXTERNAL, port=NO_SOCKET))


def _note(text: str) -> None:
    print(f"note: {text}", file=sys.stderr)


def identity_of(exam: Exam) -> dict[str, Any]:
    """Return what identifies an exam: runs of exams with equal ones can be reused."""
    left_out = ("fail_if", "search")
    examined = {name: value for name, value in dataclasses.asdict(exam.config).items() if name not in left_out}
    nodes = ("world_simulator", "safety_monitor", "pedestrian_policy", *(["perception"] if exam.perception else []))
    whole = {"whole": list(exam.whole.run.only)} if exam.whole else {}  # of which it is a part
    return whole | {
        "ads": exam.config.examined,
        "ads_files_sha256": dict(exam.files),
        "parameters": {name: dict(exam.sections.values.get(name, {})) for name in nodes} | {"ads_test": examined},
        "world": dataclasses.asdict(exam.world),
        "scenarios_sha256": {scenario.name: scenario.sha256 for scenario in exam.scenarios},
        "weights_sha256": sha256(exam.weights),
        "agents": {name: AGENT_TYPES.origin(name) for name in exam.config.opponents if name in added_pedestrians()},
        "recorded_sha256": sha256(near_misses_path(exam.config.recorded)) if exam.config.recorded else "",
        "software": software_versions(),
        "cpu": cpu_name(),
    }


def take_folder(folder: Path, identity: dict[str, Any], name: str = IDENTITY) -> None:
    """Begin this exam in the folder, or go on with it there.

    :param name: of the file that says what it is.
    :raises InvalidInput: it holds something else.
    """
    path = folder / name
    if not path.is_file():
        require_empty_folder(folder)
        write_json(path, identity)
        return
    stored = read_json(path)
    require_form(stored, dict, f"{path}: not what an exam writes; choose another output folder")
    require_same(folder, stored, identity, "holds an exam")


def _print(report: dict[str, Any], folder: Path) -> None:
    console = Console()
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    for head in _SHOWN.values():
        view.add_column(head, justify="right")
    for driver, scores in report["drivers"].items():
        view.add_section()
        view.add_row({ADS: "the ADS", BASELINE: "rule-based autopilot"}[driver], style="bold")
        for name, row in scores.items():
            view.add_row(f"  {title_of(name)}", *(_cell(row[measure]["value"], measure) for measure in _SHOWN))
    console.print(view)
    for name, row in report.get("against", {}).get("pedestrians", {}).items():
        counts = ", ".join(f"{len(row[kind])} {kind.replace('_', ' ')}" for kind in FAILED_BEFORE)
        console.print(f"against {report['against']['folder']}, {title_of(name)}: {counts}", markup=False)
    for text in report["failures"]:
        console.print(f"FAILED  {text}", style="bold red", markup=False)
    if not report["failures"]:
        console.print("passed" if report["criteria"] else "no criterion was given (--fail-if)")
    console.print(f"with intervals and differences: {folder / 'report.html'}", markup=False)


def _cell(value: float | None, measure: str) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if measure == "time_lost" else f"{100.0 * value:.1f}%"
