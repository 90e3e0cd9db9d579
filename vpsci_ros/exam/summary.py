"""The summary of an exam for a merge request, as Markdown."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.exam import earlier, failures, protocol
from vpsci_ros.runs.files import write_text


def write_summary(path: Path, report: Mapping[str, Any], view: str) -> None:
    """Write the verdict, and what the exam has beside its measures, as Markdown for a merge request.

    Without anything beside its measures there is none.

    :param view: the page in which episodes play; empty: there is none.
    """
    if not any(part in report for part in ("against", "why", "protocol")):
        return
    text = [f"## {report['exam']['ads']}: {'failed' if report['failures'] else 'passed'}", ""]
    text += [f"- {reason}" for reason in report["failures"]] + [""] * bool(report["failures"])
    text += earlier.summary_lines(report, view) if "against" in report else []
    text += ["", *failures.summary_lines(report["why"], view)] if "why" in report else []
    text += ["", *protocol.summary_lines(report["protocol"])] if "protocol" in report else []
    write_text(path, "\n".join(text) + "\n")
