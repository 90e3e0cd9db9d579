"""The report of a dataset holds what it was given to compare, says what is missing, and refuses what it cannot read."""

import json
import re
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.section_4.bins import QUESTIONS
from vpsci_ros.extras.paper.section_4.section_4_page import NUMBERS, PAGE, TABLE, write_report
from vpsci_ros.extras.paper.section_4.table import _nearer_than_a_coin

Written = tuple[Path, dict[str, Any]]
PICTURES = ("trajectories", "nearness", "conflicts", "pedestrian_yields", "vehicle_yields")


SIZE = {"vehicle_length": 4.69, "vehicle_width": 1.85}
SOURCES = {"corner": SIZE, "tgsim": {**SIZE, "pairs": 32, "near_misses": 8}}


@pytest.fixture(scope="module")
def near_misses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "near_misses.parquet"
    place = pl.when(pl.col("interaction") < 12).then(pl.lit("corner")).otherwise(pl.lit("tgsim"))
    write_near_misses(
        synthetic_near_misses(interactions=20, seed=1).table.with_columns(source=place), path, {"sources": SOURCES}
    )
    return path


@pytest.fixture(scope="module")
def written(dataset: Path, near_misses: Path, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A report of the small dataset beside recorded people and itself: its folder and its numbers."""
    folder = tmp_path_factory.mktemp("report") / "out"
    return folder, write_report(dataset, folder, near_misses=near_misses, beside=dataset)


def test_a_report_is_one_page_with_its_pictures_in_it_and_all_numbers_beside_it(written: Written) -> None:
    folder, report = written
    page = (folder / PAGE).read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == len(PICTURES)
    assert all((folder / f"{name}.png").read_bytes().startswith(b"\x89PNG") for name in PICTURES)
    assert json.loads((folder / NUMBERS).read_text()) == report
    assert "LocationA_PedCross_S-N" in page


def test_shares_of_critical_encounters_stand_beside_the_papers_where_the_import_counted_them(written: Written) -> None:
    folder, report = written
    assert report["critical_shares"] == {"tgsim": {"pairs": 32, "near_misses": 8}}
    page = (folder / PAGE).read_text(encoding="utf-8")
    assert re.search(r"<td>tgsim<td>32<td>8<td>25.00%\s*<td>55.77%", page)
    assert "Shares of critical encounters (section 4.2) of Argoverse 2" in page, "Argoverse 2 is still missing"


def test_a_report_compares_every_source_with_recorded_people(written: Written) -> None:
    _, report = written
    assert report["sources"]["generated"] == report["sources"]["beside"]
    assert report["sources"]["generated"]["interactions"] == 6
    assert report["sources"]["recorded"]["interactions"] == 20
    assert report["sources"]["recorded_corner"]["interactions"] == 12
    assert report["sources"]["recorded_tgsim"]["interactions"] == 8
    assert set(report["distance"]) == {"generated", "beside", "between_halves_of_recorded"}
    assert report["distance"]["generated"] == report["distance"]["beside"]


def test_the_table_has_recordings_their_halves_each_dataset_and_the_paper_side_by_side(
    written: Written, dataset: Path
) -> None:
    folder, report = written
    heads, _, *rows = [line.strip("| ").split(" | ") for line in (folder / TABLE).read_text("utf-8").splitlines()]
    name = str(dataset)  # twice the same folder, so that its name would not tell the two apart
    assert heads == ["recorded", "halves of it", name, name, "paper"]
    table = {name: cells for name, *cells in rows}
    ks = report["distance"]["generated"]["ks"]
    cell = f"{ks['value']:.3f} [{ks['low']:.3f}, {ks['high']:.3f}]"
    assert table["KS distance to recorded"][2:] == [cell, cell, "0.015"]
    assert table["interactions"][0] == "20"
    conflicts = table["conflicts: walking < 0.5, 0.5-1, 1-1.5, >= 1.5 m/s [%]"]
    assert conflicts[2] == "-, -, -, -", "six episodes are too few for any share"
    assert conflicts[-1] == "rise"
    page = (folder / PAGE).read_text(encoding="utf-8")
    assert "<td>conflicts: walking &lt; 0.5, 0.5-1, 1-1.5, &gt;= 1.5 m/s [%]" in page


def test_a_dataset_without_a_kept_episode_is_refused_before_anything_is_written(
    harmless_dataset: Path, near_misses: Path, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match="generated: no interaction with CurvTTC of 5 s or less"):
        write_report(harmless_dataset, tmp_path / "out", near_misses=near_misses)
    assert not (tmp_path / "out").exists()


def test_a_dataset_is_nearer_than_a_coin_where_its_shares_change_as_the_recorded_ones_do() -> None:
    """Of a coin that has the recorded share of all interactions in every bin."""
    flags = {question.flag: {"value": 0.4} for question in QUESTIONS}
    rising = {question.name: [{"value": 0.1 * k} for k in range(len(question.bins))] for question in QUESTIONS}
    coin = {name: [{"value": 0.4} for _ in shares] for name, shares in rising.items()}
    unknown = {name: [{"value": None} for _ in shares] for name, shares in rising.items()}
    report = {
        "sources": {"recorded": flags},
        "bins": {"recorded": rising, "alike": rising, "coin": coin, "few": unknown},
    }
    found = [_nearer_than_a_coin(report, "recorded", key) for key in ("alike", "coin", "few")]
    assert found == ["8 of 8", "0 of 8", "0 of 0"]
