"""What an exam leaves for continuous integration: its verdict as Markdown (summary.md) and as JUnit XML (junit.xml).

Both are written by every exam that has a report, with an earlier exam to compare with or without one.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.report import ADS, BASELINE
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.runs.files import write_text

SUMMARY, JUNIT = "summary.md", "junit.xml"
_LISTED = 20  # episodes of a kind in the summary
_SHOWN = ("collision_rate", "moving_collision_rate", "conflict_rate", "time_lost")
_KINDS = {"newly_failed": "Newly broken", "still_failing": "Still failing", "fixed": "Fixed", "failing": "Failing"}
_SUITE = "vpsci ads-test"
Case = tuple[str, str, str, str]
"""Suite, name, "failure", "skipped" or "" (passed), and the message."""


Listed = Mapping[str, Mapping[str, list[str]]]
"""Pedestrian -> kind of `_KINDS` -> its episodes, "1:4"."""


def write_verdict(folder: Path, report: Mapping[str, Any], table: pl.DataFrame, view: str) -> None:
    """Write the summary and the JUnit XML of an exam into its folder.

    :param report: what report.json holds.
    :param table: a row an episode.
    :param view: the page in which the episodes play; empty: there is none.
    """
    listed = report["against"]["pedestrians"] if "against" in report else _failing(report, table)
    write_text(folder / SUMMARY, "\n".join(_summary(report, listed, view)) + "\n")
    write_text(folder / JUNIT, _junit(report, listed) + "\n")


def _failing(report: Mapping[str, Any], table: pl.DataFrame) -> Listed:
    """Return the episodes in which the driving system fails."""
    failed = table.filter((pl.col("driver") == ADS) & pl.col(report["failure"])).sort("scenario", "episode")
    episodes = {name: failed.filter(pl.col("pedestrian") == name) for name in report["drivers"].get(ADS, {})}
    return {name: {"failing": [f"{s}:{e}" for s, e in rows.select("scenario", "episode").iter_rows()]}
            for name, rows in episodes.items()}  # fmt: skip


# ---- Markdown for a merge request, with links to where the episodes play.


def _summary(report: Mapping[str, Any], listed: Listed, view: str) -> Iterator[str]:
    """Yield the lines of the summary."""
    yield from (f"## {report['exam']['ads']}: {'failed' if report['failures'] else 'passed'}", "")
    yield from [f"- {reason}" for reason in report["failures"]] + [""] * bool(report["failures"])
    yield from _changes(report["against"]) if "against" in report else _values(report, listed)
    for kind, title in _KINDS.items():
        links = [_link(view, name, key) for name, row in listed.items() for key in row.get(kind, [])]
        more = f" and {len(links) - _LISTED} more" if len(links) > _LISTED else ""
        yield from ["", f"{title}: {', '.join(links[:_LISTED])}{more}"] if links else []


def _changes(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines that compare the exam with an earlier one."""
    yield (
        f"Compared with `{found['ads']}` in {found['folder']}. A failure: {_failure(found['failure'])}. Changes are of "
        "the same episodes in pairs, new less old, with 95% intervals; bold where the interval leaves out 0.\n"
    )
    heads = ["pedestrian", "episodes", "as before", "fixed", "newly broken", "still failing"]
    yield from _head([*heads, *(MEASURES[name].title for name in _SHOWN)])
    for name, row in found["pedestrians"].items():
        counts = [len(row[kind]) for kind in ("fixed", "newly_failed", "still_failing")]
        cells = [title_of(name), row["episodes"], row["same"], *counts]
        yield _row([*cells, *(_change(row["differences"][measure], measure) for measure in _SHOWN)])


def _values(report: Mapping[str, Any], listed: Listed) -> Iterator[str]:
    """Yield the lines that give the exam's own results."""
    yield f"A failure: {_failure(report['failure'])}. Values are with 95% intervals.\n"
    yield from _head(["pedestrian", "episodes", "failing", *(MEASURES[name].title for name in _SHOWN)])
    for name, row in report["drivers"].get(ADS, {}).items():
        cells = [title_of(name), row["episodes"], len(listed[name]["failing"])]
        yield _row([*cells, *(_interval(row[measure], measure) for measure in _SHOWN)])


