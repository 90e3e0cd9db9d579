"""An exam's report: a self-contained HTML page, and a table on the terminal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from rich import box
from rich.console import Console
from rich.table import Table

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.criteria import verdict_value
from vpsci_ros.exam.exam import ADS, ALONE, BASELINE, PERSON, TITLES, added_pedestrians, title_of
from vpsci_ros.exam.measures import worst_first
from vpsci_ros.exam.power import can_see
from vpsci_ros.exam.report import FAILED_BEFORE, rows_of
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES
from vpsci_ros.exam.timing import sentence
from vpsci_ros.exam.view import MARKS
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.report import html
from vpsci_ros.report.canvas import blank_figure, save_png
from vpsci_ros.report.trajectories import draw_episode
from vpsci_ros.safety import HORIZON

# Okabe and Ito's colours, which most people can distinguish
COLOURS = {
    LEARNED: "#d55e00",
    "recorded": "#cc79a7",
    "walker": "#0072b2",
    "constant_velocity": "#56b4e9",
    "social_force": "#009e73",
}
_MORE = ("#8c564b", "#e377c2", "#7f7f7f", "#bcbd22")

RATES = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate")
_ENDS = (
    ("collision", "collision", "#7f1d1d"),
    ("pedestrian", "only the pedestrian yielded", "#e69f00"),
    ("both", "both yielded", "#f0e442"),
    ("vehicle", "only the vehicle yielded", "#009e73"),
    ("nobody", "nobody yielded", "#c8c8c8"),
)
NAMES = {ADS: "The ADS", BASELINE: "The rule-based autopilot"}
GROUPED = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
SLOW = 1.0  # [s] of time lost, from which on an episode is one to see
_SHOWN = {
    "collision_rate": "colli-\nsions",
    "moving_collision_rate": "while\nmoving",
    "conflict_rate": "con-\nflicts",
    "arrived_rate": "arri-\nved",
    "never_arrived_rate": "never\narri-\nved",
    "stood_still_rate": "stood\nstill",
    "time_lost": "time\nlost\n\\[s]",
}
"""Measures that are printed, and the heads of their columns."""
_KEY = ["pedestrian", "scenario", "episode"]
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "exam.html"


def save_overview(report: Mapping[str, Any], table: pl.DataFrame, path: Path) -> None:
    """Draw shares with intervals, the distribution of the least CurvTTC and how critical episodes ended, as a PNG."""
    names = list(report["drivers"][ADS])
    figure = blank_figure(11.5, 2.9 + 0.62 * len(names))
    top, bottom = figure.subfigures(
        2, 1, squeeze=False, height_ratios=[0.7 + 0.3 * len(names), 1.9 + 0.25 * len(names)]
    ).flat
    axes = top.subplots(1, len(RATES), sharey=True, squeeze=False)
    for axis, measure in zip(axes.flat, RATES, strict=True):
        _draw_rates(axis, report, measure, names)
    left, right = bottom.subplots(1, 2, width_ratios=[1.0, 1.25])
    _draw_least(left, table, names)
    _draw_ends(right, table, names)
    save_png(figure, path)


def _colour(pedestrian: str) -> str:
    """Return a pedestrian's colour; those that other packages add take the remaining colours in turn."""
    return COLOURS.get(pedestrian) or _MORE[added_pedestrians().index(pedestrian) % len(_MORE)]


