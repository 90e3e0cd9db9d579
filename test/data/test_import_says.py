"""An import says what its recordings hold: who is too fast to walk, whose tracks jump, and who never comes near."""

import io
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from vpsci_ros.data.importers import ImportResult, import_trajectories, print_import_summary
from vpsci_ros.data.near_misses import (
    DERIVED,
    check_near_misses,
    concat_near_misses,
    read_near_misses,
    write_near_misses,
)
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report import recordings

CAR = 6.0  # [m/s]
LAYOUT = """columns: {id: id, time: time, class: class, x: x, y: y}
vehicles: [car]
pedestrians: [person]
"""


def track(name: str, kind: str, x, y, *, begin: float = 0.0) -> pl.DataFrame:
    """Return the rows of a road user, one each 0.04 s."""
    time = begin + 0.04 * np.arange(len(np.broadcast_arrays(x, y)[0]))
    return pl.DataFrame({"id": name, "time": time, "class": kind}).with_columns(x=pl.lit(x), y=pl.lit(y))


def a_car_and(*walkers: pl.DataFrame) -> list[pl.DataFrame]:
    """Return a car along x that comes to x = 0 after 5 s, and others."""
    t = 0.04 * np.arange(201)
    return [track("c", "car", CAR * (t - 5.0), np.zeros(201)), *walkers]


def crossing(name: str, speed: float) -> pl.DataFrame:
    """Return somebody who crosses the car's path at the time when it comes."""
    t = 0.04 * np.arange(201)
    return track(name, "person", np.zeros(201), speed * (t - 5.0))


def imported(folder: Path, tracks: list[pl.DataFrame], *, layout: str = "", fastest: float = np.inf) -> ImportResult:
    pl.concat(tracks).write_csv(folder / "a.csv")
    (folder / "layout.yaml").write_text(LAYOUT + layout)
    return import_trajectories(folder, "described", fastest=fastest)


def said(result: ImportResult) -> str:
    out = io.StringIO()
    print_import_summary(result, Console(file=out, width=150))
    return out.getvalue()


def test_an_import_says_which_share_of_its_pedestrians_is_faster_than_somebody_walks(tmp_path: Path) -> None:
    waits = np.concatenate([np.full(150, -5.0), -5.0 + 4.0 * 0.04 * np.arange(51)])  # rides a bicycle, after 6 s
    result = imported(
        tmp_path, a_car_and(crossing("p", 1.3), crossing("q", 4.0), track("r", "person", np.full(201, 9.0), waits))
    )
    assert result.summaries[0].fast == 2
    assert "described: 2 of 3 pedestrians (66.7%) are faster than 2.5 m/s (median while they move); --fas" in said(
        result
    )
    walks = imported(tmp_path, a_car_and(crossing("p", 1.3)))
    assert "described: 0 of 1 pedestrians (0.0%) are faster than 2.5 m/s (median while they move)\n" in said(walks)


def test_pedestrians_faster_than_allowed_are_left_out_and_counted(tmp_path: Path) -> None:
    result = imported(tmp_path, a_car_and(crossing("p", 1.3), crossing("q", 4.0)), fastest=2.5)
    assert (result.summaries[0].near_misses, result.summaries[0].pedestrians, result.summaries[0].fast) == (1, 1, 0)
    assert result.summaries[0].left_out == {"pedestrians faster than 2.5 m/s": 1}
    assert result.table["ped_vy"].to_numpy() == pytest.approx(1.3)


def test_a_track_is_cut_where_it_jumps_as_nobody_runs_and_the_jump_is_counted(tmp_path: Path) -> None:
    walker = crossing("p", 1.3)
    jump = 24.0 * 0.04  # [m] from one row to the next
    moved = walker.with_columns(y=pl.when(pl.col("time") > 4.0).then(pl.col("y") + jump).otherwise(pl.col("y")))
    result = imported(tmp_path, a_car_and(moved))
    count = {"speeds of pedestrians above 12 m/s (jumps), at which tracks are cut": 1}
    assert result.summaries[0].left_out == count
    assert result.summaries[0].pedestrians == 2
    assert result.table["ped_vy"].to_numpy() == pytest.approx(1.3)  # no slope over the jump
    assert "left out: speeds of pedestrians above 12 m/s (jumps), at which tracks are cut: 1" in said(result)
    assert imported(tmp_path, a_car_and(walker)).summaries[0].left_out == {}


def test_a_row_that_says_a_speed_at_which_nobody_runs_is_left_out_and_counted(tmp_path: Path) -> None:
    velocities = pl.concat(a_car_and(crossing("p", 1.3))).with_columns(
        vx=pl.when(pl.col("class") == "car").then(CAR).otherwise(0.0),
        vy=pl.when(pl.col("class") == "car").then(0.0).otherwise(1.3),
    )
    odd = (pl.col("id") == "p") & pl.col("time").is_between(3.99, 4.01)
    velocities = velocities.with_columns(vx=pl.when(odd).then(-24.0).otherwise(pl.col("vx")))
    velocities.write_csv(tmp_path / "a.csv")
    (tmp_path / "layout.yaml").write_text(LAYOUT.replace("y: y}", "y: y, vx: vx, vy: vy}"))
    result = import_trajectories(tmp_path, "described")
    assert [*result.summaries[0].left_out.values()] == [1]
    assert result.table["ped_vx"].to_numpy() == pytest.approx(0.0)
    assert result.summaries[0].near_misses == 1


