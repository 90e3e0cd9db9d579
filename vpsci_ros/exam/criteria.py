"""Criteria such as "collision_rate > 0.05 @learned": parsed without evaluating code, then compared with a report."""

import difflib
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.report import CHANGES, COUNTS, FAILED_BEFORE, INCREASES, value_of
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.policy.config import LEARNED

COMPARED = (*FAILED_BEFORE, *CHANGES)
NAMES = (*MEASURES, *INCREASES, *COUNTS, *COMPARED)
OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FORM = re.compile(rf"\s*(\w+)\s*(>=|<=|>|<)\s*({_NUMBER})\s*(?:@\s*(\w+)\s*)?")


class Criterion(NamedTuple):
    """A criterion: a measure compared with a limit, for one pedestrian or (None) for each of them."""

    text: str
    measure: str
    operator: str
    limit: float
    pedestrian: str | None


def parse(text: str, opponents: Sequence[str], *, compared: bool = False) -> Criterion:
    """Return the criterion written as `text`.

    :param opponents: pedestrians of the exam.
    :param compared: whether it is compared with an earlier one.
    :raises InvalidInput: another form than MEASURE OPERATOR NUMBER [@PEDESTRIAN], or an unknown name in it.
    """
    where = f"--fail-if {text!r}"
    found = _FORM.fullmatch(text)
    if found is None:
        raise InvalidInput(
            f"{where}: expected MEASURE {{{','.join(OPERATORS)}}} NUMBER [@PEDESTRIAN], such as "
            f"'collision_rate > 0.05 @learned'; measures: {', '.join(NAMES)}"
        )
    measure, sign, number, pedestrian = found.groups()
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
    return Criterion(" ".join(text.split()), measure, sign, float(number), pedestrian)


def check(criteria: Sequence[Criterion], report: dict[str, Any], opponents: Sequence[str]) -> list[dict[str, Any]]:
    """Return a verdict for each criterion and each of its pedestrians, as JSON values.

    A measure without a value counts as a failure: the criterion cannot be shown not to hold.
    """
    verdicts = []
    for text, measure, sign, limit, pedestrian in criteria:
        among = [pedestrian] if pedestrian else list(opponents)
        for name in among if pedestrian or measure not in INCREASES else [each for each in among if each != LEARNED]:
            value = value_of(report, measure, name)
            failed = math.isnan(value) or OPERATORS[sign](value, limit)
            known = None if math.isnan(value) else value
            verdicts.append({"criterion": text, "pedestrian": name, "value": known, "failed": failed})
    return verdicts


def sentence(verdict: Mapping[str, Any]) -> str:
    """Return a verdict in words."""
    value = "not measured" if verdict["value"] is None else f"{verdict['value']:.4g}"
    return (
        f"{verdict['criterion']}: {value} ({title_of(verdict['pedestrian'])}), "
        f"{'failed' if verdict['failed'] else 'passed'}"
    )
