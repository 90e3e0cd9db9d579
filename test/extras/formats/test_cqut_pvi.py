"""CQUT-PVI's right turns: what the recording does not say is found from the motion, what cannot be used is counted."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.importers import ImportResult, import_trajectories
from vpsci_ros.data.near_misses import check_near_misses, clean
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.cqut_pvi import CHORD, smoothed, way_heading

RADIUS, SPEED, WALK = 8.0, 4.0, 1.2  # [m], [m/s]: a car on a circle, a pedestrian who walks into its way
SECONDS, MEET = 5.0, 4.0  # [s]
Rows = list[list[str]]


def event(number: int, step: float = 0.2, shift: float = 0.0) -> Rows:
    """Return the rows of an event: a right turn about (`shift`, 0), and a walker who reaches the circle after 4 s."""
    t = np.arange(round(SECONDS / step) + 1) * step
    angle = -SPEED * t / RADIUS  # clockwise, from (shift, RADIUS)
    car = np.stack([shift - RADIUS * np.sin(angle), RADIUS * np.cos(angle)], axis=1)
    out = np.array([np.sin(SPEED * MEET / RADIUS), np.cos(SPEED * MEET / RADIUS)])
    person = np.array([shift, 0.0]) + out * (RADIUS + WALK * (MEET - t))[:, None]
    rows = []
    for k in range(len(t)):
        mine = [*person[k], WALK, 0.0, 0.0, *car[k], SPEED, 0.0, 0.0, np.hypot(*(person[k] - car[k]))]
        rows.append([str(number), *(f"{value:.3f}" for value in mine), "#DIV/0!"])
    return rows


def write(folder: Path, files: dict[str, list[Rows]], clips: dict[tuple[str, int], tuple[str, str]]) -> None:
    for name, events in files.items():
        lines = ["\t".join(row) for rows in events for row in rows]
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    index = [f"{file},{number},{clip},{part}" for (file, number), (clip, part) in clips.items()]
    (folder / "clips.csv").write_text("\n".join(["file,event,clip,part", *index]) + "\n")


def imported(folder: Path, rows: Rows, file: str = "NCP2") -> ImportResult:
    """Import one event."""
    write(folder, {file: [rows]}, {(file, 1): ("g1", "train")})
    return import_trajectories(folder, "cqut-pvi")


@pytest.mark.parametrize("step", [0.2, 1.0 / 30.0])
def test_a_right_turn_comes_out_at_0_1_s_with_its_speed_and_heading_whatever_its_time_step(
    tmp_path: Path, step: float
) -> None:
    table = imported(tmp_path, event(1, step)).table
    check_near_misses(table, "cqut-pvi")
    assert table.height == round(SECONDS / 0.1) + 1
    assert table["veh_speed"].to_numpy() == pytest.approx(SPEED, rel=0.02)
    inside = table.filter(pl.col("time").is_between(0.3, SECONDS - 0.3))  # the chord of 1.5 m fits
    along = -SPEED * inside["time"].to_numpy() / RADIUS
    assert inside["veh_heading"].to_numpy() == pytest.approx(along, abs=0.01)
    assert np.hypot(table["ped_vx"].to_numpy(), table["ped_vy"].to_numpy()) == pytest.approx(WALK, rel=0.01)
    assert table["contact"].all()  # both are where the ways cross after 4 s


def test_clips_are_named_by_part_and_corner_and_their_events_do_not_overlap(tmp_path: Path) -> None:
    files = {"CP1_v2": [event(7)], "CP2": [event(1), event(2, shift=40.0)]}
    clips = {("CP1_v2", 7): ("g3", "train"), ("CP2", 1): ("g2", "dev"), ("CP2", 2): ("g2", "dev")}
    write(tmp_path, files, clips)
    result = import_trajectories(tmp_path, "cqut-pvi")
    begin = result.table.filter(pl.col("step") == 0)
    assert begin.select("clip", "veh_id").rows() == [
        ("train/corner1/g3", 0),
        ("dev/corner2/g2", 1),
        ("dev/corner2/g2", 2),
    ]
    assert begin["time"].to_list() == pytest.approx([0.0, 0.0, SECONDS + 1.1])
    assert result.summaries[0].pairs == 3


def shaken(rows: Rows, column: int, size: float) -> Rows:
    """Return the rows with every second value of a column moved by `size` [m]."""
    return [
        row if k % 2 else [*row[:column], f"{float(row[column]) + size:.3f}", *row[column + 1 :]]
        for k, row in enumerate(rows)
    ]


def without_positions(rows: Rows, count: int) -> Rows:
    return [[*row[:6], "", *row[7:]] if 10 <= k < 10 + count else row for k, row in enumerate(rows)]


def faster(rows: Rows) -> Rows:
    """Return the rows with speeds as if there were 0.1 s between them."""
    return [[*row[:3], f"{2 * WALK}", *row[4:8], f"{2 * SPEED}", *row[9:]] for row in rows]


def braking(rows: Rows) -> Rows:
    """Return the rows of a car that brakes by 6 m/s2 along x from 12 m/s."""
    t = np.minimum(0.2 * np.arange(len(rows)), 2.0)
    way, speed = 12.0 * t - 3.0 * t**2, 12.0 - 6.0 * t
    moved = [[*row[:6], f"{way[k]:.3f}", "0", f"{speed[k]:.3f}", *row[9:]] for k, row in enumerate(rows)]
    return with_distances(moved)


def standing(rows: Rows) -> Rows:
    return with_distances([[*row[:6], "3.0", "7.0", "0.0", *row[9:]] for row in rows])


def with_distances(rows: Rows) -> Rows:
    apart = [np.hypot(float(row[1]) - float(row[6]), float(row[2]) - float(row[7])) for row in rows]
    return [[*row[:11], f"{distance:.3f}", *row[12:]] for row, distance in zip(rows, apart, strict=True)]


def test_distances_that_are_not_those_of_the_positions_are_refused(tmp_path: Path) -> None:
    in_feet = [[*row[:11], f"{float(row[11]) / 0.3048:.3f}", *row[12:]] for row in event(1)]
    with pytest.raises(InvalidInput, match=r"NCP2.txt: distances differ from those of the positions by .*they say"):
        imported(tmp_path, in_feet)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda rows: shaken(rows, 6, 0.4), "vehicle whose positions are more than 6 cm off"),
        (lambda rows: shaken(rows, 1, 0.3), "pedestrian whose positions are more than 5 cm off"),
        (lambda rows: without_positions(rows, 3), "more than 2 rows in succession without a position"),
        (lambda rows: rows[:4], "fewer than 5 rows"),
        (faster, "no time step in common"),
        (braking, "vehicle that accelerates by more than 4.5 m/s2"),
        (standing, "vehicle that moves less than 0.75 m"),
    ],
)
def test_an_event_that_is_no_plausible_motion_is_left_out_and_counted(
    tmp_path: Path, change: Callable[[Rows], Rows], reason: str
) -> None:
    result = imported(tmp_path, change(event(1)))
    assert result.table.is_empty()
    (summary,) = result.summaries
    ((text, count),) = summary.left_out.items()
    assert reason in text
    assert (summary.pairs, count) == (0, 1)


def test_two_rows_without_a_position_are_bridged(tmp_path: Path) -> None:
    whole = imported(tmp_path, event(1)).table
    bridged = imported(tmp_path, without_positions(event(1), 2)).table
    assert bridged["veh_x"].to_numpy() == pytest.approx(whole["veh_x"].to_numpy(), abs=0.02)


def test_an_event_filed_twice_counts_once_and_one_that_shares_its_car_counts(tmp_path: Path) -> None:
    other = [[*row[:1], *(f"{float(value) + 0.5:.3f}" for value in row[1:3]), *row[3:]] for row in event(3)]
    clips = dict.fromkeys((("CP2", 1), ("NCP2", 2), ("NCP2", 3)), ("g1", "train"))
    write(tmp_path, {"CP2": [event(1)], "NCP2": [event(2), other]}, clips)
    result = import_trajectories(tmp_path, "cqut-pvi")
    assert result.summaries[0].pairs == 2
    assert result.summaries[0].left_out == {"events filed twice": 1}


def test_the_first_row_of_an_event_is_dropped_where_it_is_spurious(tmp_path: Path) -> None:
    assert imported(tmp_path, event(1), "NCP1_v2").table.height == imported(tmp_path, event(1), "NCP1").table.height - 2


def test_smoothing_keeps_what_is_slower_than_its_cutoff_and_takes_the_rest_for_noise() -> None:
    t = 0.2 * np.arange(101)
    for frequency, kept in ((0.2, 0.999), (0.8, 0.5), (2.0, 0.005)):
        wave = np.sin(2.0 * np.pi * frequency * t)
        way, residual = smoothed(np.stack([wave, np.zeros(101)], axis=1), 0.2)
        gain = way[60:141:2, 0] @ wave[30:71] / (wave[30:71] @ wave[30:71])
        assert gain == pytest.approx(kept, abs=0.02)  # 1 / (1 + (f / 0.8 Hz)^6)
        assert residual == pytest.approx(0.5 * (1.0 - kept), abs=0.02)  # of both axes, one of which has a wave


def test_a_vehicle_that_stands_keeps_its_heading() -> None:
    way = np.concatenate([np.arange(20) * 0.3, np.full(30, 5.7), 5.7 + 0.3 * np.arange(20)])
    noise = np.where(np.arange(70) % 2, 0.002, 0.0)
    heading = way_heading(way, noise)
    assert heading == pytest.approx(0.0, abs=0.01)
    assert way[-1] > CHORD


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("clips.csv", None, r"clips\.csv: no such file"),
        ("clips.csv", "file,event,clip,part\nNCP2,1,g1,test\n", "expected train or dev, got 'test'"),
        (
            "clips.csv",
            "file,event,clip,part\nNCP2,1,g1,dev\nNCP2,2,g1,dev\n",
            "event 2 of NCP2.*has and NCP2.txt has not",
        ),
        ("NCP2.txt", "1\t2.0\n", r"NCP2\.txt: line 1: expected event, pedestrian_x"),
        ("NCP2.txt", None, r"NCP2\.txt: not readable as text"),
    ],
)
def test_a_damaged_folder_is_refused_with_what_is_wrong(
    tmp_path: Path, name: str, text: str | None, message: str
) -> None:
    write(tmp_path, {"NCP2": [event(1)]}, {("NCP2", 1): ("g1", "train")})
    (tmp_path / name).unlink() if text is None else (tmp_path / name).write_text(text)
    with pytest.raises(InvalidInput, match=message):
        import_trajectories(tmp_path, "cqut-pvi")


def test_the_published_right_turns_hold_740_near_misses(real_data: Path) -> None:
    if not (real_data / "cqut_pvi").is_dir():
        pytest.skip(f"no cqut_pvi in {real_data}")
    result = import_trajectories(real_data / "cqut_pvi", "cqut-pvi")
    assert result.summaries[0].near_misses == 747
    assert result.summaries[0].quartiles == pytest.approx((1.82, 2.54, 3.38), abs=0.005)
    assert clean(result.table)["interaction"].n_unique() == 337
    assert sum(result.summaries[0].left_out.values()) + result.summaries[0].pairs == 1936
