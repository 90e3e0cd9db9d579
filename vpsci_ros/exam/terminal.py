"""An exam's results as a table on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from vpsci_ros.exam.exam import ADS, BASELINE, title_of
from vpsci_ros.exam.power import can_see
from vpsci_ros.exam.report import FAILED_BEFORE
from vpsci_ros.runs.text_table import table_console

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


def print_report(report: Mapping[str, Any], page: Path) -> None:
    """Print the measures of the ADS and the autopilot with each pedestrian, and the verdict.

    :param page: the report page, which the last line names.
    """
    console = table_console()
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
