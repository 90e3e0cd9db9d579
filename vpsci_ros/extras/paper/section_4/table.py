"""Sections 4.3, 4.5 and 4.6 as one table in Markdown: recordings, their halves as the control, datasets, the paper."""

from collections.abc import Mapping, Sequence
from typing import Any

from vpsci_ros.data.published import LEAST_CURVTTC, REAL_LEAST_CURVTTC
from vpsci_ros.extras.paper.published import KS, WASSERSTEIN
from vpsci_ros.extras.paper.section_4.bins import QUESTIONS

Rows = list[list[str]]
MANY = 3  # shares of a question, fewer of which say little of how they change


def rows_of(report: Mapping[str, Any], recorded: str, datasets: Mapping[str, str]) -> tuple[list[str], Rows]:
    """Return the heads and the rows of the table, as text.

    :param report: the numbers of `page.write_report`.
    :param recorded: key of the recorded source in `report`.
    :param datasets: key of a source -> head of its column.
    """
    keys = [recorded, *datasets]
    sources = [report["sources"][key] for key in keys]
    heads = ["", "recorded", "halves of it", *datasets.values(), "paper"]

    def row(name: str, cells: Sequence[str], paper: str, halves: str = "") -> list[str]:
        return [name, cells[0], halves, *cells[1:], paper]

    rows = [row("interactions", [f"{each['interactions']:,}" for each in sources], "336; 198,157")]
    quartiles = [_three(estimate["value"] for estimate in each["least_curvttc"]) for each in sources]
    published = f"{_three(REAL_LEAST_CURVTTC)}; {_three(LEAST_CURVTTC)}"
    rows.append(row("least CurvTTC, quartiles [s]", quartiles, published))
    for name, measure, digits, paper in (
        ("KS distance to recorded", "ks", 3, f"{KS:.3f}"),
        ("Wasserstein distance to recorded [s]", "wasserstein", 2, f"{WASSERSTEIN:.3f}"),
    ):
        apart = report["distance"]
        cells = [_bounded(apart[key][measure], digits) for key in datasets]
        halves = _bounded(apart["between_halves_of_recorded"][measure], digits)
        rows.append(row(name, ["", *cells], paper, halves))
    for name, flag in (
        ("vehicle yields [%]", "vehicle_yields"),
        ("pedestrian yields [%]", "pedestrian_yields"),
        ("conflicts [%]", "conflict"),
    ):
        rows.append(row(name, [_bounded(each[flag], 1, 100.0) for each in sources], ""))
    for question in QUESTIONS:
        cells = [", ".join(map(_share, report["bins"][key][question.name])) for key in keys]
        rows.append(row(f"{question.name} [%]", cells, question.paper))
    nearer = [_nearer_than_a_coin(report, recorded, key) for key in datasets]
    rows.append(row(f"nearer than a coin, of rows with {MANY} shares or more", ["", *nearer], ""))
    return heads, rows


def _nearer_than_a_coin(report: Mapping[str, Any], recorded: str, key: str) -> str:
    """Return in how many rows the shares of a dataset are nearer to the recorded ones than a coin is, of how many.

    The coin has the recorded share of all interactions in every bin; the distance is the mean over bins that both have.
    """
    nearer = counted = 0
    for question in QUESTIONS:
        coin = report["sources"][recorded][question.flag]["value"]
        shares = [[found["value"] for found in report["bins"][of][question.name]] for of in (recorded, key)]
        known = [pair for pair in zip(*shares, strict=True) if None not in pair]
        if len(question.bins) >= MANY and known:
            counted += 1
            nearer += sum(abs(own - other) for own, other in known) < sum(abs(own - coin) for own, _ in known)
    return f"{nearer} of {counted}"


def markdown(heads: Sequence[str], rows: Rows) -> str:
    """Return a table in Markdown."""
    lines = [heads, ["---", *(["---:"] * (len(heads) - 1))], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _three(values: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def _bounded(estimate: Mapping[str, float], digits: int, factor: float = 1.0) -> str:
    value, low, high = (f"{factor * estimate[name]:.{digits}f}" for name in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


def _share(found: Mapping[str, Any]) -> str:
    """Return a share in percent with half the width of its interval; "-" of too few interactions."""
    if found["value"] is None:
        return "-"
    return f"{100.0 * found['value']:.0f} ±{50.0 * (found['high'] - found['low']):.0f}"
