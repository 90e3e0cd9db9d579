"""An import says what its recordings hold: who is too fast to walk, whose tracks jump, and who never comes near."""

import io
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rich.console import Console
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.importers import ImportResult, import_trajectories, print_import_summary
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput

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
    return import_trajectories(folder, "described", fastest)


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


@pytest.mark.parametrize("way", ["layout", "option"])
def test_pedestrians_faster_than_allowed_are_left_out_and_counted(way: str, tmp_path: Path) -> None:
    tracks = a_car_and(crossing("p", 1.3), crossing("q", 4.0))
    given = {"layout": "fastest: 2.5\n"} if way == "layout" else {"fastest": 2.5}
    result = imported(tmp_path, tracks, **given)
    assert (result.summaries[0].near_misses, result.summaries[0].pedestrians, result.summaries[0].fast) == (1, 1, 0)
    assert result.summaries[0].left_out == {"pedestrians faster than 2.5 m/s": 1}
    assert result.table["ped_vy"].to_numpy() == pytest.approx(1.3)
    with pytest.raises(InvalidInput, match="fastest: expected a number above 0, got -1"):
        imported(tmp_path, tracks, layout="fastest: -1\n")


def test_the_command_leaves_out_who_is_faster_than_it_is_told(tmp_path: Path) -> None:
    imported(tmp_path, a_car_and(crossing("p", 1.3), crossing("q", 4.0)))
    command = ["import", str(tmp_path), "--format", "described", "--fastest", "2.5", "-o", str(tmp_path / "o.parquet")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "left out 1 pedestrians faster than 2.5 m/s" in done.output
    assert read_near_misses(tmp_path / "o.parquet")["interaction"].n_unique() == 1


def test_a_track_is_cut_where_it_jumps_as_nobody_runs_and_the_jump_is_counted(tmp_path: Path) -> None:
    walker = crossing("p", 1.3)
    jump = 24.0 * 0.04  # [m] from one row to the next
    moved = walker.with_columns(y=pl.when(pl.col("time") > 4.0).then(pl.col("y") + jump).otherwise(pl.col("y")))
    result = imported(tmp_path, a_car_and(moved))
    count = {"speeds of pedestrians above 12 m/s (jumps), at which tracks are cut": 1}
    assert result.summaries[0].left_out == count
    assert result.summaries[0].pedestrians == 2
    assert result.table["ped_vy"].to_numpy() == pytest.approx(1.3)  # no slope over the jump
    assert "left out 1 speeds of pedestrians above 12 m/s (jumps), at which tracks are cut" in said(result)
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