def test_the_table_keeps_ids_and_sizes_and_the_group_of_who_met_one_car_at_one_time(tmp_path: Path) -> None:
    later = [track("d", "car", CAR * (0.04 * np.arange(201) - 5.0), np.zeros(201), begin=20.0)]
    tracks = [*a_car_and(crossing("p", 1.3), crossing("q", 1.2)), *later]
    tracks.append(crossing("r", 1.3).with_columns(pl.col("time") + 20.0))
    sized = pl.concat(tracks).with_columns(
        l=pl.when(pl.col("id") == "d").then(7.5).otherwise(4.2), w=pl.when(pl.col("id") == "d").then(2.4).otherwise(1.7)
    )
    layout = LAYOUT.replace("y: y}", "y: y, length: l, width: w}")
    sized.write_csv(tmp_path / "a.csv")
    (tmp_path / "layout.yaml").write_text(layout)
    result = import_trajectories(tmp_path, "described")
    columns = ["veh_name", "ped_name", "veh_length", "veh_width", "group"]
    rows = result.table.unique("interaction", maintain_order=True).select(columns).rows()
    assert rows == [("c", "p", 4.2, 1.7, 0), ("c", "q", 4.2, 1.7, 0), ("d", "r", 7.5, 2.4, 1)]
    write_near_misses(result.table, tmp_path / "o.parquet", result.metadata, compact=True)
    stored = read_near_misses(tmp_path / "o.parquet").unique("interaction", maintain_order=True)
    assert stored.select(columns).rows() == rows
    other = result.table.with_columns(source=pl.lit("elsewhere"))
    both = concat_near_misses([result.table, other])
    assert both.unique("interaction", maintain_order=True)["group"].to_list() == [0, 0, 1, 2, 2, 3]


def test_a_table_without_what_can_be_derived_reads_as_one_with_it_and_without_a_warning(tmp_path: Path) -> None:
    result = imported(tmp_path, a_car_and(crossing("p", 1.3), crossing("q", 1.2)))
    write_near_misses(result.table, tmp_path / "new.parquet", result.metadata)
    older = pq.read_table(tmp_path / "new.parquet").drop_columns(list(DERIVED))
    pq.write_table(older, tmp_path / "old.parquet")
    numbers = [pl.col(f"{who}_id").cast(pl.String).alias(f"{who}_name") for who in ("veh", "ped")]
    assert read_near_misses(tmp_path / "old.parquet").equals(result.table.with_columns(numbers))


@pytest.mark.parametrize("name", ["veh_length", "veh_width"])
def test_a_size_of_nothing_is_refused(name: str, tmp_path: Path) -> None:
    table = imported(tmp_path, a_car_and(crossing("p", 1.3))).table
    with pytest.raises(InvalidInput, match=f"column {name}, row 0 .*expected a size above 0, got 0.0"):
        check_near_misses(table.with_columns(pl.lit(0.0).alias(name)), "table")


def titles(monkeypatch: pytest.MonkeyPatch, folders: list[Path]) -> tuple[list[str], list[str]]:
    """Return what a check of folders says, and the titles of what it draws."""
    drawn: list[str] = []
    save = recordings.save_png
    monkeypatch.setattr(
        recordings,
        "save_png",
        lambda figure, path: (
            drawn.extend(axis.get_title() for axis in figure.axes if axis.has_data()),
            save(figure, path),
        ),
    )
    said = recordings.check_recordings(folders, ["described"], folders[0] / "check.png")
    assert (folders[0] / "check.png").stat().st_size > 10_000
    return said, drawn


def test_a_check_draws_near_misses_and_not_the_first_pairs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    far = [track(f"a{k}", "person", np.full(201, 60.0 + k), np.full(201, 9.0)) for k in range(8)]
    near = [crossing(f"p{k}", 1.0 + 0.05 * k) for k in range(9)]
    imported(tmp_path, a_car_and(*far, *near))
    said, drawn = titles(monkeypatch, [tmp_path])
    assert drawn == [f"a: near miss {k}, c and p{k}" for k in (0, 2, 3, 5, 6, 8)]  # spread over all nine
    assert "17 pairs, 9 near misses; 6 drawn" in said


def test_a_check_draws_every_folder_and_first_pairs_where_there_is_no_near_miss(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("one", "two", "three")]
    for folder, walker in zip(folders, (crossing("p", 1.3), crossing("q", 4.0), far_away("r")), strict=True):
        folder.mkdir()
        imported(folder, a_car_and(walker))
    said, drawn = titles(monkeypatch, folders)
    assert drawn == ["a: near miss 0, c and p", "a: near miss 0, c and q", "a: no near miss, c and r"]
    assert [line for line in said if line.startswith("two: 1 of 1 pedestrians (100.0%) are faster than 2.5 m/s")]
    assert "three: 1 pair, 0 near misses; the first 1 pair drawn" in said


def far_away(name: str) -> pl.DataFrame:
    return track(name, "person", np.full(201, 9.0), np.full(201, 200.0))
