"""The comparison with an earlier exam: which episodes are fixed, newly or still failing."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from vpsci_ros.documents import listed, read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation import statistics
from vpsci_ros.exam.exam import ADS, EXAM, Exam
from vpsci_ros.exam.measures import EPISODES, read_episode_table
from vpsci_ros.exam.report import FAILED_BEFORE, as_dict, differences, rows_of
from vpsci_ros.runs.identity import require_same

Failing = Mapping[str, Mapping[str, list[str]]]
"""Pedestrian -> "fixed", "newly_failed", "still_failing", or "failing" alone -> episodes, "1:4"."""
_KEY = ["scenario", "episode"]
_SAME = ("outcome", "duration", "driven", "impact_speed", "least_curvttc", "hardest_braking")


class Earlier(NamedTuple):
    """An earlier exam, with which a new exam is compared.

    :ivar rows: of its driving system, a row an episode.
    """

    folder: Path
    ads: str
    rows: pl.DataFrame


def compared_with(exam: Exam, identity: Mapping[str, Any], folder: Path) -> Earlier:
    """Return the earlier exam in `folder`, after a check that `exam` can be compared with it.

    :param identity: of the exam.
    :param folder: of the earlier exam.
    :raises InvalidInput: it is no exam that is over, had other pedestrians or thresholds, or shares no episode.
    """
    for name in (EPISODES, EXAM):
        if not (folder / name).is_file():
            raise InvalidInput(f"--baseline {folder}: no exam that is over; expected {name} in it")
    stored = read_json(folder / EXAM)
    require_form(stored, {"ads": str, "parameters": {"*": dict}}, f"{folder / EXAM}: not what an exam writes")
    advice = "give this exam the same --params and --set"
    require_same(f"--baseline {folder}", conditions_of(stored), conditions_of(identity), "is an exam", advice)
    rows = rows_of(read_episode_table(folder), ADS).filter(pl.col("pedestrian").is_in(exam.config.opponents))
    driven, wanted = (sorted(set(keys)) for keys in (rows.select(_KEY).rows(), exam.episodes))
    if not set(driven) & set(wanted):
        had, has = (listed(f"{scenario}:{episode}" for scenario, episode in keys) for keys in (driven, wanted))
        raise InvalidInput(
            f"--baseline {folder}: no episode in common: that exam drove {had}, and this one has {has}; "
            f"{advice}, or name an exam of the same episodes"
        )
    return Earlier(folder, stored["ads"], rows)


def conditions_of(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of an identity that compared exams share: without driving system and software."""
    kept = {
        name: identity.get(name)
        for name in ("world", "scenarios_sha256", "weights_sha256", "agents", "recorded_sha256")
    }
    left_out = ("ads", "ads_class", "bags", "baseline", "check_state", "only", "recorded")
    return kept | {
        section: {name: value for name, value in values.items() if name not in left_out}
        for section, values in identity["parameters"].items()
    }


def compare(table: pl.DataFrame, earlier: Earlier, exam: Exam) -> dict[str, Any]:
    """Return the comparison as JSON values, by pedestrian; `not_compared`: pedestrians without a common episode.

    :param table: a row an episode, of the exam.
    """
    failure = exam.config.failure
    out, not_compared = {}, []
    for name in exam.config.opponents:
        new, old = (rows_of(rows, ADS, name) for rows in (table, earlier.rows))
        both = new.join(old, on=_KEY, suffix="_before").sort(_KEY)
        if both.is_empty():
            not_compared.append(name)
            continue
        fails, failed = pl.col(failure), pl.col(f"{failure}_before")
        kinds = {"fixed": failed & ~fails, "newly_failed": fails & ~failed, "still_failing": fails & failed}
        episodes = {kind: [f"{s}:{e}" for s, e in both.filter(which).select(_KEY).iter_rows()]
                    for kind, which in kinds.items()}  # fmt: skip
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
    return facts | {"pedestrians": out, "not_compared": not_compared}


def failing(report: Mapping[str, Any], table: pl.DataFrame) -> Failing:
    """Return the episodes that a report lists: fixed, newly and still failing since an earlier exam, or all failing.

    :param report: what report.json holds; `table`: a row an episode.
    """
    if "against" in report:
        return {name: {kind: row[kind] for kind in FAILED_BEFORE}
                for name, row in report["against"]["pedestrians"].items()}  # fmt: skip
    failed = table.filter((pl.col("driver") == ADS) & pl.col(report["failure"])).sort(_KEY)
    episodes = {name: failed.filter(pl.col("pedestrian") == name) for name in report["drivers"].get(ADS, {})}
    return {name: {"failing": [f"{s}:{e}" for s, e in rows.select(_KEY).iter_rows()]}
            for name, rows in episodes.items()}  # fmt: skip
