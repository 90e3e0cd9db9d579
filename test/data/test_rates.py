"""Recordings of other rates: rows as far apart as 0.5 s are bridged, gaps are counted, fewer rows are refused."""

import io
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rich.console import Console

from vpsci_ros.data.importers import ImportResult, import_trajectories, print_import_summary
from vpsci_ros.data.importers.pairs import BRIEF, LEAST_STEPS
from vpsci_ros.data.importers.tracks import GAPS
from vpsci_ros.data.near_misses import check_near_misses
from vpsci_ros.errors import InvalidInput

CAR, WALK = 6.0, 1.3  # [m/s] straight on, the walker across the car's path
LAYOUT = "columns: {%s}\nvehicles: [car]\npedestrians: [person]\n"


def recorded(folder: Path, times: np.ndarray, *, pairs: int = 1, velocities: bool = False) -> ImportResult:
    """Import a car and a walker, or several such pairs 100 m apart, with a row at each of `times` [s]."""
    rows = []
    for pair in range(pairs):
        y = 100.0 * pair
        rows += [(f"c{pair}", t, "car", CAR * t - 30.0, y, CAR, 0.0) for t in times]
        rows += [(f"p{pair}", t, "person", 0.2, y + WALK * t - 7.0, 0.0, WALK) for t in times]
    pl.DataFrame(rows, ["id", "time", "class", "x", "y", "vx", "vy"], orient="row").write_csv(folder / "a.csv")
    names = ["id", "time", "class", "x", "y"] + ["vx", "vy"] * velocities
    (folder / "layout.yaml").write_text(LAYOUT % ", ".join(f"{name}: {name}" for name in names))
    return import_trajectories(folder, "described")


@pytest.mark.parametrize("velocities", [False, True])
@pytest.mark.parametrize("apart", [0.2, 0.4, 0.5])
def test_rows_of_a_low_rate_are_the_motion_of_a_high_one(apart: float, velocities: bool, tmp_path: Path) -> None:
    dense = recorded(tmp_path, np.arange(0.0, 8.01, 0.04), pairs=4, velocities=velocities)
    sparse = recorded(tmp_path, np.arange(0.0, 8.01, apart), pairs=4, velocities=velocities)
    check_near_misses(sparse.table, "table")
    assert [(each.summaries[0].pairs, each.summaries[0].near_misses) for each in (dense, sparse)] == [(16, 4)] * 2
    assert sparse.table.height == dense.table.height == 4 * 81
    assert sparse.table["veh_speed"].to_numpy() == pytest.approx(CAR)
    assert sparse.table["ped_vy"].to_numpy() == pytest.approx(WALK)
    for name in ("step", "time", "veh_x", "ped_y", "curvttc"):
        assert sparse.table[name].to_numpy() == pytest.approx(dense.table[name].to_numpy(), abs=1e-6), name
    named = [text for text in sparse.summaries[0].assumed if text.startswith(f"rows are {apart:g} s apart")]
    assert len(named) == (apart > 0.17)
    assert not any(text.startswith("rows are") for text in dense.summaries[0].assumed)


def test_times_that_differ_a_little_from_2_hz_are_bridged(tmp_path: Path) -> None:
    times = 0.5 * np.arange(17) + np.random.default_rng(1).uniform(-0.02, 0.02, 17)
    assert recorded(tmp_path, times).summaries[0].pairs == 1


@pytest.mark.parametrize("apart", [0.6, 1.0])
def test_rows_further_apart_are_refused_in_words(apart: float, tmp_path: Path) -> None:
    said = rf"a.csv: rows of a road user are {apart:g} s apart \(median\); expected at most 0.5 s"
    with pytest.raises(InvalidInput, match=said):
        recorded(tmp_path, np.arange(0.0, 8.01, apart))


@pytest.mark.parametrize(("apart", "gap"), [(0.04, 0.32), (0.1, 0.3), (0.4, 0.8)])
def test_gaps_are_counted_where_tracks_are_cut(apart: float, gap: float, tmp_path: Path) -> None:
    times = np.arange(0.0, 8.01, apart)
    result = recorded(tmp_path, times[(times < 2.0) | (times > 2.0 - apart + gap - 1e-6)])
    assert result.summaries[0].left_out == {GAPS: 2}  # of the car and of the walker
    assert result.summaries[0].pairs == 2
    said = io.StringIO()
    print_import_summary(result, Console(file=said, width=120))
    assert "described: left out: gaps between rows, at which tracks are cut: 2" in said.getvalue()


def test_no_near_miss_is_shorter_than_a_slope(tmp_path: Path) -> None:
    times = np.arange(0.0, 8.01, 0.1)
    begins = times[(times < 2.85) | ((times > 3.15) & (times < 3.55)) | (times > 3.85)]  # 4 steps between two gaps
    result = recorded(tmp_path, begins, velocities=True)
    assert result.table.group_by("interaction").len()["len"].min() >= LEAST_STEPS == 5
    assert result.summaries[0].left_out == {GAPS: 4, BRIEF: 1}


def test_a_column_of_timestamps_is_told_as_such(tmp_path: Path) -> None:
    rows = pl.DataFrame({"id": [1, 1], "time": [0, 100_000], "class": "car", "x": [0.0, 1.0], "y": 0.0})
    rows.with_columns(pl.col("time").cast(pl.Datetime("us"))).write_parquet(tmp_path / "a.parquet")
    names = ", ".join(f"{name}: {name}" for name in rows.columns)
    (tmp_path / "layout.yaml").write_text('files: "*.parquet"\n' + LAYOUT % names)
    with pytest.raises(
        InvalidInput, match=r"column time holds timestamps \(Datetime.*expected numbers: write it as secon"
    ):
        import_trajectories(tmp_path, "described")