def _failure(column: str) -> str:
    return MEASURES[f"{column}_rate"].title


def _head(cells: list[str]) -> list[str]:
    return [_row(cells), "|---" * len(cells) + "|"]


def _row(cells: list[Any]) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _interval(found: Mapping[str, Any], measure: str, form: str = ".2f", unit: str = "%") -> str:
    if found["value"] is None:
        return "-"
    scale, unit = (1.0, MEASURES[measure].unit) if MEASURES[measure].unit else (100.0, unit)
    value, low, high = (scale * found[name] for name in ("value", "low", "high"))
    return f"{value:{form}} [{low:.2f}, {high:.2f}] {unit}"


def _change(found: Mapping[str, Any], measure: str) -> str:
    text = _interval(found, measure, "+.2f", "points")
    bold = "**" if found["value"] is not None and (found["low"] > 0.0 or found["high"] < 0.0) else ""
    return f"{bold}{text}{bold}"


def _link(view: str, pedestrian: str, key: str) -> str:
    target = f"({view}#a={ADS}-{pedestrian}&b={BASELINE}-{pedestrian}&episode={key})"
    return f"[{pedestrian} {key}]{target}" if view else f"{pedestrian} {key}"


# ---- JUnit XML.


def _junit(report: Mapping[str, Any], listed: Listed) -> str:
    """Return the verdict as JUnit XML: a case for each criterion, and what is said of the episodes.

    Compared with an earlier exam each episode that fails now or failed before is a case: what failed before and still
    does is skipped, and what is newly broken is a failure. Otherwise each pedestrian is one case, which passes and
    counts the failing episodes: by its criteria alone the exam fails.
    """
    cases: list[Case] = [("exam", "every episode was driven", *_driven(report))]
    for row in report["criteria"]:
        name = row["criterion"] if "@" in row["criterion"] else f"{row['criterion']} @{row['pedestrian']}"
        cases.append(("exam", name, "failure" if row["failed"] else "", f"it is {row['value']}"))
    cases += _compared(report["against"]) if "against" in report else _counted(report, listed)
    suites = ET.Element("testsuites", name=_SUITE)
    for suite in dict.fromkeys(case[0] for case in cases):
        _add_suite(suites, suite, [case for case in cases if case[0] == suite])
    ET.indent(suites)
    return ET.tostring(suites, "unicode", xml_declaration=True)


def _driven(report: Mapping[str, Any]) -> tuple[str, str]:
    reasons = [row["failure"] for row in report["conduct"].values() if row["failure"]]
    return ("failure", "; ".join(reasons)) if reasons else ("", "")


def _compared(found: Mapping[str, Any]) -> Iterator[Case]:
    says = {"fixed": ("", ""), "newly_failed": ("failure", f"{found['failure']}; not so in {found['folder']}"),
            "still_failing": ("skipped", f"{found['failure']}, as in {found['folder']}")}  # fmt: skip
    for name, row in found["pedestrians"].items():
        yield from ((name, key, *says[kind]) for kind in says for key in row[kind])
        if not any(row[kind] for kind in says):
            yield name, f"{row['episodes']} episodes, none of which fails", "", ""


def _counted(report: Mapping[str, Any], listed: Listed) -> Iterator[Case]:
    for name, row in listed.items():
        episodes, failing = report["drivers"][ADS][name]["episodes"], len(row["failing"])
        yield name, f"{episodes} episodes, {failing or 'none'} of which fail{'s' * (failing < 2)}", "", ""


def _add_suite(suites: ET.Element, suite: str, cases: list[Case]) -> None:
    element = ET.SubElement(suites, "testsuite", name=suite, tests=str(len(cases)), errors="0")
    for head, kind in (("failures", "failure"), ("skipped", "skipped")):
        element.set(head, str(sum(case[2] == kind for case in cases)))
    for _, name, kind, message in cases:
        case = ET.SubElement(element, "testcase", classname=f"{_SUITE}.{suite}", name=name)
        if kind:
            ET.SubElement(case, kind, message=message)
