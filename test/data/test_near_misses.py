"""The near-miss table refuses what does not belong, by name and row, and splits by clip alone."""

import math
from pathlib import Path

import polars as pl
import pyarrow.parquet as pq
import pytest
from polars.testing import assert_frame_equal
from synthetic import synthetic_near_misses

from vpsci_ros.data.corpus import load_corpus, split_by_clip, split_by_name
from vpsci_ros.data.near_misses import (
    NEAR_MISS_COLUMNS,
    WORKED_OUT,
    check_near_misses,
    clips_of,
    concat_near_misses,
    read_near_misses,
    write_near_misses,
)
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.make_bank import bank_of_tables
from vpsci_ros.resources import near_misses_path


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    return synthetic_near_misses(6, seed=5).table


def test_a_table_survives_writing_and_reading_to_the_bit(table: pl.DataFrame, tmp_path: Path) -> None:
    write_near_misses(table, tmp_path / "near.parquet", {"made_by": "test"})
    assert_frame_equal(read_near_misses(tmp_path / "near.parquet"), table, check_exact=True)
    assert read_metadata(tmp_path / "near.parquet")["made_by"] == "test"


def test_columns_come_in_the_order_of_the_schema_and_in_its_types(table: pl.DataFrame, tmp_path: Path) -> None:
    shuffled = table.select(reversed(table.columns)).with_columns(
        pl.col("step").cast(pl.Int16), pl.col("ped_x").cast(pl.Float32), pl.lit(1).alias("weather")
    )
    shuffled.write_parquet(tmp_path / "own.parquet")
    read = read_near_misses(tmp_path / "own.parquet")
    assert dict(read.schema) == {name: column.dtype for name, column in NEAR_MISS_COLUMNS.items()}


def test_what_an_older_table_does_not_say_is_worked_out_and_said(table: pl.DataFrame, tmp_path: Path) -> None:
    metadata = {"sources": {"synthetic": {"vehicle_length": 4.5, "vehicle_width": 1.8}}}
    write_near_misses(table, tmp_path / "new.parquet", metadata)
    older = pq.read_table(tmp_path / "new.parquet").drop_columns(list(WORKED_OUT))
    pq.write_table(older, tmp_path / "old.parquet")
    with pytest.warns(UserWarning, match=r"old\.parquet: columns curvttc_causal, .*import its recordings again"):
        read = read_near_misses(tmp_path / "old.parquet")
    assert_frame_equal(read, table, abs_tol=1e-9)


@pytest.mark.parametrize("name", ["interaction", "clip", "veh_vx", "curvttc"])
def test_a_missing_column_is_named(table: pl.DataFrame, name: str) -> None:
    with pytest.raises(InvalidInput, match=f"FILE: .* needs column {name}; it has"):
        check_near_misses(table.drop(name), "FILE")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("veh_x", float("nan"), "veh_x, row 31 .*expected a finite number, got nan"),
        ("ped_vy", float("inf"), "ped_vy, row 31 .*expected a finite number, got inf"),
        ("ped_vy", None, "ped_vy, row 31 .*expected a value in every row, got None"),
        ("curvttc", float("nan"), "curvttc, row 31 .*infinity where no collision is predicted, never NaN, got nan"),
        ("curvttc", -1.0, "curvttc, row 31 .*not below 0.*got -1.0"),
        ("veh_speed", -0.5, "veh_speed, row 31 .*speed not below 0, got -0.5"),
        ("distance", 900.0, r"distance, row 31 .*metres between .*got 900.0"),
        ("veh_heading", 90.0, "veh_heading, row 31 .*radians, unwrapped.*got 90.0"),
        ("time", 0.0, "time, row 31 .*plus 0.1 s: resample"),
        ("step", 99, "step, row 31 .*plus 1.*got 99"),
        ("ped_id", 99, "ped_id, row 31 .*one value an interaction, got 99"),
        ("clip", "other", "clip, row 31 .*one value an interaction, got other"),
    ],
)
def test_a_bad_value_is_refused_with_column_row_and_remedy(
    table: pl.DataFrame, name: str, value: object, message: str
) -> None:
    assert table["interaction"][30] == table["interaction"][31]
    here = pl.int_range(pl.len()) == 31
    bad = table.with_columns(pl.when(here).then(pl.lit(value)).otherwise(pl.col(name)).alias(name))
    with pytest.raises(InvalidInput, match=f"^FILE: column {message}"):
        check_near_misses(bad, "FILE")


