"""The verdict of an exam as JUnit XML (junit.xml), for continuous integration."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.exam.comparison import Failing
from vpsci_ros.exam.report import ADS, standing
from vpsci_ros.runs.files import write_text

JUNIT = "junit.xml"
_SUITE = "vpsci ads-test"
Case = tuple[str, str, str, str]
"""Suite, name, "failure", "skipped" or "" (passed), and the message."""


def write_junit(folder: Path, report: Mapping[str, Any], failing: Failing) -> None:
    """Write the JUnit XML of an exam into its folder.

    :param report: what report.json holds; `failing`: see `vpsci_ros.exam.comparison.failing`.
    """
    write_text(folder / JUNIT, _junit(report, failing) + "\n")


def _junit(report: Mapping[str, Any], failing: Failing) -> str:
    """Return the verdict as JUnit XML: a case for each criterion, and what is said of the episodes.

    Compared with an earlier exam each episode that fails now or failed before is a case: what failed before and still
    does is skipped, and what is newly broken is a failure. Otherwise each pedestrian is one case, which passes and
    counts the failing episodes: by its criteria alone the exam fails.
    """
    cases: list[Case] = [("exam", "every episode was driven", *_driven(report))]
    if found := report["alone"]:
        name = f"arrived in {found['arrived']} of {found['of']} episodes on the empty road"
        stands = standing(report)
        cases.append(("exam", name, "failure" if stands in report["failures"] else "", stands))
    for name, row in report["drivers"].get(ADS, {}).items():
        count = round((row["arrived_rate"]["value"] or 0.0) * row["episodes"])
        cases.append((name, f"arrived in {count} of {row['episodes']} episodes", "", ""))
    for row in report["criteria"]:
        name = row["criterion"] if "@" in row["criterion"] else f"{row['criterion']} @{row['pedestrian']}"
        cases.append(("exam", name, "failure" if row["failed"] else "", f"it is {row['value']}"))
    cases += _compared(report["against"]) if "against" in report else _counted(report, failing)
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


def _counted(report: Mapping[str, Any], failing: Failing) -> Iterator[Case]:
    for name, row in failing.items():
        episodes, count = report["drivers"][ADS][name]["episodes"], len(row["failing"])
        yield name, f"{episodes} episodes, {count or 'none'} of which fail{'s' * (count < 2)}", "", ""


def _add_suite(suites: ET.Element, suite: str, cases: list[Case]) -> None:
    element = ET.SubElement(suites, "testsuite", name=suite, tests=str(len(cases)), errors="0")
    for head, kind in (("failures", "failure"), ("skipped", "skipped")):
        element.set(head, str(sum(case[2] == kind for case in cases)))
    for _, name, kind, message in cases:
        case = ET.SubElement(element, "testcase", classname=f"{_SUITE}.{suite}", name=name)
        if kind:
            ET.SubElement(case, kind, message=message)
