"""An exam's report: a self-contained HTML page, and a table on the terminal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam import picture
from vpsci_ros.exam.criteria import verdict_value
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, PERSON, TITLES, added_pedestrians, title_of
from vpsci_ros.exam.measures import worst_first
from vpsci_ros.exam.power import can_see
from vpsci_ros.exam.report import FAILED_BEFORE
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES
from vpsci_ros.exam.timing import sentence
from vpsci_ros.exam.view import MARKS
from vpsci_ros.policy.policy_config import LEARNED
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
    """Write the report page to `path`.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    :param view: the page beside it in which the episodes play; empty: there is none, and so no link.
    """
    values: dict[str, Any] = {"rates": None, "must_see": []}
    if report["drivers"].get(ADS):
        seen = must_see(table)
        drawn = {"rates": picture.rates(report), "distances": picture.distances(seen, episodes)}
        values = {"must_see": list(zip(seen, picture.COLOURS, strict=False))} | drawn | _summary(report)
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Exam of {report['exam']['ads']}",
        report=report,
        titles={name: title_of(name) for name in (*TITLES, *added_pedestrians())},
        names=NAMES | ({ADS: "You"} if report["exam"]["ads"] == PERSON else {}),
        differences=DIFFERENCES,
        verdict_value=verdict_value,
        can_see=can_see,
        changes=_changes(report),
        widest=_widest,
        grouped=GROUPED,
        view=view,
        marks=set(MARKS),
        timing=sentence(report),
        size=picture,
        **values,
    )


def _changes(report: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what got worse and better against the earlier exam or, without one, the autopilot; None without either.

    `worse` and `better`: measure -> pedestrian -> change, of changes that show. `unclear`: pedestrian -> titles of all
    other measures. `failure`: pedestrian -> how large a change of the failures would show; "" where that is not known.
    `episodes`: pedestrian -> row of the comparison with the earlier exam.
    """
    pedestrians = report["against"]["pedestrians"] if "against" in report else {}
    found = {name: row["differences"] for name, row in pedestrians.items()} or report["beside"]
    if not found:
        return None
    changes: dict[str, dict[str, dict[str, Any]]] = {"worse": {}, "better": {}}
    unclear: dict[str, list[str]] = {}
    for measure in DIFFERENCES:
        for pedestrian, rows in found.items():
            if (row := rows[measure])["value"] is None:
                continue
            if row["low"] <= 0.0 <= row["high"]:
                unclear.setdefault(pedestrian, []).append(MEASURES[measure].title)
            else:
                kind = "worse" if (row["value"] > 0.0) == (MEASURES[measure].good == "low") else "better"
                changes[kind].setdefault(measure, {})[pedestrian] = row
    failure = f"{report['failure']}_rate"
    seen = {name: can_see(rows[failure], failure) for name, rows in found.items()}
    seen = {name: f"{text} in {MEASURES[failure].title}" if text else "" for name, text in seen.items()}
    against = report["against"]["folder"] if pedestrians else "the rule-based autopilot"
    return {"against": against, "unclear": unclear, "failure": seen, "episodes": pedestrians} | changes


def _widest(rows: Mapping[str, Mapping[str, Any]], measure: str) -> str:
    """Return, in words, how large a change would show with every one of these pedestrians."""
    return can_see(max(rows.values(), key=lambda row: row["detectable"] or 0.0), measure)


def _summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the first paragraph is about: the default pedestrian where the exam has it, else the first one."""
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
    """Return the rows of at most three episodes of the ADS worth seeing, each with the reason as `why`."""
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


def print_report(report: Mapping[str, Any], page: Path) -> None:
    """Print the measures of the ADS and the autopilot with each pedestrian, and the verdict.

    :param page: the report page, which the last line names.
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
        seen = can_see(row["differences"][measure := f"{report['failure']}_rate"], measure)
        text = f"against {report['against']['folder']}, {title_of(name)}: {counts}{'; ' if seen else ''}{seen}"
        console.print(text, markup=False, highlight=False)
    for name in report.get("against", {}).get("not_compared", []):
        text = f"against {report['against']['folder']}, {title_of(name)}: no episode in common, nothing is compared"
        console.print(text, markup=False)
    if found := report["range"]:
        console.print(
            f"{found['beyond']} of {found['of']} critical episodes with the default pedestrian begin beyond the range "
            "of its recorded reactions",
            markup=False,
            highlight=False,
        )
    for text in report["failures"]:
        console.print(f"FAILED  {text}", style="bold red", markup=False)
    if not report["failures"]:
        console.print("passed" if report["criteria"] else "no criterion was given (--fail-if)")
    console.print(f"with intervals and differences: {page}", markup=False)


def _cell(value: float | None, measure: str) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if measure == "time_lost" else f"{100.0 * value:.1f}%"