def test_a_gap_and_unsorted_rows_are_refused(table: pl.DataFrame) -> None:
    with pytest.raises(InvalidInput, match=r"column step, row 4 .*split interactions at gaps"):
        check_near_misses(table.filter(pl.int_range(pl.len()) != 4), "FILE")
    with pytest.raises(InvalidInput, match="column step, row 1 "):
        check_near_misses(table.sort("interaction", "step", descending=[False, True]), "FILE")
    with pytest.raises(InvalidInput, match="rows of interaction 0 lie apart"):
        check_near_misses(table.sort("step", "interaction", maintain_order=True), "FILE")


def test_degrees_and_headings_from_north_are_suspected(table: pl.DataFrame) -> None:
    north = table.with_columns((math.pi / 2 - pl.col("veh_heading")).alias("veh_heading"))
    with pytest.raises(InvalidInput, match=r"do not point along veh_heading .*convert degrees"):
        check_near_misses(north, "FILE")


def test_an_interaction_that_never_is_critical_is_no_near_miss(table: pl.DataFrame) -> None:
    quiet = pl.when(pl.col("interaction") == 2).then(8.0).otherwise(pl.col("curvttc")).alias("curvttc")
    with pytest.raises(InvalidInput, match="interaction 2 never falls below 5 s"):
        check_near_misses(table.with_columns(quiet), "FILE")


def test_an_empty_table_and_what_is_not_parquet_are_refused(table: pl.DataFrame, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="without a row"):
        check_near_misses(table.clear(), "FILE")
    with pytest.raises(InvalidInput, match="no such file"):
        read_near_misses(tmp_path / "absent.parquet")
    (tmp_path / "text.parquet").write_text("interaction,source\n")
    with pytest.raises(InvalidInput, match=r"text\.parquet: expected a near-miss table in Parquet"):
        read_near_misses(tmp_path / "text.parquet")


def test_tables_are_joined_with_new_numbers_and_never_twice(table: pl.DataFrame) -> None:
    other = table.with_columns(pl.lit("elsewhere").alias("source"))
    whole = concat_near_misses([table, other])
    assert whole["interaction"].unique(maintain_order=True).to_list() == list(range(12))
    check_near_misses(whole, "whole")
    with pytest.raises(InvalidInput, match=r"clip .* is there twice"):
        concat_near_misses([table, table])


def test_clips_are_held_out_whole_and_in_every_source(table: pl.DataFrame) -> None:
    whole = concat_near_misses([table, table.with_columns(pl.lit("elsewhere").alias("source"))])
    training, held_out = split_by_clip(whole, 0.34, seed=3)
    assert not set(training["clip"] + training["source"]) & set(held_out["clip"] + held_out["source"])
    assert sorted(pl.concat([training, held_out])["interaction"].unique()) == list(range(12))
    assert held_out.group_by("source").agg(pl.col("interaction").n_unique())["interaction"].to_list() == [2, 2]


def test_a_split_depends_on_the_seed_alone_and_not_on_the_order_of_rows(table: pl.DataFrame) -> None:
    first = split_by_clip(table, 0.34, seed=3)[1]["clip"].unique().sort()
    turned = table.sort("interaction", descending=True, maintain_order=True)
    assert split_by_clip(turned, 0.34, seed=3)[1]["clip"].unique().sort().equals(first)
    assert any(not split_by_clip(table, 0.34, seed=k)[1]["clip"].unique().sort().equals(first) for k in range(5))


def test_one_clip_cannot_be_split(table: pl.DataFrame) -> None:
    with pytest.raises(InvalidInput, match=r"two clips or more of a source, .* got \S+/\S+; add recordings, or cut"):
        split_by_clip(table.filter(pl.col("interaction") == 0), 0.5, seed=0)
    with pytest.raises(InvalidInput, match="held_out_fraction = 1"):
        split_by_clip(table, 1.0, seed=0)