def _draw_rates(axis: Axes, report: Mapping[str, Any], measure: str, names: list[str]) -> None:
    greatest = 0.0
    for driver, shift in ((ADS, -0.13), (BASELINE, 0.17)):
        for row, name in enumerate(names):
            found = report["drivers"].get(driver, {}).get(name, {}).get(measure)
            if found is None or found["value"] is None:
                continue
            value, low, high = (100.0 * found[key] for key in ("value", "low", "high"))
            colour = _colour(name) if driver == ADS else "#999999"
            inside = colour if driver == ADS else "white"
            bars = [[value - low], [high - value]]
            axis.errorbar(
                [value], [row + shift], xerr=bars, fmt="o", color=colour, mfc=inside, capsize=2.5, markersize=5
            )
            greatest = max(greatest, high)
    axis.set_title(report["definitions"][measure]["title"], fontsize=9)
    axis.set_yticks(range(len(names)), [title_of(name) for name in names], fontsize=8)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlim(-2.0, min(100.0, 1.08 * greatest) + 2.0)
    axis.set_xlabel("% of episodes", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.grid(axis="x", color="#e5e5e5")
    axis.set_axisbelow(True)


def _draw_least(axis: Axes, table: pl.DataFrame, names: list[str]) -> None:
    for name in names:
        least = np.sort(rows_of(table, ADS, name)["least_curvttc"].to_numpy())
        share = 100.0 * np.arange(1, len(least) + 1) / len(least)
        axis.step([0.0, *least], [0.0, *share], where="post", color=_colour(name), label=title_of(name), linewidth=1.6)
    axis.set_xlim(0.0, HORIZON)
    axis.set_ylim(0.0, 100.0)
    axis.set_title("how near it came", fontsize=9)
    axis.set_xlabel("least CurvTTC of the episode [s]", fontsize=8)
    axis.set_ylabel("% of episodes at or below", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.grid(color="#e5e5e5")
    axis.legend(fontsize=7, loc="lower right", frameon=False)


def _draw_ends(axis: Axes, table: pl.DataFrame, names: list[str]) -> None:
    for row, name in enumerate(names):
        critical = rows_of(table, ADS, name).filter(pl.col("critical"))
        ended = critical.select(
            pl.when(pl.col("collision")).then(pl.lit("collision")).otherwise(pl.col("yielded")).alias("end")
        )["end"].to_list()
        begin = 0.0
        for end, _, colour in _ENDS:
            width = 100.0 * ended.count(end) / max(len(ended), 1)
            axis.barh(row, width, left=begin, color=colour, height=0.62, edgecolor="white", linewidth=0.5)
            if width > 6.0:
                dark = end in ("collision", "vehicle")
                axis.text(begin + 0.5 * width, row, f"{width:.0f}", ha="center", va="center", fontsize=7,
                          color="white" if dark else "black")  # fmt: skip
            begin += width
    for _, label, colour in _ENDS:
        axis.barh(0, 0, color=colour, label=label)
    axis.set_yticks(range(len(names)), [title_of(name) for name in names], fontsize=8)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_xlim(0.0, 100.0)
    axis.set_title("how critical episodes ended, and who gave way", fontsize=9)
    axis.set_xlabel("% of critical episodes (CurvTTC < 5 s)", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.45, -0.2), frameon=False)


def write_page(
    path: Path,
    report: Mapping[str, Any],
    table: pl.DataFrame,
    episodes: Mapping[str, Sequence[Episode]],
    view: str = "",
) -> None:
    """Write the report page to `path`, and beside it overview.png and up to must_see_3.png.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    :param view: the page beside it in which the episodes play; empty: there is none, and so no link.
    """
    values: dict[str, Any] = {"overview": None, "must_see": []}
    if report["drivers"].get(ADS):
        overview = path.parent / "overview.png"
        save_overview(report, table, overview)
        values = {"overview": overview} | _summary(report)
        values["must_see"] = _pictured(must_see(table), episodes, path.parent)
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
        **values,
    )


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


def _pictured(
    rows: list[dict[str, Any]], episodes: Mapping[str, Sequence[Episode]], folder: Path
) -> list[dict[str, Any]]:
    """Return the rows with a `picture` each, drawn from the episodes of the ADS."""
    out = []
    for number, row in enumerate(rows, start=1):
        key, picture = (row["scenario"], row["episode"]), folder / f"must_see_{number}.png"
        figure = blank_figure(4.4, 3.3)
        (episode,) = (each for each in episodes[row["pedestrian"]] if each.key == key)
        draw_episode(figure.subplots(), "", episode.pair())
        save_png(figure, picture)
        out.append(row | {"picture": picture})
    return out


def print_report(report: Mapping[str, Any], page: Path) -> None:
    """Print the measures of the ADS and the autopilot with each pedestrian, and the verdict.

    :param page: the report page, which the last line names.
    """
    console = Console()
    view = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    for head in _SHOWN.values():
        view.add_column(head, justify="right")
    for driver, scores in report["drivers"].items():
        view.add_section()
        view.add_row({ADS: "the ADS", BASELINE: "rule-based autopilot"}[driver], style="bold")
        for name, row in scores.items():
            view.add_row(f"  {title_of(name)}", *(_cell(row[measure]["value"], measure) for measure in _SHOWN))
    console.print(view)
    for name, row in report.get("against", {}).get("pedestrians", {}).items():
        counts = ", ".join(f"{len(row[kind])} {kind.replace('_', ' ')}" for kind in FAILED_BEFORE)
        seen = can_see(row["differences"][measure := f"{report['failure']}_rate"], measure)
        text = f"against {report['against']['folder']}, {title_of(name)}: {counts}{'; ' if seen else ''}{seen}"
        console.print(text, markup=False, highlight=False)
    for name in report.get("against", {}).get("not_compared", []):
        text = f"against {report['against']['folder']}, {title_of(name)}: no episode in common, nothing is compared"
        console.print(text, markup=False)
    if found := report["range"]:
        console.print(
            f"{found['beyond']} of {found['of']} critical episodes with the default pedestrian begin beyond the range "
            "of its recorded reactions",
            markup=False,
            highlight=False,
        )
    for text in report["failures"]:
        console.print(f"FAILED  {text}", style="bold red", markup=False)
    if not report["failures"]:
        console.print("passed" if report["criteria"] else "no criterion was given (--fail-if)")
    console.print(f"with intervals and differences: {page}", markup=False)


def _cell(value: float | None, measure: str) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if measure == "time_lost" else f"{100.0 * value:.1f}%"
