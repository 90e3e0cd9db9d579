"""An exam's result on the terminal."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.report import ADS, BASELINE, FAILED_BEFORE

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
