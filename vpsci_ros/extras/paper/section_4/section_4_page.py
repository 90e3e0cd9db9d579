"""The report of a dataset: numbers as JSON and as a table, pictures as PNG, and one HTML page that holds all of it."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import clean, read_near_misses
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC, TABLE_10
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.published import CRITICAL_SHARES, KS, WASSERSTEIN
from vpsci_ros.extras.paper.section_4.bins import LEAST_IN_BIN, by_bins
from vpsci_ros.extras.paper.section_4.comparison import SHARES, between_halves, describe, distance_between
from vpsci_ros.extras.paper.section_4.encounters import generated_encounters, recorded_encounters, units_in
from vpsci_ros.extras.paper.section_4.figures import save_conflicts, save_nearness, save_yielding
from vpsci_ros.extras.paper.section_4.table import markdown, rows_of
from vpsci_ros.extras.paper.section_4.typical_episodes import typical_episodes
from vpsci_ros.extras.paper.trajectories import save_trajectories
from vpsci_ros.report import html
from vpsci_ros.resources import near_misses_path
from vpsci_ros.runs.files import require_empty_folder, sha256, write_text
from vpsci_ros.runs.provenance import software_versions

PAGE, NUMBERS, TABLE, VIEW = "report.html", "report.json", "report.md", "view.html"
PICTURES = ("trajectories", "nearness", "conflicts", "pedestrian_yields", "vehicle_yields")
GENERATED, RECORDED, CLEAN, BESIDE = "generated", "recorded", "recorded_clean", "beside"
TITLES = {
    GENERATED: "generated",
    BESIDE: "the other dataset",
    RECORDED: "recorded",
    CLEAN: "of them, with an onset and a car that drives",
}
_COUNTS = ("number", "simulated", "kept", "vehicle_km", "pedestrian_km")


def write_report(
    folder: Path,
    output: Path,
    *,
    near_misses: Path,
    beside: Path | None = None,
    notify: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Write the report of a dataset into `output` and return its numbers, those of `report.json`.

    :param folder: of `vpsci generate`.
    :param near_misses: recorded ones to compare with, see `read_near_misses`.
    :param beside: another dataset to compare with, say of the rule-based pair.
    :param notify: called with what is being done.
    :raises InvalidInput: an input cannot be read or holds nothing, or `output` holds anything but such a report.
    """
    notify("reading")
    data, titles = Dataset(folder), dict(TITLES)
    other = None if beside is None else Dataset(beside)
    sources = {GENERATED: generated_encounters(data)}
    tables: dict[str, pl.DataFrame] = {}  # recorded near misses, by source
    if other is not None:
        sources[BESIDE] = generated_encounters(other)
    recorded = read_near_misses(near_misses)
    tables[RECORDED] = recorded
    if (cleaned := clean(recorded)).height:
        tables[CLEAN] = cleaned
    if recorded["source"].n_unique() > 1:
        for name in recorded["source"].unique().sort():
            titles[f"{RECORDED}_{name}"] = f"of them, {name}"
            tables[f"{RECORDED}_{name}"] = recorded.filter(pl.col("source") == name)
    sources |= {name: recorded_encounters(table) for name, table in tables.items()}
    for name, table in sources.items():
        if not table.height:
            raise InvalidInput(f"{titles[name]}: no interaction with CurvTTC of 5 s or less; nothing to report")
    require_empty_folder(output, PAGE, NUMBERS, TABLE, VIEW, *(f"{name}.png" for name in PICTURES))
    notify("resampling")
    report = _numbers(data, sources, {name: units_in(table).name for name, table in tables.items()})
    report["critical_shares"] = critical_shares(near_misses)
    report["inputs"] = _inputs(data, near_misses, other)
    notify("drawing")
    pictures = _draw(data, {name: table for name, table in sources.items() if name in TITLES}, output)
    write_text(output / NUMBERS, json.dumps(report, indent=1) + "\n")
    given = {GENERATED: folder} | ({} if beside is None else {BESIDE: beside})
    heads, rows = rows_of(report, RECORDED, _heads(given))
    write_text(output / TABLE, markdown(heads, rows))
    html.write_page(
        output / PAGE,
        Path(__file__).resolve().parent / "templates" / "report.html",
        title=f"Report on {folder}",
        folder=folder,
        report=report,
        pictures=pictures,
        titles=titles,
        shares=SHARES,
        published=LEAST_CURVTTC,
        published_real=REAL_LEAST_CURVTTC,
        published_ks=KS,
        published_wasserstein=WASSERSTEIN,
        heads=heads,
        rows=rows,
        least_in_bin=LEAST_IN_BIN,
        table_10=TABLE_10,
        published_shares=CRITICAL_SHARES,
        numbers=NUMBERS,
        view=VIEW,
    )
    return report


