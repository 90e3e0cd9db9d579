"""The dataset's files: columns of Table 7, names of Table 6, every rejection counted, the same bytes for any batch."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest

from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_tables import INDEX
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import sha256
from vpsci_ros.world.state import COLLISION, GOAL, TIMEOUT

NAME = "LocationA_PedCross_S-N"
FURTHER = ["scenario", "heading_av", "speed_av", "curvature_av", "controlled", "seen"]
LENGTHS = [150, 60, 110, 201, 99, 120]
OUTCOMES = [GOAL, COLLISION, GOAL, TIMEOUT, COLLISION, COLLISION]
TABLE_7 = [
    *("count", "frame", "veh_id", "ped_id", "position_x_av", "position_y_av", "velocity_x_av", "velocity_y_av"),
    *("position_x_ped", "position_y_ped", "velocity_x_ped", "velocity_y_ped", "distance", "CurvTTC"),
]


def write(folder: Path, ticks, batch: int, **options) -> dict:
    collector = EpisodeFrames(batch)
    with DatasetWriter(folder, {1: NAME}, {"seed": 3, "weights": "abc", "period": 0.05}, **options) as writer:
        write_blocks(writer, (collector.add(tick) for tick in ticks))
        return writer.close(unfinished=collector.unfinished)


def test_kept_episodes_are_written_in_order_with_every_frame(simulate, tmp_path: Path) -> None:
    write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3)
    table = pl.read_parquet(tmp_path / "d" / f"{NAME}.parquet")
    assert table.columns[: len(TABLE_7)] == TABLE_7
    assert table.columns[len(TABLE_7) :] == FURTHER
    assert table["scenario"].unique().to_list() == [1]
    assert table["heading_av"].unique().to_list() == [np.float32(0.5)]
    assert table.group_by("count", maintain_order=True).agg(pl.len()).rows() == [(0, 150), (2, 110), (3, 201), (5, 120)]
    one = table.filter(pl.col("count") == 3)
    assert one["frame"].to_list() == list(range(201))
    assert one["position_x_av"].to_numpy() == pytest.approx(5.0 * np.cos(0.5) * 0.05 * np.arange(201), abs=1e-5)
    assert one["CurvTTC"].is_infinite().sum() == 21
    assert (
        table["veh_id"].n_unique() + table["ped_id"].n_unique() == len(set(table["veh_id"]) | set(table["ped_id"])) == 8
    )


def test_the_page_s_recipe_reads_all_tables_by_pandas_and_joins_the_index_by_polars(
    simulate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pandas = pytest.importorskip("pandas", reason="pip install 'vpsci_ros[test]'")
    folder = tmp_path / "out" / "vpsci"
    write(folder, simulate(LENGTHS, OUTCOMES, 3), 3, formats=["parquet", "csv"])
    with pytest.raises(ValueError, match="Could not read schema"):
        pandas.read_parquet(folder)
    page = (Path(__file__).parents[2] / "docs" / "dataset.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(page.partition("```python\n")[2].partition("```")[0], names)
    assert names["rows"].groupby("count").size().to_dict() == {0: 150, 2: 110, 3: 201, 5: 120}
    outcomes = names["frames"].group_by("outcome").len().sort("len")
    assert outcomes.rows() == [("collision", 120), ("timeout", 201), ("goal", 260)]


def test_csv_is_the_text_of_the_parquet_file(simulate, tmp_path: Path) -> None:
    write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3, row_group=200, formats=["parquet", "csv"])
    table = pl.read_parquet(tmp_path / "d" / f"{NAME}.parquet")
    path = tmp_path / "d" / f"{NAME}.csv"
    assert path.read_text() == table.write_csv()
    assert pl.read_csv(path, schema=table.schema).equals(table)
    with pytest.raises(InvalidInput, match="formats: expected some of parquet, csv, got xlsx"):
        DatasetWriter(tmp_path / "e", {1: NAME}, {}, formats=["xlsx"])


def test_units_and_provenance_are_in_the_schema(simulate, tmp_path: Path) -> None:
    write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3)
    schema = pq.read_schema(tmp_path / "d" / f"{NAME}.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in schema}
    assert units["position_x_av"] == "m"
    assert units["velocity_y_ped"] == "m/s"
    assert units["CurvTTC"] == "s"
    assert read_metadata(tmp_path / "d" / f"{NAME}.parquet")["seed"] == 3


@pytest.mark.parametrize("batch", [1, 4, 6])
def test_the_bytes_do_not_depend_on_the_batch(simulate, tmp_path: Path, batch: int) -> None:
    write(tmp_path / "a", simulate(LENGTHS, OUTCOMES, 3), 3, row_group=200)
    write(tmp_path / "b", simulate(LENGTHS, OUTCOMES, batch), batch, row_group=200)
    assert pq.ParquetFile(tmp_path / "a" / f"{NAME}.parquet").num_row_groups == 3
    for name in (f"{NAME}.parquet", INDEX):
        assert sha256(tmp_path / "a" / name) == sha256(tmp_path / "b" / name)


def test_rejections_are_counted_by_reason_and_collisions_apart(simulate, tmp_path: Path) -> None:
    counts = write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3)["scenarios"][NAME]
    assert (counts["simulated"], counts["kept"], counts["acceptance_rate"]) == (6, 4, 4 / 6)
    assert counts["rejected"]["too short"] == 2
    assert sum(counts["rejected"].values()) == 2
    assert counts["outcomes"] == {"collision": 3, "goal": 2, "timeout": 1}
    assert counts["kept_outcomes"]["collision"] == 1
    assert counts["rejected_collisions"]["too short"] == 2
    assert counts["vehicle_km"] == pytest.approx((149 + 109 + 200 + 119) * 0.25 / 1000.0, abs=1e-6)


def test_the_index_has_every_episode_with_its_reason(simulate, tmp_path: Path) -> None:
    write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3)
    index = pl.read_parquet(tmp_path / "d" / INDEX)
    assert index["count"].to_list() == list(range(6))
    assert index.filter(pl.col("count") == 4).select("outcome", "reason", "frames").row(0) == (
        "collision",
        "too short",
        99,
    )
    predicted, collided = 4.0 + 0.01 * np.arange(6), np.array(OUTCOMES) == COLLISION
    assert index["least_curvttc"].to_numpy() == pytest.approx(np.where(collided, 0.0, predicted), rel=1e-6)


def test_dataset_json_names_every_file_with_its_hash(simulate, tmp_path: Path) -> None:
    returned = write(tmp_path / "d", simulate(LENGTHS, OUTCOMES, 3), 3, keep_rejected=True, formats=["parquet", "csv"])
    description = json.loads((tmp_path / "d" / DESCRIPTION).read_text())
    assert description == returned
    on_disk = {p.relative_to(tmp_path / "d").as_posix() for p in (tmp_path / "d").rglob("*") if p.is_file()}
    assert set(description["files"]) == on_disk - {DESCRIPTION}
    for name, entry in description["files"].items():
        assert entry["sha256"] == sha256(tmp_path / "d" / name)
    assert (description["seed"], description["weights"], description["unfinished"]) == (3, "abc", 0)
    assert description["filters"]["least_frames"] == 100


@pytest.mark.parametrize("late", [False, True])
def test_a_run_that_fails_leaves_nothing_behind(simulate, tmp_path: Path, late: bool) -> None:
    def cut(*_: object) -> str:
        raise RuntimeError("cut")

    with (
        pytest.raises(RuntimeError, match="cut"),
        DatasetWriter(tmp_path / "d", {1: NAME}, {}, keep_rejected=True, formats=["parquet", "csv"]) as writer,
    ):
        collector = EpisodeFrames(3)
        write_blocks(writer, (collector.add(tick) for tick in simulate(LENGTHS, OUTCOMES, 3)))
        if late:
            writer.close(beside={"weights": b"w"}, datasheet=cut)
        cut()
    assert list((tmp_path / "d").iterdir()) == []


def test_an_episode_that_comes_twice_is_refused(simulate, tmp_path: Path) -> None:
    collector = EpisodeFrames(3)
    blocks = [collector.add(tick) for tick in simulate(LENGTHS, OUTCOMES, 3)]
    with (
        pytest.raises(InvalidInput, match="episode 0 of scenario 1 came twice"),
        DatasetWriter(tmp_path / "d", {1: NAME}, {}) as writer,
    ):
        write_blocks(writer, [*blocks, *blocks])
