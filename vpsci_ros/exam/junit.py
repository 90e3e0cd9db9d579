"""The verdict of an exam as JUnit XML (junit.xml), for continuous integration."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.exam.comparison import Failing
from vpsci_ros.exam.criteria import verdict_value
from vpsci_ros.exam.exam import ADS
from vpsci_ros.exam.report import standing
from vpsci_ros.exam.timing import not_met
from vpsci_ros.runs.files import write_text

JUNIT = "junit.xml"
_SUITE = "vpsci ads-test"


class Case(NamedTuple):
    """One test case.

    :ivar kind: "failure", "skipped" or "" (passed).
    :ivar properties: name -> value, such as scenario and episode, or the requirement that it verifies.
    :ivar lists: episodes that the case is about, "1:4".
    """

    suite: str
    name: str
    kind: str = ""
    message: str = ""
    properties: Mapping[str, str] = {}
    lists: Sequence[str] = ()


def write_junit(folder: Path, report: Mapping[str, Any], failing: Failing) -> None:
    """Write the JUnit XML of an exam into its folder.

    :param report: what report.json holds; `failing`: see `vpsci_ros.exam.comparison.failing`.
    """
    write_text(folder / JUNIT, _junit(report, failing) + "\n")


def _junit(report: Mapping[str, Any], failing: Failing) -> str:
    """Return the verdict as JUnit XML: a case for each criterion, and what is said of the episodes.

    Compared with an earlier exam each episode that fails now or failed before is a case: what failed before and still
    does is skipped, and what is newly broken is a failure. Otherwise each pedestrian is one case, which passes, and
    counts and lists the failing episodes: by its criteria alone the exam fails.
    """
    cases = [Case("exam", "every episode was driven", *_driven(report))]
    if found := report["alone"]:
        name = f"arrived in {found['arrived']} of {found['of']} episodes on the empty road"
        stands = standing(report)
        cases.append(Case("exam", name, "failure" if stands in report["failures"] else "", stands))
    if report["timing"]:
        missed = [reason for reason in not_met(report) if reason in report["failures"]]
        cases.append(Case("exam", "met the pedestrians as timed", "failure" if missed else "", "; ".join(missed)))
    for name, row in report["drivers"].get(ADS, {}).items():
        count = round((row["arrived_rate"]["value"] or 0.0) * row["episodes"])
        cases.append(Case(name, f"arrived in {count} of {row['episodes']} episodes"))
    for row in report["criteria"]:
        name = row["criterion"] if "@" in row["criterion"] else f"{row['criterion']} @{row['pedestrian']}"
        of = {"requirement": row["requirement"]} if row.get("requirement") else {}
        of |= {"pedestrian": row["pedestrian"], "value": verdict_value(row)}
        cases.append(Case("exam", name, "failure" if row["failed"] else "", f"it is {verdict_value(row)}", of))
    cases += _compared(report["against"]) if "against" in report else _counted(report, failing)
    suites = ET.Element("testsuites", name=_SUITE)
    for suite in dict.fromkeys(case.suite for case in cases):
        _add_suite(suites, suite, [case for case in cases if case.suite == suite])
    ET.indent(suites)
    return ET.tostring(suites, "unicode", xml_declaration=True)


def _driven(report: Mapping[str, Any]) -> tuple[str, str]:
    reasons = [row["failure"] for row in report["conduct"].values() if row["failure"]]
    return ("failure", "; ".join(reasons)) if reasons else ("", "")


def _compared(found: Mapping[str, Any]) -> Iterator[Case]:
    says = {"fixed": ("", ""), "newly_failed": ("failure", f"{found['failure']}; not so in {found['folder']}"),
            "still_failing": ("skipped", f"{found['failure']}, as in {found['folder']}")}  # fmt: skip
    for name, row in found["pedestrians"].items():
        yield from (_episode(name, key, *says[kind]) for kind in says for key in row[kind])
        if not any(row[kind] for kind in says):
            yield Case(name, f"{row['episodes']} episodes, none of which fails")


def _episode(pedestrian: str, key: str, kind: str, message: str) -> Case:
    scenario, episode = key.split(":")
    of = {"pedestrian": pedestrian, "scenario": scenario, "episode": episode}
    return Case(pedestrian, f"scenario {scenario}, episode {episode}", kind, message, of)


def _counted(report: Mapping[str, Any], failing: Failing) -> Iterator[Case]:
    for name, row in failing.items():
        episodes, count = report["drivers"][ADS][name]["episodes"], len(row["failing"])
        text = f"{episodes} episodes, {count or 'none'} of which fail{'s' * (count < 2)}"
        yield Case(name, text, properties={"pedestrian": name}, lists=row["failing"])


def _add_suite(suites: ET.Element, suite: str, cases: list[Case]) -> None:
    element = ET.SubElement(suites, "testsuite", name=suite, tests=str(len(cases)), errors="0")
    for head, kind in (("failures", "failure"), ("skipped", "skipped")):
        element.set(head, str(sum(case.kind == kind for case in cases)))
    for case in cases:
        test = ET.SubElement(element, "testcase", classname=f"{_SUITE}.{suite}", name=case.name)
        if case.properties:
            properties = ET.SubElement(test, "properties")
            for name, value in case.properties.items():
                ET.SubElement(properties, "property", name=name, value=value)
        if case.kind:
            ET.SubElement(test, case.kind, message=case.message)
        if case.lists:
            ET.SubElement(test, "system-out").text = f"failing (scenario:episode): {' '.join(case.lists)}"
