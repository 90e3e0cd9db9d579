"""An exam's scores as one dictionary, which report.json stores and the report page shows."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import polars as pl

from vpsci_ros.evaluation import statistics
from vpsci_ros.evaluation.statistics import Estimate
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, HARD_BRAKING, SEVERE_TTC, ExamConfig
from vpsci_ros.exam.result import Conduct
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES, detectable, difference, estimate
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.safety import CONFLICT_TTC
from vpsci_ros.world.perception import PerceptionConfig

INCREASES = {"collision_increase": "collision_rate", "moving_collision_increase": "moving_collision_rate"}
CHANGES = {
    f"{name}_change{suffix}": (name, end)
    for name in DIFFERENCES
    for suffix, end in (("", "value"), ("_low", "low"), ("_high", "high"))
}
"""Criterion against an earlier exam -> the measure, and which number of its difference."""
FAILED_BEFORE = ("fixed", "newly_failed", "still_failing")
COUNTS = ("commands_refused", "commands_surplus", "ticks_unanswered", "safe_stops")
GROUPS = {
    "kind": "kind of the pedestrian that became critical first",
    "group_size": "pedestrians of the episode",
    "hidden": "hidden by parked vehicles as it became critical",
}
"""Column of the table of episodes -> what the results of critical episodes are given by, where values differ."""
_HIDDEN = {False: "in sight", True: "hidden"}


def make_report(
    table: pl.DataFrame, conduct: dict[str, Conduct], config: ExamConfig, perception: PerceptionConfig | None = None
) -> dict[str, Any]:
    """Return the scores of an exam; the key `beside` has ADS minus autopilot on the same episodes.

    :param table: a row an episode, `vpsci_ros.exam.measures.COLUMNS`.
    :param conduct: pedestrian (and "alone") -> how the run of the ADS with it went.
    :param perception: errors of what was published to the ADS; None: it had odometry.
    """
    found = {
        driver: {name: rows for name in config.opponents if (rows := rows_of(table, driver, name)).height}
        for driver in (ADS, BASELINE)
        if rows_of(table, driver).height
    }
    ads, autopilot = found.get(ADS, {}), found.get(BASELINE, {})
    learned = rows_of(table, ADS, LEARNED)
    others = [name for name in config.opponents if name != LEARNED and learned.height]
    return {
        "drivers": {driver: {name: _scores(rows) for name, rows in parts.items()} for driver, parts in found.items()},
        "beside": {name: differences(rows, autopilot[name]) for name, rows in ads.items() if name in autopilot},
        "differences": {name: differences(rows_of(table, ADS, name), learned) for name in others},
        "alone": _alone(table),
        "reliance": _reliance(table),
        "groups": _groups(table, config.opponents),
        "range": _range(learned),
        "perception": None if perception is None else asdict(perception),
        "conduct": {name: _conduct(rows_of(table, ADS, name), run) for name, run in conduct.items()},
        "definitions": definitions(),
        "failure": config.failure,
    }


def _alone(table: pl.DataFrame) -> dict[str, int] | None:
    """Return in how many episodes the ADS arrives on the empty road; None: it did not drive there."""
    rows = rows_of(table, ADS, ALONE)
    return {"arrived": int(rows["arrived"].sum()), "of": rows.height} if rows.height else None


def standing(report: Mapping[str, Any]) -> str:
    """Return, in words, that the ADS does not arrive on the empty road; "" where it does or was not to drive there."""
    found = report["alone"]
    if found is None or found["arrived"] == found["of"]:
        return ""
    return (
        f"the system does not arrive on the empty road in {found['of'] - found['arrived']} of {found['of']} episodes: "
        "its safety there says nothing of its driving; more world_simulator.episode_time lets a slow car arrive, and "
        "--allow-standing accepts it"
    )


def _range(learned: pl.DataFrame) -> dict[str, int] | None:
    """Return in how many critical episodes the pedestrian `learned` acts beyond its range; None: it has none."""
    known = learned.filter(pl.col("range") != "")
    return {"beyond": known.filter(pl.col("range") == "beyond").height, "of": known.height} if known.height else None


def definitions() -> dict[str, dict[str, str]]:
    """Return title, unit and definition of each measure, with its thresholds."""
    limits = {"conflict": CONFLICT_TTC, "severe": SEVERE_TTC, "hard_braking": HARD_BRAKING}
    return {
        name: {"title": row.title, "unit": row.unit, "definition": row.definition.format(**limits)}
        for name, row in MEASURES.items()
    }


def value_of(report: dict[str, Any], measure: str, pedestrian: str) -> float:
    """Return the ADS's value of a measure with a pedestrian, from a report; NaN where it was not measured."""
    if measure in INCREASES:
        found = report["differences"].get(pedestrian, {}).get(INCREASES[measure], {}).get("value")
    elif measure in COUNTS:
        found = report["conduct"].get(pedestrian, {}).get(measure)
    elif measure in (*CHANGES, *FAILED_BEFORE):
        row = report["against"]["pedestrians"].get(pedestrian, {})
        if measure in CHANGES:
            name, end = CHANGES[measure]
            found = row.get("differences", {}).get(name, {}).get(end)
        else:
            found = len(row[measure]) if row else None
    else:
        found = report["drivers"].get(ADS, {}).get(pedestrian, {}).get(measure, {}).get("value")
    return math.nan if found is None else float(found)


