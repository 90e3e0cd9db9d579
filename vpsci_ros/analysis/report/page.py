"""The report of a dataset: numbers as JSON, pictures as PNG, and one HTML page that holds all of it."""

import json
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.analysis import html
from vpsci_ros.analysis.encounters import generated_encounters, recorded_encounters
from vpsci_ros.analysis.figures import save_trajectories
from vpsci_ros.analysis.panels import typical_panels
from vpsci_ros.analysis.report import texts
from vpsci_ros.analysis.report.comparison import SHARES, between_halves, describe, distance_between
from vpsci_ros.analysis.report.figures import save_conflicts, save_nearness, save_yielding
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC, TABLE_10
from vpsci_ros.errors import InvalidInput
from vpsci_ros.provenance import sha256, software_versions, written_whole
from vpsci_ros.world import load_scenarios
from vpsci_ros.world.scenario import scenario_files

PAGE, NUMBERS = "report.html", "report.json"
GENERATED, RECORDED, BESIDE = "generated", "recorded", "beside"
TITLES = {GENERATED: "generated", BESIDE: "the other dataset", RECORDED: "recorded people"}


def write_report(
    folder: Path,
    output: Path,
    *,
    near_misses: Path | None = None,
    beside: Path | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Write the report of a dataset into `output` and return its numbers, those of `report.json`.

    :param near_misses: near-miss table of recorded people to compare with.
    :param beside: another dataset to compare with, say of the rule-based pair.
    :param tell: called with what is being done.
    :raises InvalidInput: an input cannot be read or holds nothing.
    """
    data = Dataset(folder)
    tell("reading")
    sources = {GENERATED: generated_encounters(data)}
    if beside is not None:
        sources[BESIDE] = generated_encounters(Dataset(beside))
    if near_misses is not None:
        sources[RECORDED] = recorded_encounters(read_near_misses(near_misses))
    for name, table in sources.items():
        if not table.height:
            raise InvalidInput(f"{TITLES[name]}: no interaction with CurvTTC of 5 s or less; nothing to report")
    output.mkdir(parents=True, exist_ok=True)
    tell("resampling")
    report = _numbers(data, sources)
    report["inputs"] = _inputs(folder, near_misses, beside)
    tell("drawing")
    pictures = _draw(data, sources, output)
    with written_whole(output / NUMBERS) as part:
        part.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    html.write_page(output / PAGE, f"Report on {folder}", _parts(data, report, pictures))
    return report


def _numbers(data: Dataset, sources: Mapping[str, pl.DataFrame]) -> dict[str, Any]:
    report: dict[str, Any] = {
        "scenarios": {name: {key: row[key] for key in _COUNTS} for name, row in data.scenarios.items()},
        "sources": {name: describe(table, clustered=name == RECORDED) for name, table in sources.items()},
        "distance": {},
    }
    if RECORDED in sources:
        recorded = sources[RECORDED]
        others = {name: table for name, table in sources.items() if name != RECORDED}
        report["distance"] = {name: distance_between(recorded, table) for name, table in others.items()}
        report["distance"]["between_halves_of_recorded"] = between_halves(recorded)
    return report


_COUNTS = ("number", "simulated", "kept", "vehicle_km", "pedestrian_km")


def _inputs(folder: Path, near_misses: Path | None, beside: Path | None) -> dict[str, Any]:
    files = {"dataset": folder / "dataset.json"}
    if beside is not None:
        files["beside"] = beside / "dataset.json"
    if near_misses is not None:
        files["near_misses"] = near_misses
    return {
        "files": {name: {"path": str(path), "sha256": sha256(path)} for name, path in files.items()},
        "software": software_versions(),
    }


def _draw(data: Dataset, sources: Mapping[str, pl.DataFrame], output: Path) -> dict[str, Path]:
    titled = {TITLES[name]: table for name, table in sources.items()}
    names = ("trajectories", "nearness", "conflicts", "pedestrian_yields", "vehicle_yields")
    paths = {name: output / f"{name}.png" for name in names}
    grounds = [scenario for scenario in load_scenarios(scenario_files()) if scenario.name in data.scenarios]
    save_trajectories(typical_panels(data.folder), grounds, paths["trajectories"])
    save_nearness(titled, paths["nearness"])
    save_conflicts(titled, paths["conflicts"])
    for agent in ("pedestrian", "vehicle"):
        save_yielding(titled, agent, paths[f"{agent}_yields"])
    return paths


def _parts(data: Dataset, report: Mapping[str, Any], pictures: Mapping[str, Path]) -> list[str]:
    return [
        f"<h1>Safety-critical interactions</h1><p class=small>{escape(str(data.folder))}</p>",
        _summary(report),
        _likeness(report),
        html.image(pictures["nearness"], texts.NEARNESS),
        "<h2>Conflicts by speed</h2>",
        html.image(pictures["conflicts"], texts.CONFLICTS),
        "<h2>Who gives way</h2>",
        html.image(pictures["pedestrian_yields"], texts.YIELDING),
        html.image(pictures["vehicle_yields"], "The same for the vehicle."),
        _table_10(report),
        "<h2>Trajectories</h2>",
        html.image(pictures["trajectories"], texts.TRAJECTORIES),
        f"<h2>How to read this</h2>{texts.READING}",
        f"<h2>What of section 4 is not here</h2>{texts.ABSENT}",
        _provenance(report),
    ]


def _summary(report: Mapping[str, Any]) -> str:
    """Return the findings in a few sentences."""
    found = report["sources"][GENERATED]
    text = f"""{found["interactions"]:,} generated interactions come as near as {_seconds(found)} (quartiles of the
        least CurvTTC). The vehicle yields in {_percent(found["vehicle_yields"])} of them, the pedestrian in
        {_percent(found["pedestrian_yields"])}; {_percent(found["conflict"])} are conflicts."""
    if RECORDED not in report["sources"]:
        return f"""<p>{text}</p><div class='verdict open'><b>Not compared with people</b>: no recorded near misses were
            given (--near-misses).</div>"""
    people, apart = report["sources"][RECORDED], report["distance"][GENERATED]
    halves = report["distance"]["between_halves_of_recorded"]
    text += f""" Of {people["interactions"]} recorded near misses of {people["groups"]} clips the quartiles are
        {_seconds(people)}; the vehicle yields in {_percent(people["vehicle_yields"])}, the pedestrian in
        {_percent(people["pedestrian_yields"])}. Between the two distributions D is {_number(apart["ks"])}, and
        {apart["ks_onset"]:.2f} with recorded ones weighted to the same onsets; between two halves of the recorded clips
        it is {halves["ks"]:.2f}."""
    return f"<p>{text} Brackets: 95% intervals.</p>"


def _likeness(report: Mapping[str, Any]) -> str:
    head = ["", "n", "least CurvTTC,<br>quartiles", "D", "Wasserstein<br>distance [s]", "conflicts",
            "vehicle<br>yields", "pedestrian<br>yields"]  # fmt: skip
    rows = []
    for name, found in report["sources"].items():
        apart = report["distance"].get(name)
        rows.append(
            [
                TITLES[name],
                f"{found['interactions']:,}" + (f"<small>{found['groups']} clips</small>" if name == RECORDED else ""),
                _seconds(found),
                *([_cell(apart[key]) for key in ("ks", "wasserstein")] if apart else ["-", "-"]),
                *(_cell(found[key], 100.0) for key in SHARES),
            ]
        )
        if apart:
            weighted = [f"{apart[f'{key}_onset']:.3f}" for key in ("ks", "wasserstein")]
            rows.append(["<small>recorded ones weighted to the same onsets</small>", "", "", *weighted, "", "", ""])
    if halves := report["distance"].get("between_halves_of_recorded"):
        cells = [f"{halves[key]:.3f}" for key in ("ks", "wasserstein")]
        rows.append(["two halves of the recorded clips <small>(control)</small>", "", "", *cells, "", "", ""])
    rows.append(["paper, generated", "198,157", _three(LEAST_CURVTTC), "0.015", "0.015", "", "", ""])
    rows.append(["paper, recorded (another corpus)", "336", _three(REAL_LEAST_CURVTTC), "", "", "", "", ""])
    caption = "D and Wasserstein distance: of the least CurvTTC, to recorded people. Small: 95% intervals."
    return html.table("How alike they are", head, rows, caption)


def _table_10(report: Mapping[str, Any]) -> str:
    head = ["", "kept", "paper", "simulated", "vehicle,<br>m each", "paper", "pedestrian,<br>m each", "paper"]
    rows = []
    for name, row in report["scenarios"].items():
        published = TABLE_10.get(row["number"])
        count, vehicle, pedestrian = "-", "-", "-"
        if published is not None:
            lengths = published.vehicle_km, published.pedestrian_km
            count, (vehicle, pedestrian) = f"{published.kept:,}", (f"{1e3 * km / published.kept:.1f}" for km in lengths)
        each = [
            f"{1e3 * row[key] / row['kept']:.1f}" if row["kept"] else "-" for key in ("vehicle_km", "pedestrian_km")
        ]
        rows.append(
            [escape(name), f"{row['kept']:,}", count, f"{row['simulated']:,}", each[0], vehicle, each[1], pedestrian]
        )
    return html.table("What was simulated and kept (Table 10)", head, rows)


def _provenance(report: Mapping[str, Any]) -> str:
    rows = [f"{name}: {escape(row['path'])} ({row['sha256'][:12]})" for name, row in report["inputs"]["files"].items()]
    rows.append(escape(", ".join(f"{name} {version}" for name, version in report["inputs"]["software"].items())))
    lines = "".join(f"<li>{row}" for row in rows)
    told = f"""In parentheses: SHA-256. All numbers: {NUMBERS}. Parameters, weights and versions of the dataset: its
        dataset.json."""
    return f"<h2>What this was made from</h2><ul class=small>{lines}</ul><p class=small>{told}</p>"


def _seconds(found: Mapping[str, Any]) -> str:
    return ", ".join(f"{quartile['value']:.2f}" for quartile in found["least_curvttc"]) + " s"


def _three(quartiles: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.2f}" for value in quartiles) + " s"


def _percent(found: Mapping[str, float]) -> str:
    value, low, high = (100.0 * found[key] for key in ("value", "low", "high"))
    return f"{value:.0f}% [{low:.0f}, {high:.0f}]"


def _number(found: Mapping[str, float]) -> str:
    return f"{found['value']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"


def _cell(found: Mapping[str, float], factor: float = 1.0) -> str:
    form, unit = (".1f", "%") if factor == 100.0 else (".3f", "")
    value, low, high = (factor * found[key] for key in ("value", "low", "high"))
    return f"{value:{form}}{unit}<small>{low:{form}} to {high:{form}}</small>"
