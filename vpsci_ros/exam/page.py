"""An exam's report for people: one HTML page that needs nothing beside it, and a table on the terminal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.config import ALONE, PERSON, TITLES, added_pedestrians, title_of
from vpsci_ros.exam.figures import save_one, save_overview
from vpsci_ros.exam.measures import worst_first
from vpsci_ros.exam.report import ADS, BASELINE, FAILED_BEFORE
from vpsci_ros.exam.scores import DIFFERENCES
from vpsci_ros.exam.view import MARKS
from vpsci_ros.policy.config import LEARNED
from vpsci_ros.report import html

NAMES = {ADS: "The ADS", BASELINE: "The rule-based autopilot"}
GROUPED = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
SLOW = 1.0  # [s] of time lost, from which on an episode is one to see
_SHOWN = {
    "collision_rate": "colli-\nsions",
    "moving_collision_rate": "while\nmoving",
    "conflict_rate": "con-\nflicts",
    "arrived_rate": "arri-\nved",
    "never_arrived_rate": "never\narri-\nved",
    "stood_still_rate": "stood\nstill",
    "time_lost": "time\nlost\n\\[s]",
}
"""Measures that are printed, and the heads of their columns."""
_KEY = ["pedestrian", "scenario", "episode"]
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "exam.html"


def write_page(
    path: Path,
    report: Mapping[str, Any],
    table: pl.DataFrame,
    episodes: Mapping[str, Sequence[Episode]],
    view: str = "",
) -> None:
    """Write the page, and its pictures beside it: overview.png, must_see_1.png to must_see_3.png.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    :param view: the page beside it in which the episodes play; empty: there is none, and so no link.
    """
    values: dict[str, Any] = {"overview": None, "must_see": []}
    if report["drivers"].get(ADS):
        overview = path.parent / "overview.png"
        save_overview(report, table, overview)
        values = {"overview": overview} | _summary(report)
        values["must_see"] = _pictured(must_see(table), episodes, path.parent)
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Exam of {report['exam']['ads']}",
        report=report,
        titles={name: title_of(name) for name in (*TITLES, *added_pedestrians())},
        names=NAMES | ({ADS: "You"} if report["exam"]["ads"] == PERSON else {}),
        differences=DIFFERENCES,
        grouped=GROUPED,
        view=view,
        marks=set(MARKS),
        **values,
    )


def _summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the first paragraph is about: the learned pedestrian where the exam has it, else the first one."""
    scores = report["drivers"][ADS]
    first = LEARNED if LEARNED in scores else next(iter(scores))
    reliance = report["reliance"].get(ADS)
    counted = {"collisions": scores[first]["collision_rate"], "moving": scores[first]["moving_collision_rate"]}
    if reliance:
        counted["of_those_collide"] = reliance["of_those_collide"]
    return {
        "first": first,
        "scores": scores[first],
        "beside": report["drivers"].get(BASELINE, {}).get(first),
        "reliance": reliance,
        "counts": {name: round((found["value"] or 0.0) * found["n"]) for name, found in counted.items()},
    }


def must_see(table: pl.DataFrame) -> list[dict[str, Any]]:
    """Return rows of the three episodes of the ADS that one must see, each with the reason as `why`."""
    rows = worst_first(table.filter((pl.col("driver") == ADS) & (pl.col("pedestrian") != ALONE)))
    other = table.filter(pl.col("driver") == BASELINE).select(*_KEY, hit=pl.col("collision"))
    rows = rows.join(other, on=_KEY, how="left", maintain_order="left").with_columns(pl.col("time_lost").fill_nan(0.0))
    missed, slow = rows.filter(~pl.col("collision")), rows.filter(pl.col("time_lost") > SLOW)
    found: list[dict[str, Any]] = []
    for why, those in (
        ("The hardest contact: {impact_speed:.1f} m/s", rows.filter("moving_collision")),
        ("A contact at {impact_speed:.1f} m/s, where the autopilot has none",
         rows.filter(pl.col("moving_collision") & ~pl.col("hit"))),
        ("The nearest without a contact: CurvTTC {least_curvttc:.2f} s", missed.filter("critical")),
        ("The hardest braking without a contact: {hardest_braking:.1f} m/s\u00b2",
         missed.filter("hard_braking").sort("hardest_braking", descending=True, maintain_order=True)),
        ("The most time lost: {time_lost:.1f} s", slow.sort("time_lost", descending=True, maintain_order=True)),
        ("No contact, where the autopilot has one", missed.filter("hit")),
        ("The pedestrian walks into the standing vehicle",
         rows.filter(pl.col("collision") & ~pl.col("moving_collision"))),
    ):  # fmt: skip
        seen = [(row["scenario"], row["episode"]) for row in found]
        new = next((row for row in those.iter_rows(named=True) if (row["scenario"], row["episode"]) not in seen), None)
        if new is not None:
            found.append(new | {"why": why.format(**new)})
    return found[:3]


def _pictured(
    rows: list[dict[str, Any]], episodes: Mapping[str, Sequence[Episode]], folder: Path
) -> list[dict[str, Any]]:
    """Return the rows with a `picture` each, drawn from the episodes of the ADS."""
    out = []
    for number, row in enumerate(rows, start=1):
        key, picture = (row["scenario"], row["episode"]), folder / f"must_see_{number}.png"
        save_one(next(each for each in episodes[row["pedestrian"]] if each.key == key), picture)
        out.append(row | {"picture": picture})
    return out


def print_report(report: Mapping[str, Any], page: Path) -> None:
    """Print the measures of both drivers with each pedestrian, and the verdict.

    :param page: in which the rest stands.
    """
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
    console.print(f"with intervals and differences: {page}", markup=False)


def _cell(value: float | None, measure: str) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if measure == "time_lost" else f"{100.0 * value:.1f}%"