def test_clips_held_out_by_name_are_those_whose_names_begin_so(table: pl.DataFrame) -> None:
    names = clips_of(table)
    training, held_out = split_by_name(table, [names[0], names[-1]])
    assert clips_of(held_out) == [names[0], names[-1]]
    assert sorted(clips_of(training) + clips_of(held_out)) == names
    assert split_by_name(table, [])[1].is_empty()
    with pytest.raises(InvalidInput, match="held_out_clips = .*: all 6 clips begin so"):
        split_by_name(table, [""])


def test_a_name_with_which_no_clip_begins_is_refused_with_what_there_is(table: pl.DataFrame) -> None:
    names = ", ".join(clips_of(table))
    told = f"held_out_clips = elsewhere/: no clip begins so; the near misses have {names}"
    with pytest.raises(InvalidInput, match=told):
        split_by_name(table, [clips_of(table)[0], "elsewhere/"])
    has = (
        r"cqut-pvi/dev/corner1/ \(\d+ clips\), cqut-pvi/dev/corner2/ .*, cqut-pvi/train/corner2/ \(\d+ clips\), "
        "such as cqut-pvi/dev/corner1/"
    )
    with pytest.raises(InvalidInput, match=f"--without cqut-pvi/dv: no clip begins so; the near misses have {has}"):
        bank_of_tables(["right_turns"], without=["cqut-pvi/train/", "cqut-pvi/dv"])


def test_the_right_turns_of_the_package_are_real_near_misses_of_two_corners_and_two_parts() -> None:
    table = read_near_misses("right_turns")
    assert near_misses_path("right_turns").stat().st_size < 2e6
    assert table["source"].unique().to_list() == ["cqut-pvi"]
    begin = table.filter(pl.col("step") == 0)
    names = begin["clip"].str.split("/").list
    assert dict(names.get(0).value_counts().rows()) == {"train": 595, "dev": 152}
    assert names.get(1).unique().sort().to_list() == ["corner1", "corner2"]
    for name in ("LICENSE", "README.md"):
        assert (near_misses_path("right_turns").parent / name).is_file()
    parts = [read_near_misses(f"right_turns/{part}") for part in ("train", "dev")]
    assert [part["interaction"].n_unique() for part in parts] == [595, 152]
    assert_frame_equal(load_corpus([]), concat_near_misses(parts[:1]))  # what is learned from where nothing is given


def test_a_part_of_a_table_is_named_as_if_the_table_were_a_folder_of_its_clips(
    table: pl.DataFrame, tmp_path: Path
) -> None:
    path, clip = tmp_path / "near.parquet", pl.col("clip")
    write_near_misses(
        table.with_columns(
            (pl.when(clip.str.ends_with("9")).then(pl.lit("dev/")).otherwise(pl.lit("train/")) + clip).alias("clip")
        ),
        path,
    )
    assert near_misses_path(path / "train" / "synthetic_00002") == path
    for part, count in {"train": 5, "train/synthetic_00002": 1, "dev": 1}.items():
        assert read_near_misses(path / part)["clip"].n_unique() == count
    with pytest.raises(InvalidInput, match=r"near.parquet has no clip tra and none .* its parts are dev, train"):
        read_near_misses(path / "tra")
    write_near_misses(table, path)
    with pytest.raises(InvalidInput, match="has no clip train .* its clips have no parts"):
        read_near_misses(f"{path}/train")
    with pytest.raises(InvalidInput, match="right_turn/train: no such file"):
        read_near_misses("right_turn/train")


def test_a_compact_table_keeps_coordinates_of_a_map_to_a_tenth_of_a_millimetre(table, tmp_path: Path) -> None:
    moved = table.with_columns(pl.col("veh_x", "ped_x") + 604_098.4, pl.col("veh_y", "ped_y") + 5_790_123.7)
    write_near_misses(moved, tmp_path / "compact.parquet", compact=True)
    for name in ("veh_x", "veh_y", "ped_x", "ped_y"):
        found = read_near_misses(tmp_path / "compact.parquet")[name].to_numpy()
        assert found == pytest.approx(moved[name].to_numpy(), rel=0.0, abs=1e-4)
