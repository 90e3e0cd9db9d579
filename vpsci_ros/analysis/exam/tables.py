"""The tables of an exam's report, as HTML."""

from collections.abc import Mapping
from html import escape
from typing import Any

import polars as pl

from vpsci_ros.analysis import html
from vpsci_ros.analysis.exam import texts
from vpsci_ros.analysis.exam.config import ALONE, TITLES
from vpsci_ros.analysis.exam.report import ADS, BASELINE
from vpsci_ros.analysis.exam.scores import DIFFERENCES

NAMES = {ADS: "The ADS", BASELINE: "The rule-based autopilot"}
_CONDUCT = ("commands_refused", "commands_surplus", "ticks_unanswered", "episodes_with_unanswered_ticks", "safe_stops")
WORST = 10  # episodes in the list of those to look at


def scores(report: Mapping[str, Any], driver: str) -> str:
    """Return the measures of a driver with each pedestrian."""
    found = report["drivers"][driver]
    lines = [["episodes", *(str(row["episodes"]) for row in found.values())]]
    for name, text in report["definitions"].items():
        lines.append([_named(text), *(cell(row[name], text["unit"]) for row in found.values())])
    return html.table(NAMES[driver], ["", *(TITLES[name] for name in found)], lines)


def differences(report: Mapping[str, Any]) -> str:
    """Return what other pedestrians change against the learned one."""
    lines = []
    for name in DIFFERENCES if report["differences"] else ():
        text = report["definitions"][name]
        cells = [_difference(rows[name], text["unit"]) for rows in report["differences"].values()]
        lines.append([_named(text, "percentage points"), *cells])
    title = "The same episodes with other pedestrians: difference to the learned one"
    return html.table(title, ["", *(TITLES[name] for name in report["differences"])], lines, texts.DIFFERENCES)


def reliance(report: Mapping[str, Any]) -> str:
    """Return how much the drivers live off the pedestrian's yielding."""
    head = ["", "settled by the<br>pedestrian alone", "of those, the vehicle<br>hits it when it walks on",
            "contacts, vehicle moving:<br>increase when it walks on"]  # fmt: skip
    lines = [
        [
            NAMES[driver],
            cell(row["left_to_pedestrian"], ""),
            cell(row["of_those_collide"], "") + f"<small>of {row['of_those_collide']['n']}</small>",
            _difference(row["moving_collision_increase"], ""),
        ]
        for driver, row in report["reliance"].items()
    ]
    return html.table("Does it live off the pedestrian's yielding?", head, lines, texts.RELIANCE)


def conduct(report: Mapping[str, Any]) -> str:
    """Return how the ADS behaved as a program."""
    head = ["", "episodes<br>driven", "commands<br>refused", "surplus<br>commands", "ticks without a<br>usable command",
            "episodes with<br>such ticks", "safe<br>stops", "failure"]  # fmt: skip
    lines = [
        [
            TITLES[name],
            f"{row['episodes_driven']} of {row['episodes_wanted']}",
            *(str(row[name]) for name in _CONDUCT),
            escape(row["failure"]) or "-",
        ]
        for name, row in report["conduct"].items()
    ]
    return html.table("How the ADS behaved as a program", head, lines, texts.CONDUCT)


def worst(table: pl.DataFrame) -> str:
    """Return the worst episodes of the ADS: contacts first, the fastest first, then by least CurvTTC."""
    rows = table.filter((pl.col("driver") == ADS) & pl.col("critical") & (pl.col("pedestrian") != ALONE))
    rows = rows.with_columns(pl.col("impact_speed").fill_nan(-1.0))
    keys = ["collision", "impact_speed", "least_curvttc", "scenario", "episode"]
    rows = rows.sort(keys, descending=[True, True, False, False, False]).head(WORST)
    head = ["pedestrian", "episode", "outcome", "speed at the<br>contact [m/s]", "least<br>CurvTTC [s]",
            "hardest braking<br>[m/s²]", "yielded"]  # fmt: skip
    lines = [
        [
            TITLES[row["pedestrian"]],
            f"{row['scenario']}:{row['episode']}",
            row["outcome"],
            f"{row['impact_speed']:.1f}" if row["collision"] else "-",
            f"{row['least_curvttc']:.2f}",
            f"{row['hardest_braking']:.1f}",
            row["yielded"],
        ]
        for row in rows.iter_rows(named=True)
    ]
    return html.table("Episodes to look at", head, lines, texts.WORST)


def cell(found: Mapping[str, Any], unit: str) -> str:
    """Return a value over its interval; shares in percent."""
    if found["value"] is None:
        return "-"
    if unit:
        return f"{found['value']:.2f}<small>{found['low']:.2f} to {found['high']:.2f}</small>"
    value, low, high = (100.0 * found[key] for key in ("value", "low", "high"))
    return f"{value:.1f}%<small>{low:.1f} to {high:.1f}</small>"


def _difference(found: Mapping[str, Any], unit: str) -> str:
    if found["value"] is None:
        return "-"
    factor, digits = (1.0, 2) if unit else (100.0, 1)
    value, low, high = (factor * found[key] for key in ("value", "low", "high"))
    text = f"{value:+.{digits}f}<small>{low:+.{digits}f} to {high:+.{digits}f}</small>"
    if found["p"] is not None:
        text += f"<small>p = {found['p']:.2g}</small>"
    return f"<span class=sure>{text}</span>" if low > 0.0 or high < 0.0 else text


def _named(text: Mapping[str, str], unit: str = "") -> str:
    unit = text["unit"] or unit
    shown = text["title"] + (f" [{unit}]" if unit else "")
    return f'<span title="{escape(text["definition"])}">{shown}</span>'
