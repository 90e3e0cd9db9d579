"""Criteria to fail by, and the comparison with an earlier exam: episodes fixed, newly broken or unchanged."""

import difflib
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation import statistics
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.measures import COLUMNS, EPISODES, OLDER
from vpsci_ros.exam.report import (
    ADS,
    CHANGES,
    COUNTS,
    FAILED_BEFORE,
    INCREASES,
    as_dict,
    differences,
    value_of,
)
from vpsci_ros.exam.scores import MEASURES
from vpsci_ros.policy.config import LEARNED
from vpsci_ros.runs.identity import require_same
from vpsci_ros.view.episode_sources import EXAM

_KEY = ["scenario", "episode"]
_SAME = ("outcome", "duration", "driven", "impact_speed", "least_curvttc", "hardest_braking")


class Earlier(NamedTuple):
    """An earlier exam.

    :ivar rows: of its driving system, a row an episode.
    """

    folder: Path
    ads: str
    rows: pl.DataFrame


def compared_with(exam: Exam, identity: Mapping[str, Any], folder: Path) -> Earlier:
    """Return the earlier exam with which an exam is compared.

    :param identity: of the exam.
    :param folder: of the earlier exam.
    :raises InvalidInput: it is no exam that is over, or had other episodes, pedestrians or thresholds.
    """
    if not (folder / EPISODES).is_file():
        raise InvalidInput(f"--baseline {folder}: no exam that is over; expected {EPISODES} in it")
    stored = read_json(folder / EXAM)
    require_form(stored, {"ads": str, "parameters": {"*": dict}}, f"{folder / EXAM}: not what an exam writes")
    advice = "give this exam the same --params and --set"
    require_same(f"--baseline {folder}", _conditions(stored), _conditions(identity), "is an exam", advice)
    table = read_parquet(folder / EPISODES, "the episodes of an exam", COLUMNS, OLDER)
    rows = table.filter((pl.col("driver") == ADS) & pl.col("pedestrian").is_in(exam.config.opponents))
    return Earlier(folder, stored["ads"], rows)


def _conditions(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return what two exams must have in common to be compared: all but the driving system and the software."""
    kept = {
        name: identity.get(name)
        for name in ("world", "scenarios_sha256", "weights_sha256", "agents", "recorded_sha256")
    }
    left_out = ("ads", "ads_class", "bags", "baseline", "only", "recorded")
    return kept | {
        section: {name: value for name, value in values.items() if name not in left_out}
        for section, values in identity["parameters"].items()
    }


def compare(table: pl.DataFrame, earlier: Earlier, exam: Exam) -> dict[str, Any]:
    """Return the verdict as JSON values, by pedestrian.

    :param table: a row an episode, of the exam.
    """
    failure = exam.config.failure
    now = table.filter((pl.col("driver") == ADS) & pl.col("pedestrian").is_in(exam.config.opponents))
    out = {}
    for name in exam.config.opponents:
        new, old = (rows.filter(pl.col("pedestrian") == name) for rows in (now, earlier.rows))
        both = new.join(old, on=_KEY, suffix="_before").sort(_KEY)
        if both.is_empty():
            continue
        fails, failed = pl.col(failure), pl.col(f"{failure}_before")
        listed = {"fixed": failed & ~fails, "newly_failed": fails & ~failed, "still_failing": fails & failed}
        episodes = {kind: [f"{s}:{e}" for s, e in both.filter(which).select(_KEY).iter_rows()]
                    for kind, which in listed.items()}  # fmt: skip
        passed = both.filter(~failed)
        same = pl.all_horizontal(pl.col(column).eq_missing(pl.col(f"{column}_before")) for column in _SAME)
        out[name] = {
            "episodes": both.height,
            "same": both.filter(same).height,
            **episodes,
            "fixed_rate": as_dict(statistics.share(len(episodes["fixed"]), both.height - passed.height)),
            "newly_failed_rate": as_dict(statistics.share(len(episodes["newly_failed"]), passed.height)),
            "differences": differences(new, old),
        }
    facts = {"folder": earlier.folder.name, "ads": earlier.ads, "failure": failure}
    return facts | {"pedestrians": out}


# ---- Criteria such as "collision_rate > 0.05 @learned": parsed without evaluating anything, then checked on a
# report.


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
    """A reason to fail: a measure compared with a limit, with one pedestrian, or (None) with any of them."""

    text: str
    measure: str
    operator: str
    limit: float
    pedestrian: str | None


def parse(text: str, opponents: Sequence[str], *, compared: bool = False) -> Criterion:
    """Return the criterion that `text` means.

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
    """Return a verdict for each criterion and pedestrian that it speaks of, as JSON values.

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
        f"{verdict['criterion']}: {value} with {verdict['pedestrian']}, {'failed' if verdict['failed'] else 'passed'}"
    )