def rows_of(table: pl.DataFrame, driver: str, pedestrian: str | None = None) -> pl.DataFrame:
    """Return a driver's rows of the table of episodes, with one pedestrian or (None) with all."""
    rows = table.filter(pl.col("driver") == driver)
    return rows if pedestrian is None else rows.filter(pl.col("pedestrian") == pedestrian)


def _scores(rows: pl.DataFrame) -> dict[str, Any]:
    return {"episodes": rows.height} | {name: as_dict(estimate(rows, measure)) for name, measure in MEASURES.items()}


def differences(rows: pl.DataFrame, others: pl.DataFrame) -> dict[str, Any]:
    """Return, by measure, the value of `rows` minus the value of `others` on common episodes.

    With its p-value as `p`, and as `detectable` the least difference that would show, see `scores.detectable`.
    """
    out = {}
    for name in DIFFERENCES:
        found, p = difference(rows, others, MEASURES[name])
        least = detectable(rows, others, MEASURES[name], found)
        out[name] = as_dict(found) | {"p": _number(p), "detectable": _number(least)}
    return out


def _reliance(table: pl.DataFrame) -> dict[str, Any]:
    """Return how much each driver lives off the pedestrian's yielding.

    `left_to_pedestrian`: of the critical episodes with the default pedestrian that end without a contact, the share in
    which only the pedestrian yielded. `of_those_collide`: of these very episodes, the share that ends in a contact with
    a moving vehicle when the same pedestrian walks on. `moving_collision_increase`: by how much the share of such
    contacts grows over all episodes when the pedestrian walks on.
    """
    out = {}
    for driver in (ADS, BASELINE):
        learned, walker = rows_of(table, driver, LEARNED), rows_of(table, driver, "walker")
        if not learned.height or not walker.height:
            continue
        left = learned.filter(pl.col("critical") & ~pl.col("collision") & (pl.col("yielded") == "pedestrian"))
        again = walker.join(left, on=["scenario", "episode"], how="semi")
        more, p = difference(walker, learned, MEASURES["moving_collision_rate"])
        out[driver] = {
            "left_to_pedestrian": as_dict(estimate(learned, MEASURES["pedestrian_yield_rate"])),
            "of_those_collide": as_dict(statistics.share(int(again["moving_collision"].sum()), again.height)),
            "moving_collision_increase": as_dict(more) | {"p": _number(p)},
        }
    return out


def _groups(table: pl.DataFrame, opponents: Sequence[str]) -> dict[str, Any]:
    """Return column of `GROUPS` -> title, and driver -> pedestrian -> value -> scores, where values differ."""
    rows = table.filter(pl.col("critical") & pl.col("pedestrian").is_in(opponents))
    out: dict[str, Any] = {}
    for column, title in GROUPS.items():
        if rows[column].n_unique() < 2:
            continue
        found: dict[str, Any] = {driver: {} for driver in (ADS, BASELINE) if rows_of(rows, driver).height}
        for driver, by_pedestrian in found.items():
            for name in opponents:
                parts = rows_of(rows, driver, name).sort(column).partition_by(column, as_dict=True)
                if parts:
                    by_pedestrian[name] = {str(_HIDDEN.get(value, value)): _scores(part)
                                           for (value,), part in parts.items()}  # fmt: skip
        out[column] = {"title": title} | found
    return out


def _conduct(rows: pl.DataFrame, run: Conduct) -> dict[str, Any]:
    return {
        "episodes_wanted": run.wanted,
        "episodes_driven": rows.height,
        "commands_refused": run.refused,
        "commands_surplus": run.surplus,
        "safe_stops": run.safe_stops,
        "ticks_unanswered": int(rows["unanswered"].sum()),
        "episodes_with_unanswered_ticks": int((rows["unanswered"] > 0).sum()),
        "failure": run.failure,
    }


def as_dict(found: Estimate) -> dict[str, Any]:
    """Return an estimate as JSON values, None for NaN."""
    return {"value": _number(found.value), "low": _number(found.low), "high": _number(found.high), "n": found.n}


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