def critical_shares(near_misses: Path) -> dict[str, dict[str, int]]:
    """Return the numbers of imported and of critical pairs by source, if the table has these numbers."""
    sources = read_metadata(near_misses_path(near_misses)).get("sources", {})
    names = "pairs", "near_misses"
    return {
        source: {name: int(row[name]) for name in names}
        for source, row in sources.items()
        if all(isinstance(row.get(name), int) and row[name] > 0 for name in names)
    }


def sources_of_report(folder: Path, near_misses: Path, beside: Path | None) -> list[tuple[str, str, Path]]:
    """Return key, title and path of each source of a report; the report's links use the keys."""
    given = {GENERATED: folder, BESIDE: beside, RECORDED: near_misses}
    return [(key, TITLES[key], path) for key, path in given.items() if path is not None]


def _heads(folders: Mapping[str, Path]) -> dict[str, str]:
    """Return what a table calls these datasets: the names of their folders, or their paths where two are alike."""
    names = {key: path.resolve().name for key, path in folders.items()}
    return names if len(set(names.values())) == len(names) else {key: str(path) for key, path in folders.items()}


def _numbers(data: Dataset, sources: Mapping[str, pl.DataFrame], units: Mapping[str, str]) -> dict[str, Any]:
    """Return the report's numbers; `units`: what intervals of recorded sources resample, clips or groups."""
    report: dict[str, Any] = {
        "scenarios": {name: {key: row[key] for key in _COUNTS} for name, row in data.scenarios.items()},
        "sources": {
            name: describe(table, clustered=name in units) | {"units": units.get(name, "episodes")}
            for name, table in sources.items()
        },
        "bins": {name: by_bins(table, clustered=name in units) for name, table in sources.items()},
    }
    recorded = sources[RECORDED]
    others = {name: table for name, table in sources.items() if not name.startswith(RECORDED)}
    report["distance"] = {name: distance_between(recorded, table) for name, table in others.items()}
    report["distance"]["between_halves_of_recorded"] = between_halves(recorded)
    return report


def _inputs(data: Dataset, near_misses: Path, beside: Dataset | None) -> dict[str, Any]:
    files: dict[str, Path] = {}
    for key, each in {"dataset": data, "beside": beside}.items():
        paths = {} if each is None else each.inputs
        files |= {key if len(paths) == 1 else f"{key}/{name}": path for name, path in paths.items()}
    files["near_misses"] = near_misses
    return {
        "files": {name: {"path": str(path), "sha256": sha256(near_misses_path(path))} for name, path in files.items()},
        "software": software_versions(),
    }


def _draw(data: Dataset, sources: Mapping[str, pl.DataFrame], output: Path) -> dict[str, Path]:
    titled = {TITLES[name]: table for name, table in sources.items()}
    paths = {name: output / f"{name}.png" for name in PICTURES}
    save_trajectories(typical_episodes(data), paths["trajectories"])
    save_nearness(titled, paths["nearness"])
    save_conflicts(titled, paths["conflicts"])
    for agent in ("pedestrian", "vehicle"):
        save_yielding(titled, agent, paths[f"{agent}_yields"])
    return paths
