"""An exam's report as a self-contained HTML page: a picture, what changed, and all results.

The template draws the picture as SVG; here is what lies where, in units of its view boxes.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.criteria import limits, verdict_value
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, PERSON, TITLES, added_pedestrians, title_of
from vpsci_ros.exam.measures import worst_first
from vpsci_ros.exam.power import can_see
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES
from vpsci_ros.exam.timing import sentence
from vpsci_ros.exam.view import MARKS
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.report import html

NAMES = {ADS: "The ADS", BASELINE: "The rule-based autopilot"}
GROUPED = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
SLOW = 1.0  # [s] of time lost, from which on an episode is one to see
WIDTH, LEFT, RIGHT = 480.0, 150.0, 410.0  # of both drawings, and of the axis of rates between names and numbers
ROW = 38.0  # height of a pedestrian
HEIGHT, BOTTOM = 220.0, 190.0  # of the drawing of distances, and where its axis of time lies
COLOURS = ("#d55e00", "#0072b2", "#009e73")  # Okabe and Ito's, which most people can distinguish
FARTHEST = 20.0  # [m] that is drawn
_SCALES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # largest share of an axis
_SECONDS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # between the marks of an axis

_KEY = ["pedestrian", "scenario", "episode"]
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "exam.html"


def write_page(
    path: Path,
    report: Mapping[str, Any],
    table: pl.DataFrame,
    episodes: Mapping[str, Sequence[Episode]],
    view: str = "",
) -> None:
    """Write the report page to `path`.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    :param view: the page beside it in which the episodes play; empty: there is none, and so no link.
    """
    values: dict[str, Any] = {"rates": None, "must_see": []}
    if report["drivers"].get(ADS):
        seen = must_see(table)
        drawn = {"rates": rates(report), "distances": distances(seen, episodes)}
        values = {"must_see": list(zip(seen, COLOURS, strict=False))} | drawn | _summary(report)
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Exam of {report['exam']['ads']}",
        report=report,
        titles={name: title_of(name) for name in (*TITLES, *added_pedestrians())},
        names=NAMES | ({ADS: "You"} if report["exam"]["ads"] == PERSON else {}),
        differences=DIFFERENCES,
        verdict_value=verdict_value,
        can_see=can_see,
        changes=_changes(report),
        widest=_widest,
        grouped=GROUPED,
        view=view,
        marks=set(MARKS),
        timing=sentence(report),
        width=WIDTH,
        **values,
    )


def rates(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the drawing of the failures with each pedestrian: rows of dots with intervals, limits of criteria, marks.

    :param report: as report.json has it.
    """
    measure, drivers = f"{report['failure']}_rate", report["drivers"]
    found = {driver: {name: row[measure] for name, row in rows.items() if row[measure]["value"] is not None}
             for driver, rows in drivers.items()}  # fmt: skip
    limit = limits(report["criteria"], measure)
    most = max([*(row["high"] for rows in found.values() for row in rows.values()), *limit.values()], default=0.0)
    scale = next((scale for scale in _SCALES if scale >= most), 1.0)

    def at(share: float) -> float:
        return round(LEFT + (RIGHT - LEFT) * min(share / scale, 1.0), 1)

    rows = []
    for place, name in enumerate(drivers[ADS]):
        middle = ROW * (place + 0.5)
        dots = [
            {"driver": driver, "y": middle + (-7.0 if driver == ADS else 8.0), "text": f"{100.0 * row['value']:.1f}%",
             **{key: at(row[key]) for key in ("value", "low", "high")}}
            for driver, of in found.items() if (row := of.get(name))
        ]  # fmt: skip
        limited = at(limit[name]) if name in limit else None
        rows.append({"title": title_of(name), "y": middle, "dots": dots, "limit": limited})
    marks = [(at(share), f"{100.0 * share:g}%") for share in (0.0, 0.5 * scale, scale)]
    return {"title": report["definitions"][measure]["title"], "rows": rows, "marks": marks, "height": ROW * len(rows)}


