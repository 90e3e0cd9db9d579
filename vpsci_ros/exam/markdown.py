"""The verdict of an exam as Markdown for a merge request (summary.md), with links into the page of its episodes."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.exam.comparison import Failing
from vpsci_ros.exam.exam import ADS, BASELINE, title_of
from vpsci_ros.exam.power import can_see
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.exam.timing import sentence
from vpsci_ros.runs.files import write_text

SUMMARY = "summary.md"
_LISTED = 20  # episodes of a kind
_SHOWN = ("collision_rate", "moving_collision_rate", "conflict_rate", "arrived_rate", "time_lost")
_KINDS = {"newly_failed": "Newly broken", "still_failing": "Still failing", "fixed": "Fixed", "failing": "Failing"}


def write_summary(folder: Path, report: Mapping[str, Any], failing: Failing, view: str) -> None:
    """Write the summary of an exam into its folder.

    :param report: what report.json holds; `failing`: see `vpsci_ros.exam.comparison.failing`.
    :param view: the page in which the episodes play; empty: there is none.
    """
    write_text(folder / SUMMARY, "\n".join(_summary(report, failing, view)) + "\n")


def _summary(report: Mapping[str, Any], failing: Failing, view: str) -> Iterator[str]:
    """Yield the lines of the summary."""
    yield from (f"## {_plain(report['exam']['ads'])}: {'failed' if report['failures'] else 'passed'}", "")
    yield from [f"- {_plain(reason)}" for reason in report["failures"]] + [""] * bool(report["failures"])
    if found := report["alone"]:
        yield from (f"On the empty road the system arrives in {found['arrived']} of {found['of']} episodes.", "")
    yield from (sentence(report), "")
    yield from _changes(report["against"]) if "against" in report else _values(report, failing)
    beside = BASELINE if BASELINE in report["drivers"] else ""
    for kind, title in _KINDS.items():
        links = [_link(view, name, key, beside) for name, row in failing.items() for key in row.get(kind, [])]
        more = f" and {len(links) - _LISTED} more" if len(links) > _LISTED else ""
        yield from ["", f"{title}: {', '.join(links[:_LISTED])}{more}"] if links else []


def _changes(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines that compare the exam with an earlier one."""
    yield (
        f"Compared with {_plain(found['ads'])} in {_plain(found['folder'])}. A failure: {_failure(found['failure'])}. "
        "Changes are of the same episodes in pairs, new minus old, with 95% intervals; bold where the interval leaves "
        "out 0.\n"
    )
    heads = ["pedestrian", "episodes", "unchanged", "fixed", "newly broken", "still failing"]
    yield from _head([*heads, *(MEASURES[name].title for name in _SHOWN)])
    for name, row in found["pedestrians"].items():
        counts = [len(row[kind]) for kind in ("fixed", "newly_failed", "still_failing")]
        cells = [title_of(name), row["episodes"], row["same"], *counts]
        yield _row([*cells, *(_change(row["differences"][measure], measure) for measure in _SHOWN)])
    yield "\nWhat these episodes can see (in 4 of 5 exams):\n"
    for name, row in found["pedestrians"].items():
        seen = {MEASURES[measure].title: can_see(row["differences"][measure], measure) for measure in _SHOWN}
        told = "; ".join(f"{text} in {title}" for title, text in seen.items() if text)
        yield f"- {title_of(name)}: {told or 'nothing is known, for they are too few'}"
    if names := found["not_compared"]:
        yield f"\nNot compared, for want of an episode in common: {', '.join(map(title_of, names))}"


def _values(report: Mapping[str, Any], failing: Failing) -> Iterator[str]:
    """Yield the lines that give the exam's own results."""
    if not (rows := report["drivers"].get(ADS, {})):
        return
    yield f"A failure: {_failure(report['failure'])}. Values are with 95% intervals.\n"
    yield from _head(["pedestrian", "episodes", "failing", *(MEASURES[name].title for name in _SHOWN)])
    for name, row in rows.items():
        cells = [title_of(name), row["episodes"], len(failing[name]["failing"])]
        yield _row([*cells, *(_interval(row[measure], measure) for measure in _SHOWN)])


def _plain(text: str) -> str:
    """Return Markdown that shows a text as it is, in one line: what a driving system says is no markup."""
    return re.sub(r"([\\`*\[\]<&|~$]|(?<!\w)_|_(?!\w))", r"\\\1", " ".join(text.split()))


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


def _link(view: str, pedestrian: str, key: str, beside: str) -> str:
    target = f"({view}#a={ADS}-{pedestrian}&b={beside and f'{beside}-{pedestrian}'}&episode={key})"
    return f"[{pedestrian} {key}]{target}" if view else f"{pedestrian} {key}"
