"""Exams of several systems on the same episodes: one table, paired differences, and an order.

With each pedestrian the systems are in the order of their failures. Two of them have an order where McNemar's exact
test of the episodes in which only one of them fails is below 5%, corrected for the number of pairs (Holm, 1979). Else
either may be the better one, and their ranks overlap.
"""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
from rich import box
from rich.table import Table

from vpsci_ros.documents import listed, read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.comparison import conditions_of
from vpsci_ros.exam.exam import ADS, EXAM, title_of
from vpsci_ros.exam.measures import EPISODES, read_episode_table
from vpsci_ros.exam.report import as_dict, definitions, differences, rows_of
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES, estimate
from vpsci_ros.report import html
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.text_table import table_console

LEVEL = 0.05  # of the test by which two systems have an order
_KEY = ["scenario", "episode"]
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "compare.html"


class Finished(NamedTuple):
    """A finished exam.

    :ivar name: of the folder, as it was given.
    :ivar failure: column of the table that counts as a failure.
    :ivar rows: of its driving system, a row an episode.
    """

    name: str
    ads: str
    failure: str
    rows: pl.DataFrame


def compare_exams(folders: Sequence[Path], page: Path, json_path: Path | None = None) -> None:
    """Compare exams of the same episodes, print the order of their systems, and write the page and the numbers.

    :raises InvalidInput: fewer than two exams, one that is not over, or exams of different episodes.
    """
    found = compared(read_exams(folders))
    html.write_page(
        page,
        _TEMPLATE,
        title="Driving systems side by side",
        report=found,
        titles={name: title_of(name) for name in found["pedestrians"]},
        definitions=definitions(),
        measures=DIFFERENCES,
    )
    if json_path is not None:
        write_json(json_path, found)
    _print(found)
    print(f"written: {page}" + (f", {json_path}" if json_path else ""))


def read_exams(folders: Sequence[Path]) -> list[Finished]:
    """Return the exams in these folders.

    :raises InvalidInput: see `compare_exams`.
    """
    if len({folder.resolve() for folder in folders}) < max(2, len(folders)):
        raise InvalidInput("ads-compare: expected two exams or more, each named once")
    found: list[Finished] = []
    first: dict[str, Any] = {}
    for folder in folders:
        if not (folder / EPISODES).is_file():
            raise InvalidInput(f"{folder}: no exam that is over; expected {EPISODES} in it")
        stored, report = read_json(folder / EXAM), read_json(folder / "report.json")
        require_form(stored, {"ads": str, "parameters": {"*": dict}}, f"{folder / EXAM}: not what an exam writes")
        require_form(report, {"failure": str}, f"{folder / 'report.json'}: not what an exam writes")
        episodes = {"only": stored["parameters"].get("world_simulator", {}).get("only", [])}
        conditions = conditions_of(stored) | {"world_simulator.only": episodes["only"], "failure": report["failure"]}
        first = first or conditions
        advice = "exams are compared on the same episodes: drive both with the same parameters"
        require_same(folder, conditions, first, "is an exam", advice, str(folders[0]))
        rows = rows_of(read_episode_table(folder), ADS)
        found.append(Finished(str(folder), stored["ads"], report["failure"], rows))
    return found


def compared(exams: Sequence[Finished]) -> dict[str, Any]:
    """Return the comparison as JSON values.

    :raises InvalidInput: there is no episode that all systems drove.
    """
    names = [name for name in exams[0].rows["pedestrian"].unique(maintain_order=True) if name != "alone"]
    pedestrians = {}
    for name in names:
        tables = [rows_of(exam.rows, ADS, name) for exam in exams]
        common = tables[0].select(_KEY)
        for table in tables[1:]:
            common = common.join(table.select(_KEY), on=_KEY, how="semi")
        if common.height:
            shared = [table.join(common, on=_KEY, how="semi") for table in tables]
            most = max(table.height for table in tables)
            pedestrians[name] = _with_one(exams, shared) | {"episodes": common.height, "driven": most}
    if not pedestrians:
        raise InvalidInput(f"no episode that all systems drove: {listed(exam.name for exam in exams)}")
    return {
        "exams": [{"exam": exam.name, "ads": exam.ads} for exam in exams],
        "failure": exams[0].failure,
        "pedestrians": pedestrians,
    }


def _with_one(exams: Sequence[Finished], tables: Sequence[pl.DataFrame]) -> dict[str, Any]:
    """Return measures, ranks and differences of all systems on their common episodes with one pedestrian."""
    failure = f"{exams[0].failure}_rate"
    measures = [{name: as_dict(estimate(rows, MEASURES[name])) for name in DIFFERENCES} for rows in tables]
    order = sorted(range(len(exams)), key=lambda n: measures[n][failure]["value"])
    pairs: list[dict[str, Any]] = [
        {"better": exams[a].name, "worse": exams[b].name, "differences": differences(tables[b], tables[a])}
        for a, b in itertools.combinations(order, 2)
    ]
    for pair, adjusted in zip(pairs, holm([pair["differences"][failure]["p"] for pair in pairs]), strict=True):
        pair |= {"p": adjusted, "sure": adjusted < LEVEL}
    systems = []
    for n in order:
        name = exams[n].name
        above = sum(pair["sure"] for pair in pairs if pair["worse"] == name)
        below = sum(pair["sure"] for pair in pairs if pair["better"] == name)
        systems.append({"exam": name, "rank": [above + 1, len(exams) - below], "measures": measures[n]})
    return {"systems": systems, "pairs": pairs}


def holm(values: Sequence[float]) -> list[float]:
    """Return p-values corrected for their number by Holm's method."""
    out, least = [0.0] * len(values), 0.0
    for place, n in enumerate(sorted(range(len(values)), key=values.__getitem__)):
        least = max(least, min(1.0, (len(values) - place) * values[n]))
        out[n] = least
    return out


def rank(system: Mapping[str, Any]) -> str:
    """Return the ranks that a system may have, such as "1" or "2 to 3"."""
    low, high = system["rank"]
    return f"{low}" if low == high else f"{low} to {high}"


def _print(found: Mapping[str, Any]) -> None:
    failure = MEASURES[f"{found['failure']}_rate"]
    console = table_console()
    for name, row in found["pedestrians"].items():
        view = Table(title=f"{title_of(name)}, {row['episodes']} episodes", box=box.SIMPLE_HEAD, title_justify="left")
        for head in ("rank", "exam", failure.title):
            view.add_column(head)
        for system in row["systems"]:
            value, low, high = (100.0 * system["measures"][failure.name][key] for key in ("value", "low", "high"))
            view.add_row(rank(system), system["exam"].replace("[", "\\["), f"{value:.1f}% \\[{low:.1f}, {high:.1f}]")
        console.print(view)