def distances(chosen: Sequence[Mapping[str, Any]], episodes: Mapping[str, Sequence[Episode]]) -> dict[str, Any]:
    """Return the drawing of the distance to the nearest pedestrian over time, a line for each chosen episode.

    :param chosen: rows of the table of episodes; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    """
    drives = [next(each for each in episodes[row["pedestrian"]] if each.key == (row["scenario"], row["episode"]))
              for row in chosen]  # fmt: skip
    longest = max((float(episode.time[-1]) for episode in drives), default=0.0) or 1.0
    step = next((step for step in _SECONDS if longest <= 6.0 * step), _SECONDS[-1])
    left = 40.0

    def at(time: float) -> float:
        return round(left + (WIDTH - left - 18.0) * time / longest, 1)  # with room for half of the last mark's text

    lines = []
    for episode, colour in zip(drives, COLOURS, strict=False):
        near = np.fmin(np.fmin.reduce(episode.filled().distance, axis=0), FARTHEST)
        places = [(at(float(t)), BOTTOM * (1.0 - float(d) / FARTHEST)) for t, d in zip(episode.time, near, strict=True)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        lines.append({"points": points, "end": places[-1], "touched": episode.outcome == "collision", "colour": colour})
    across = [(at(time), f"{time:g} s") for time in np.arange(0.0, longest + 1e-6, step).tolist()]
    up = [(BOTTOM * (1.0 - d / FARTHEST), f"{d:g} m") for d in (0.0, 0.5 * FARTHEST, FARTHEST)]
    return {"lines": lines, "across": across, "up": up, "left": left, "height": HEIGHT, "bottom": BOTTOM}


def _changes(report: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what got worse and better against the earlier exam or, without one, the autopilot; None without either.

    `worse` and `better`: measure -> pedestrian -> change, of changes that show. `unclear`: pedestrian -> titles of all
    other measures. `failure`: pedestrian -> how large a change of the failures would show; "" where that is not known.
    `episodes`: pedestrian -> row of the comparison with the earlier exam.
    """
    pedestrians = report["against"]["pedestrians"] if "against" in report else {}
    found = {name: row["differences"] for name, row in pedestrians.items()} or report["beside"]
    if not found:
        return None
    changes: dict[str, dict[str, dict[str, Any]]] = {"worse": {}, "better": {}}
    unclear: dict[str, list[str]] = {}
    for measure in DIFFERENCES:
        for pedestrian, rows in found.items():
            if (row := rows[measure])["value"] is None:
                continue
            if row["low"] <= 0.0 <= row["high"]:
                unclear.setdefault(pedestrian, []).append(MEASURES[measure].title)
            else:
                kind = "worse" if (row["value"] > 0.0) == (MEASURES[measure].good == "low") else "better"
                changes[kind].setdefault(measure, {})[pedestrian] = row
    failure = f"{report['failure']}_rate"
    seen = {name: can_see(rows[failure], failure) for name, rows in found.items()}
    seen = {name: f"{text} in {MEASURES[failure].title}" if text else "" for name, text in seen.items()}
    against = report["against"]["folder"] if pedestrians else "the rule-based autopilot"
    return {"against": against, "unclear": unclear, "failure": seen, "episodes": pedestrians} | changes


def _widest(rows: Mapping[str, Mapping[str, Any]], measure: str) -> str:
    """Return, in words, how large a change would show with every one of these pedestrians."""
    return can_see(max(rows.values(), key=lambda row: row["detectable"] or 0.0), measure)


def _summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the first paragraph is about: the default pedestrian where the exam has it, else the first one."""
    scores = report["drivers"][ADS]
    first = LEARNED if LEARNED in scores else next(iter(scores))
    reliance = report["reliance"].get(ADS)
    counted = {"collisions": scores[first]["collision_rate"], "moving": scores[first]["moving_collision_rate"]}
    if reliance:
        counted["of_those_collide"] = reliance["of_those_collide"]
    return {
        "first": first,
        "scores": scores[first],
        "beside": report["drivers"].get(BASELINE, {}).get(first),
        "reliance": reliance,
        "counts": {name: round((found["value"] or 0.0) * found["n"]) for name, found in counted.items()},
    }


def must_see(table: pl.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of at most three episodes of the ADS worth seeing, each with the reason as `why`."""
    rows = worst_first(table.filter((pl.col("driver") == ADS) & (pl.col("pedestrian") != ALONE)))
    other = table.filter(pl.col("driver") == BASELINE).select(*_KEY, hit=pl.col("collision"))
    rows = rows.join(other, on=_KEY, how="left", maintain_order="left").with_columns(pl.col("time_lost").fill_nan(0.0))
    missed, slow = rows.filter(~pl.col("collision")), rows.filter(pl.col("time_lost") > SLOW)
    found: list[dict[str, Any]] = []
    for why, those in (
        ("The hardest contact: {impact_speed:.1f} m/s", rows.filter("moving_collision")),
        ("A contact at {impact_speed:.1f} m/s, where the autopilot has none",
         rows.filter(pl.col("moving_collision") & ~pl.col("hit"))),
        ("The nearest without a contact: CurvTTC {least_curvttc:.2f} s", missed.filter("critical")),
        ("The hardest braking without a contact: {hardest_braking:.1f} m/s\u00b2",
         missed.filter("hard_braking").sort("hardest_braking", descending=True, maintain_order=True)),
        ("The most time lost: {time_lost:.1f} s", slow.sort("time_lost", descending=True, maintain_order=True)),
        ("No contact, where the autopilot has one", missed.filter("hit")),
        ("The pedestrian walks into the standing vehicle",
         rows.filter(pl.col("collision") & ~pl.col("moving_collision"))),
    ):  # fmt: skip
        seen = [(row["scenario"], row["episode"]) for row in found]
        new = next((row for row in those.iter_rows(named=True) if (row["scenario"], row["episode"]) not in seen), None)
        if new is not None:
            found.append(new | {"why": why.format(**new)})
    return found[:3]
