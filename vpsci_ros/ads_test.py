"""The exam of a driving system: prepared, held, scored and reported.

In the output folder: exam.json (what is examined: parameters, hashes, versions), runs/PEDESTRIAN (bag, logs and
resolved parameters of each run), logs/, episodes.parquet, report.json and report.html. The same command goes on with
an exam that was stopped: pedestrians that are done are not met again.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.ads_process import command_of, files_of
from vpsci_ros.ads_runs import Exam, Sections, autopilot, hold
from vpsci_ros.analysis.exam.config import ALONE, EXTERNAL, TITLES, ExamConfig
from vpsci_ros.analysis.exam.criteria import Verdict, judge, parse
from vpsci_ros.analysis.exam.measures import COLUMNS, episode_table
from vpsci_ros.analysis.exam.page import write_page
from vpsci_ros.analysis.exam.report import ADS, BASELINE, make_report
from vpsci_ros.config import RunConfig, pick
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.provenance import cpu_name, require_empty_folder, sha256, software_versions, written_whole
from vpsci_ros.world import WorldConfig

IDENTITY = "exam.json"
_SHOWN = ("collision_rate", "moving_collision_rate", "conflict_rate", "evasion_success_rate", "hard_braking_rate",
          "time_lost")  # fmt: skip


def prepare(sections: Sections, ads: str | None = None) -> Exam:
    """Check everything that can be checked before anything runs.

    :param ads: the driving system, instead of the one that the parameters name.
    :raises InvalidInput: a parameter, the command, weights or recordings are refused.
    """
    values = sections["ads_test"] | ({} if ads is None else {"ads": ads})
    config = pick(ExamConfig, values, "ads_test")
    world = sections["world_simulator"] | {"batch": 1}
    policy = {"weights": "refined"} | sections["pedestrian_policy"]
    chosen = sections | {"ads_test": values, "world_simulator": world, "pedestrian_policy": policy}
    run = pick(RunConfig, world, "world_simulator")
    exam = Exam(chosen, config, run, pick(WorldConfig, world, "world_simulator"))
    if config.ads != EXTERNAL:
        command_of(config.ads)
    if config.recorded and not Path(config.recorded).is_file():
        raise InvalidInput(f"ads_test.recorded = {config.recorded}: no such file; expected a near-miss table (Parquet)")
    _ = exam.weights, exam.scenarios
    return exam


def run_exam(exam: Exam, folder: Path, criteria: Sequence[str] = (), *, quiet: bool = False) -> list[str]:
    """Hold the exam, write and print its report, and return the reasons to fail: none where it is passed.

    :param criteria: as for --fail-if, in addition to those of the parameters.
    :raises InvalidInput: a criterion is refused, or `folder` holds something else; nothing has been run then.
    :raises VpsciError: a node has failed.
    """
    asked = exam.config.met
    parsed = [parse(text, asked) for text in (*exam.config.fail_if, *criteria)]
    identity = _identity(exam)
    _take(folder, identity)
    met = hold(exam, folder, quiet=quiet)
    table = _ads_rows(exam, met)
    if exam.config.baseline:
        table = pl.concat([table, _autopilot_rows(exam)])
    report = make_report(table, {name: each.conduct for name, each in met.items()}, exam.config)
    verdicts = judge(parsed, report, asked)
    failures = [each.conduct.failure for each in met.values() if each.conduct.failure]
    failures += [verdict.sentence() for verdict in verdicts if verdict.failed]
    report = {"exam": identity, "failures": failures, "criteria": [_as_dict(verdict) for verdict in verdicts]} | report
    write_parquet(table, folder / "episodes.parquet", COLUMNS, content="episodes of an exam", exam=identity)
    with written_whole(folder / "report.json") as part:
        part.write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    write_page(folder / "report.html", report, table, {name: each.drives for name, each in met.items()}, exam.scenarios)
    _print(report, folder)
    return failures


def _ads_rows(exam: Exam, met: dict[str, Any]) -> pl.DataFrame:
    alone = met[ALONE].drives
    parts = []
    for name in (ALONE, *exam.config.met):
        if name in met:
            options = {"driver": ADS, "pedestrian": name, "unanswered": met[name].unanswered}
            parts.append(episode_table(met[name].drives, alone, exam.config, exam.world.tick, **options))
    return pl.concat(parts)


def _autopilot_rows(exam: Exam) -> pl.DataFrame:
    alone = autopilot(exam, ALONE)
    parts = []
    for name in exam.config.met:
        found = autopilot(exam, name)
        parts.append(episode_table(found, alone, exam.config, exam.world.tick, driver=BASELINE, pedestrian=name))
    return pl.concat(parts)


def _identity(exam: Exam) -> dict[str, Any]:
    """Return what makes two exams the same: with equal ones, runs of the one serve the other."""
    asked = {name: value for name, value in dataclasses.asdict(exam.config).items() if name != "fail_if"}
    nodes = ("world_simulator", "safety_monitor", "pedestrian_policy")
    return {
        "ads": exam.config.ads,
        "ads_files_sha256": {} if exam.config.ads == EXTERNAL else files_of(exam.config.ads),
        "parameters": {name: exam.sections[name] for name in nodes} | {"ads_test": asked},
        "weights_sha256": sha256(exam.weights),
        "recorded_sha256": sha256(exam.config.recorded) if exam.config.recorded else "",
        "software": software_versions(),
        "cpu": cpu_name(),
    }


def _take(folder: Path, identity: dict[str, Any]) -> None:
    """Make the folder this exam's, or go on in it."""
    path = folder / IDENTITY
    if not path.is_file():
        require_empty_folder(folder)
        with written_whole(path) as part:
            part.write_text(json.dumps(identity, indent=2) + "\n", encoding="utf-8")
        return
    try:
        theirs = dict(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError, OSError):
        theirs = {}
    different = [key for key in identity if theirs.get(key) != identity[key]]
    if different:
        raise InvalidInput(f"{folder}: holds another exam ({', '.join(different)} differ); choose another folder")


def _as_dict(verdict: Verdict) -> dict[str, Any]:
    value = None if verdict.value != verdict.value else verdict.value
    return {
        "criterion": verdict.criterion.text,
        "pedestrian": verdict.pedestrian,
        "value": value,
        "failed": verdict.failed,
    }


def _print(report: dict[str, Any], folder: Path) -> None:
    console = Console()
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    heads = (
        "colli-\nsions",
        "vehicle\nmoving",
        "con-\nflicts",
        "evasion\nsuccess",
        "hard\nbraking",
        "time lost\n\\[s]",
    )
    for head in heads:
        view.add_column(head, justify="right")
    for driver, scores in report["drivers"].items():
        view.add_section()
        view.add_row({ADS: "the ADS", BASELINE: "rule-based autopilot"}[driver], style="bold")
        for name, row in scores.items():
            view.add_row(f"  {TITLES[name]}", *(_cell(row[measure]["value"], measure) for measure in _SHOWN))
    console.print(view)
    for text in report["failures"]:
        console.print(f"FAILED  {text}", style="bold red", markup=False)
    if not report["failures"]:
        console.print("passed" if report["criteria"] else "no criterion was given (--fail-if)")
    console.print(f"with intervals and differences: {folder / 'report.html'}", markup=False)


def _cell(value: float | None, measure: str) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if measure == "time_lost" else f"{100.0 * value:.1f}%"
