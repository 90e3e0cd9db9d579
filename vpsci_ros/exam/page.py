"""An exam's report as one HTML page that needs nothing beside it: what came out first, how to read it last."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.config import ALONE, TITLES, added_pedestrians, title_of
from vpsci_ros.exam.figures import save_episode, save_overview
from vpsci_ros.exam.measures import worst_first
from vpsci_ros.exam.report import ADS, BASELINE
from vpsci_ros.exam.scores import DIFFERENCES
from vpsci_ros.exam.view import MARKS
from vpsci_ros.policy.config import LEARNED
from vpsci_ros.report import html

NAMES = {ADS: "The ADS", BASELINE: "The rule-based autopilot"}
GROUPED = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
WORST = 10  # episodes in the list of those to look at
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "exam.html"


def write_page(
    path: Path,
    report: Mapping[str, Any],
    table: pl.DataFrame,
    episodes: Mapping[str, Sequence[Episode]],
    view: str = "",
) -> None:
    """Write the page, and its pictures beside it: overview.png, episode.png.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    :param view: the page beside it in which the episodes play; empty: there is none, and so no link.
    """
    values: dict[str, Any] = {"overview": None, "episode": None, "worst": []}
    if report["drivers"].get(ADS):
        overview, nearest_one = path.parent / "overview.png", path.parent / "episode.png"
        save_overview(report, table, overview)
        others = {name: found for name, found in episodes.items() if name != ALONE}
        nearest = save_episode(others, nearest_one)
        values = {"overview": overview, "episode": nearest_one if nearest else None, "nearest": nearest}
        values |= _summary(report) | {"worst": worst(table)}
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Exam of {report['exam']['ads']}",
        report=report,
        titles={name: title_of(name) for name in (*TITLES, *added_pedestrians())},
        names=NAMES,
        differences=DIFFERENCES,
        grouped=GROUPED,
        view=view,
        marks=set(MARKS),
        **values,
    )


def _summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the first paragraph is about: the learned pedestrian where the exam has it, else the first one."""
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


def worst(table: pl.DataFrame) -> list[dict[str, Any]]:
    """Return rows of the worst episodes of the ADS, the worst first."""
    rows = table.filter((pl.col("driver") == ADS) & pl.col("critical") & (pl.col("pedestrian") != ALONE))
    return worst_first(rows).head(WORST).with_columns(pl.col("impact_speed").fill_nan(-1.0)).to_dicts()
