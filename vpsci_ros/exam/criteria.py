"""Criteria such as "SR-12: collision_rate > 0.05 @learned": parsed without evaluating code, compared with a report."""

import difflib
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ADS, title_of
from vpsci_ros.exam.report import CHANGES, COUNTS, FAILED_BEFORE, INCREASES, value_of
from vpsci_ros.exam.scores import MEASURES, NO_CONTACT
from vpsci_ros.policy.policy_config import LEARNED

COMPARED = (*FAILED_BEFORE, *CHANGES)
NAMES = (*MEASURES, *INCREASES, *COUNTS, *COMPARED)
OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FORM = re.compile(rf"(?:\s*(\S.*?)\s*:\s)?\s*(\w+)\s*(>=|<=|>|<)\s*({_NUMBER})\s*(?:@\s*(\w+)\s*)?")


class Criterion(NamedTuple):
    """A criterion: a measure compared with a limit, for one pedestrian or (None) for each of them.

    :ivar requirement: the user's label of the requirement that it verifies; "" without one.
    """

    text: str
    measure: str
    operator: str
    limit: float
    pedestrian: str | None
    requirement: str = ""


def parse(text: str, opponents: Sequence[str], *, compared: bool = False) -> Criterion:
    """Return the criterion written as `text`.

    :param opponents: pedestrians of the exam.
    :param compared: whether it is compared with an earlier one.
    :raises InvalidInput: another form than [REQUIREMENT: ]MEASURE OPERATOR NUMBER [@PEDESTRIAN], or an unknown name.
    """
    where = f"--fail-if {text!r}"
    found = _FORM.fullmatch(text)
    if found is None:
        raise InvalidInput(
            f"{where}: expected [REQUIREMENT: ]MEASURE {{{','.join(OPERATORS)}}} NUMBER [@PEDESTRIAN], such as "
            f"'collision_rate > 0.05 @learned'; measures: {', '.join(NAMES)}"
        )
    requirement, measure, sign, number, pedestrian = found.groups()
    if measure not in NAMES:
        near = difflib.get_close_matches(measure, NAMES, 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise InvalidInput(f"{where}: unknown measure {measure!r}; {hint}measures: {', '.join(NAMES)}")
    if pedestrian is not None and pedestrian not in opponents:
        raise InvalidInput(f"{where}: no pedestrian {pedestrian!r} in this exam; it has {', '.join(opponents)}")
    if measure in INCREASES and (LEARNED not in opponents or pedestrian == LEARNED or len(opponents) < 2):
        raise InvalidInput(f"{where}: {measure} compares another pedestrian with {LEARNED}; the exam needs both")
    if measure in COMPARED and not compared:
        raise InvalidInput(f"{where}: {measure} compares with an earlier exam; name its folder by --baseline")
    if _is_share(measure) and abs(float(number)) > 1.0:
        raise InvalidInput(f"{where}: {measure} is a share, 0 to 1; expected a NUMBER like 0.05 for 5%, got {number}")
    if requirement and not requirement.isprintable():
        raise InvalidInput(f"{where}: the label of the requirement has unprintable characters")
    return Criterion(" ".join(text.split()), measure, sign, float(number), pedestrian, requirement or "")


def _is_share(measure: str) -> bool:
    """Return whether a measure is a share of episodes, or a difference of two."""
    of = INCREASES.get(measure) or (CHANGES[measure][0] if measure in CHANGES else measure)
    return of in MEASURES and not MEASURES[of].unit


def check(criteria: Sequence[Criterion], report: dict[str, Any], opponents: Sequence[str]) -> list[dict[str, Any]]:
    """Return a verdict for each criterion and each of its pedestrians, as JSON values.

    A measure without a value counts as a failure: the criterion cannot be shown not to hold. The exception is a measure
    of contacts, of episodes among which there was no contact.
    """
    verdicts = []
    for text, measure, sign, limit, pedestrian, requirement in criteria:
        among = [pedestrian] if pedestrian else list(opponents)
        for name in among if pedestrian or measure not in INCREASES else [each for each in among if each != LEARNED]:
            verdict: dict[str, Any] = {"criterion": text, "requirement": requirement, "pedestrian": name}
            if math.isnan(value := value_of(report, measure, name)):
                none = _without_value(report, measure, name)
                verdict |= {"value": None, "why": none, "failed": none != NO_CONTACT}
            else:
                verdict |= {"value": value, "why": "", "failed": OPERATORS[sign](value, limit)}
            verdicts.append(verdict)
    return verdicts


def limits(verdicts: Sequence[Mapping[str, Any]], measure: str) -> dict[str, float]:
    """Return pedestrian -> limit of the verdicts about a measure."""
    found = ((verdict["pedestrian"], _FORM.fullmatch(verdict["criterion"])) for verdict in verdicts)
    return {pedestrian: float(form[4]) for pedestrian, form in found if form and form[2] == measure}


def _without_value(report: Mapping[str, Any], measure: str, pedestrian: str) -> str:
    """Return the reason for which a measure would have no value."""
    if pedestrian not in report["drivers"].get(ADS, {}):
        return "no episode was driven"
    if measure in CHANGES:
        return "too few episodes that count in both exams"
    return MEASURES[measure].none if measure in MEASURES else "not measured"


def verdict_value(verdict: Mapping[str, Any]) -> str:
    """Return the value of a verdict in words, such as "0.0385" or "no contact"."""
    return f"{verdict['value']:.4g}" if verdict["value"] is not None else verdict.get("why") or "not measured"


def sentence(verdict: Mapping[str, Any]) -> str:
    """Return a verdict in words."""
    return (
        f"{verdict['criterion']}: {verdict_value(verdict)} ({title_of(verdict['pedestrian'])}), "
        f"{'failed' if verdict['failed'] else 'passed'}"
    )
