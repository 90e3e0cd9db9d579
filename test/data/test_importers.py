"""Published recordings become near misses at 0.1 s, and a damaged file is named with its line."""

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal
from synthetic import SOURCE, synthetic_near_misses

from vpsci_ros.data.corpus import AFTER, BEFORE, around_critical, load_corpus
from vpsci_ros.data.courses import slope, trailing_slope
from vpsci_ros.data.importers import ImportResult, import_folders, import_trajectories, named
from vpsci_ros.data.importers.pairs import near_misses_of
from vpsci_ros.data.importers.summary import require_near_misses
from vpsci_ros.data.importers.tracks import BACKWARDS, resample
from vpsci_ros.data.near_misses import FLAG_RULES, check_near_misses, clean, clips_of, paths_apart, write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.vci import VCI_DUT
from vpsci_ros.policy.make_bank import bank_of_tables

RATE, CITR_RATE = 23.976, 29.97  # [1/s] frames of clips of VCI-DUT and VCI-CITR


def edit(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    """Rewrite a text file line by line."""
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


def write_clip(folder: Path, name: str, *, frames: int = 96, lateral: float = 0.0, rate: float = RATE) -> None:
    """Write one clip as published: a car along x at 5 m/s, a pedestrian who crosses 20 m ahead at 1.2 m/s.

    `lateral` moves the pedestrian along its line [m].
    """
    frame = np.arange(10, 10 + frames)
    t = (frame - 10) / rate
    car, walker = np.stack([5.0 * t, 0.0 * t]), np.stack([20.0 + 0.0 * t, 1.2 * (t - 4.0) + lateral])
    rows = [f"7,{k},veh,{x},{y},0.0,5.0" for k, x, y in zip(frame, *car, strict=True)]
    edited = ["id,frame,label,x_est,y_est,psi_est,vel_est", *rows]
    (folder / f"{name}_traj_veh_filtered.csv").write_text("\n".join(edited) + "\n")
    rows = [f"3,{k},ped,{x},{y},0.0,1.2" for k, x, y in zip(frame, *walker, strict=True)]
    edited = ["id,frame,label,x_est,y_est,vx_est,vy_est", *rows]
    (folder / f"{name}_traj_ped_filtered.csv").write_text("\n".join(edited) + "\n")


@pytest.fixture
def clip_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "clips"
    folder.mkdir()
    write_clip(folder, "meeting_01")
    return folder


def vehicle_file(folder: Path) -> Path:
    return folder / "meeting_01_traj_veh_filtered.csv"


def pedestrian_file(folder: Path, name: str = "meeting_01") -> Path:
    return folder / f"{name}_traj_ped_filtered.csv"


def replace(path: Path, line: int, column: int, value: str) -> None:
    """Put `value` into a cell; lines count from 1, the header."""

    def change(lines: list[str]) -> list[str]:
        cells = lines[line - 1].split(",")
        cells[column] = value
        return [*lines[: line - 1], ",".join(cells), *lines[line:]]

    edit(path, change)


def test_a_car_and_a_pedestrian_on_time_have_the_curvttc_of_the_first_contact(clip_folder: Path) -> None:
    table = import_trajectories(clip_folder, "vci-dut").table
    check_near_misses(table, "table")
    # The front, 2.25 m ahead of the centre at 5 m/s, reaches the walker's line x = 20 m; the walker, 0.3 m wide, is
    # inside the car's width by then: contact when 5 t + 2.25 = 20 - 0.3, t = 3.49 s after the start of the clip.
    assert table["curvttc"][0] == pytest.approx((20.0 - 0.3 - 2.25) / 5.0 - (table["time"][0] - 10 / RATE), abs=1e-3)
    assert table["veh_x"].to_numpy() == pytest.approx(5.0 * (table["time"].to_numpy() - 10 / RATE), abs=1e-9)
    assert table.select("source", "clip", "veh_id", "ped_id").row(0) == ("vci-dut", "meeting_01", 7, 3)


def test_the_whole_joint_track_is_kept(tmp_path: Path) -> None:
    write_clip(tmp_path, "meeting_01", frames=200)
    table = import_trajectories(tmp_path, "vci-dut").table
    assert table["time"].to_numpy()[[0, -1]] == pytest.approx([0.5, 8.7])  # frames 10 to 209, at 23.976 a second


def test_learning_takes_ten_steps_before_the_first_critical_one_to_ten_after_the_last(tmp_path: Path) -> None:
    write_clip(tmp_path, "meeting_01", frames=200)
    table = around_critical(import_trajectories(tmp_path, "vci-dut").table)
    critical = np.flatnonzero(table["curvttc"].to_numpy() < 5.0)
    assert critical[0] <= BEFORE
    assert table.height - 1 - critical[-1] == AFTER
    assert table["time"].diff().drop_nulls().to_numpy() == pytest.approx(0.1)


def test_a_pedestrian_far_from_the_path_is_no_near_miss(tmp_path: Path) -> None:
    write_clip(tmp_path, "far", lateral=-30.0)
    result = import_trajectories(tmp_path, "vci-dut")
    assert result.table.is_empty()
    assert (result.summaries[0].pairs, result.summaries[0].near_misses) == (1, 0)
    assert math.isnan(result.summaries[0].quartiles[1])


@pytest.mark.parametrize(("form", "rate", "length"), [("vci-dut", RATE, 4.5), ("vci-citr", CITR_RATE, 2.4)])
def test_each_format_has_its_own_vehicle_size(tmp_path: Path, form: str, rate: float, length: float) -> None:
    write_clip(tmp_path, "meeting_01", rate=rate, frames=int(4.0 * rate))
    table = import_trajectories(tmp_path, form).table.filter(pl.col("curvttc").is_between(0.1, 2.0))
    contact = table["veh_x"] + 5.0 * table["curvttc"]
    assert contact.to_numpy() == pytest.approx(20.0 - 0.3 - length / 2.0, abs=5e-3)


def test_an_import_without_a_near_miss_says_what_was_there_and_the_likely_cause(tmp_path: Path) -> None:
    write_clip(tmp_path, "far", lateral=-30.0)
    result = import_trajectories(tmp_path, "vci-dut")
    counts = "vci-dut: 1 clip, 1 track of vehicles, 1 of pedestrians, 1 pair at the same time, none below"
    with pytest.raises(InvalidInput, match=f"no near miss: {counts}.*left out: nothing; nobody meets .* check units"):
        require_near_misses(result)
    edit(pedestrian_file(tmp_path, "far"), lambda lines: [lines[0], *(_later(line) for line in lines[1:])])
    with pytest.raises(
        InvalidInput, match="0 pairs .*; no vehicle is there when a pedestrian is; check the times of both"
    ):
        require_near_misses(import_trajectories(tmp_path, "vci-dut"))


def _later(line: str) -> str:
    number, frame, rest = line.split(",", 2)
    return f"{number},{int(frame) + 10_000},{rest}"


def test_folders_of_one_format_with_clips_of_one_name_are_told_apart(tmp_path: Path) -> None:
    for place, lateral in (("a/EP", 0.0), ("b/EP", 0.2), ("c", 0.3)):
        (tmp_path / place).mkdir(parents=True)
        write_clip(tmp_path / place, "meeting_01", lateral=lateral)
    write_clip(tmp_path / "c", "meeting_02")
    folders = [tmp_path / name for name in ("a/EP", "b/EP", "c")]
    result = import_folders(folders, ["vci-dut"])
    assert clips_of(result.table) == [
        f"vci-dut/{name}" for name in ("a/EP/meeting_01", "b/EP/meeting_01", "c/meeting_01", "c/meeting_02")
    ]
    assert (result.summaries[0].clips, result.summaries[0].near_misses) == (4, 4)
    assert list(result.metadata["sources"]) == ["vci-dut"]
    for place, folder in zip(("a/EP", "b/EP"), folders[:2], strict=True):
        own = result.table.filter(pl.col("clip").str.starts_with(place)).drop("interaction", "group", "clip")
        assert_frame_equal(own, import_folders([folder], ["vci-dut"]).table.drop("interaction", "group", "clip"))
    (tmp_path / "citr").mkdir()
    write_clip(tmp_path / "citr", "meeting_01", rate=CITR_RATE)
    two = import_folders([folders[0], tmp_path / "citr"], ["vci-dut", "vci-citr"])  # of two formats: two sources
    assert clips_of(two.table) == ["vci-citr/meeting_01", "vci-dut/meeting_01"]


def test_a_recording_that_is_given_twice_is_refused(clip_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="this folder is given twice"):
        import_folders([clip_folder, clip_folder / ".." / clip_folder.name], ["vci-dut"])
    shutil.copytree(clip_folder, tmp_path / "copy")
    with pytest.raises(
        InvalidInput, match=r"copy: its clip meeting_01 is that of .* to the bit; give each recording onc"
    ):
        import_folders([clip_folder, tmp_path / "copy"], ["vci-dut"])


def test_two_clips_of_one_name_in_a_folder_are_refused(clip_folder: Path) -> None:
    clips = [*VCI_DUT.read(clip_folder)]
    with pytest.raises(InvalidInput, match="vci-dut: two recordings are called meeting_01; rename one"):
        near_misses_of("vci-dut", [*clips, *clips], length=4.5, width=1.8)


def test_tables_with_a_clip_of_one_name_are_refused(tmp_path: Path) -> None:
    for name, lateral in (("EP0", 0.0), ("EP1", 0.2)):
        (tmp_path / name).mkdir()
        write_clip(tmp_path / name, "meeting_01", lateral=lateral)
        write_near_misses(import_trajectories(tmp_path / name, "vci-dut").table, tmp_path / f"{name}.parquet")
    tables = [tmp_path / "EP0.parquet", tmp_path / "EP1.parquet"]
    for read in (load_corpus, bank_of_tables):
        with pytest.raises(
            InvalidInput, match="clip vci-dut/meeting_01 is there twice, in two tables .* by one command"
        ):
            read(tables)


def test_tracks_are_cut_at_long_gaps_and_bridged_over_short_ones() -> None:
    frames = np.array([0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 30, 31, 32, 33, 34, 35])
    table = pl.DataFrame({"id": np.zeros(len(frames), np.int64), "frame": frames, "x": frames / RATE})
    pieces = list(resample(table, RATE))
    assert [(piece.first, piece.last) for piece in pieces] == [(0, 5), (13, 14)]
    for piece in pieces:
        assert piece.values["x"] == pytest.approx(0.1 * np.arange(piece.first, piece.last + 1))


def test_headings_are_unwrapped_before_they_are_interpolated() -> None:
    turning = np.linspace(3.0, 3.4, 11)
    wrapped = np.angle(np.exp(1j * turning))
    table = pl.DataFrame({"id": np.zeros(11, np.int64), "frame": np.arange(11), "psi": wrapped})
    (piece,) = resample(table, 20.0, angle="psi")
    assert piece.values["psi"] == pytest.approx(np.linspace(3.0, 3.4, 6))


def test_near_misses_say_what_they_are_no_example_of() -> None:
    def flags(ttc: np.ndarray, speed: np.ndarray) -> dict[str, bool]:
        rows = pl.DataFrame({"interaction": 0, "curvttc": ttc, "veh_speed": speed}).with_columns(**FLAG_RULES)
        (found,) = rows.select(list(FLAG_RULES)).unique().iter_rows(named=True)  # one value an interaction
        return found

    ttc, moving = np.array([np.inf, 9.0, 7.0, 4.9, 3.0, 6.0]), np.full(6, 4.0)
    assert flags(ttc, moving) == {"standing": False, "begins_critical": False, "contact": False}
    stops_later, stands = np.array([4.0, 4.0, 4.0, 4.0, 0.0, 0.0]), np.array([4.0, 2.0, 1.0, 0.4, 0.4, 4.0])
    assert not flags(ttc, stops_later)["standing"]
    assert flags(ttc, stands)["standing"]
    assert flags(ttc[1:], moving[1:])["begins_critical"]  # two steps before the first critical one
    assert flags(np.append(ttc, 0.0), np.append(moving, 4.0))["contact"]


def test_flags_are_stored_and_clean_leaves_out_what_they_name(clip_folder: Path) -> None:
    table = import_trajectories(clip_folder, "vci-dut").table  # its pair is critical from the first step on
    assert table.select("standing", "begins_critical", "contact").unique().rows() == [(False, True, True)]
    assert clean(table).is_empty()
    assert clean(table.with_columns(begins_critical=pl.lit(False))).height == table.height
    assert clean(table.with_columns(begins_critical=pl.lit(False), apart=pl.lit(True))).is_empty()


def test_paths_that_never_come_within_5_m_are_apart_whenever_the_two_are_there() -> None:
    along, still = np.linspace(0.0, 40.0, 1100), np.zeros(1100)
    columns = {"veh_x": along, "veh_y": still, "ped_x": np.full(1100, 40.0), "ped_y": np.linspace(30.0, 4.9, 1100)}
    assert not paths_apart(columns)  # at the last step of both
    assert not paths_apart(columns | {"veh_x": along[::-1]})  # half a minute after the car was there
    assert paths_apart(columns | {"ped_y": columns["ped_y"] + 0.2})


def test_a_car_whose_circle_points_at_somebody_on_another_arm_is_apart_from_them(tmp_path: Path) -> None:
    write_clip(tmp_path, "meeting_01")
    write_clip(tmp_path, "other_arm", frames=60)  # 2.5 s: the car, at 12.5 m, turns off before the walker's line
    result = import_trajectories(tmp_path, "vci-dut")
    found = dict(result.table.group_by("clip").agg(pl.col("apart").first()).rows())
    assert found == {"meeting_01": False, "other_arm": True}
    assert check_near_misses(result.table.drop("apart"), "table").equals(result.table)


def test_the_causal_slope_of_a_line_is_its_slope_and_does_not_see_what_comes() -> None:
    line = 0.3 + 0.7 * 0.1 * np.arange(9)
    assert trailing_slope(line) == pytest.approx([0.0, *[0.7] * 8])
    bent = np.concatenate([line, line[-1] - 0.05 * np.arange(1, 5)])
    assert trailing_slope(bent)[:9] == pytest.approx(trailing_slope(line))


@pytest.mark.parametrize("length", [1, 2, 3, 4, 5, 9])
def test_the_slope_of_a_line_is_its_slope_at_every_length(length: int) -> None:
    line = 0.3 + 0.7 * 0.1 * np.arange(length)
    assert slope(line) == pytest.approx(np.full(length, 0.7 if length > 1 else 0.0))


def test_standing_cars_have_speed_zero_and_reversing_ones_are_left_out(clip_folder: Path) -> None:
    def reversing(lines: list[str]) -> list[str]:
        return [line if k < 80 else line.rsplit(",", 1)[0] + ",-1.0" for k, line in enumerate(lines)]

    replace(vehicle_file(clip_folder), 20, 6, "-0.004")
    edit(vehicle_file(clip_folder), reversing)
    result = import_trajectories(clip_folder, "vci-dut")
    assert result.summaries[0].left_out == {BACKWARDS: 17}
    assert result.table["veh_speed"].min() >= 0.0
    assert result.table["time"].max() <= (10 + 79) / RATE


def test_a_missing_folder_and_an_empty_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"absent: no such folder; expected one with NAME_traj_ped_filtered\.csv"):
        import_trajectories(tmp_path / "absent", "vci-dut")
    with pytest.raises(InvalidInput, match="no clip; expected files"):
        import_trajectories(tmp_path, "vci-dut")


def test_an_unknown_format_is_refused_with_the_known_ones(clip_folder: Path) -> None:
    with pytest.raises(InvalidInput, match="unknown format 'dut'; expected one of described, argoverse2, cqut-pvi"):
        import_trajectories(clip_folder, "dut")
    with pytest.raises(InvalidInput, match="got 1 folders, 2 formats"):
        import_folders([clip_folder], ["vci-dut", "vci-citr"])


def test_half_a_clip_is_left_out_and_half_of_every_clip_is_refused(clip_folder: Path) -> None:
    write_clip(clip_folder, "meeting_02")
    write_clip(clip_folder, "meeting_03")
    vehicle_file(clip_folder).unlink()
    (summary,) = import_trajectories(clip_folder, "vci-dut").summaries
    assert (summary.near_misses, summary.left_out) == (2, {"clips that cannot be read": 1})
    for name in ("meeting_02", "meeting_03"):
        (clip_folder / f"{name}_traj_veh_filtered.csv").unlink()
    with pytest.raises(InvalidInput, match=r"meeting_01_traj_ped_filtered\.csv is there without .*veh_filtered\.csv"):
        import_trajectories(clip_folder, "vci-dut")


def test_recordings_of_pedestrians_alone_say_so_in_their_names(clip_folder: Path) -> None:
    alone = clip_folder / "bidirection_no_vehicle_5v5_01_traj_ped_filtered.csv"
    alone.write_text(pedestrian_file(clip_folder).read_text())
    assert import_trajectories(clip_folder, "vci-dut").summaries[0].clips == 1


@pytest.mark.parametrize(
    ("value", "column", "message"),
    [
        ("", 5, "line 12, column vx_est: expected a finite number, got None"),
        ("fast", 6, "line 12, column vy_est: expected a finite number, got 'fast'"),
        ("11", 1, "line 3: this frame of this road user comes twice"),
    ],
)
def test_a_bad_cell_is_named_with_line_and_column(clip_folder: Path, value: str, column: int, message: str) -> None:
    replace(pedestrian_file(clip_folder), 12, column, value)
    with pytest.raises(InvalidInput, match=rf"ped_filtered\.csv: {message}"):
        import_trajectories(clip_folder, "vci-dut")


def test_a_file_without_a_row_is_refused(clip_folder: Path) -> None:
    edit(pedestrian_file(clip_folder), lambda lines: lines[:1])
    with pytest.raises(InvalidInput, match=r"ped_filtered\.csv: expected one row a frame and road user, got none"):
        import_trajectories(clip_folder, "vci-dut")


def test_real_recordings_hold_about_340_near_misses(real_data: Path) -> None:
    result = import_folders([real_data / "vci_dut", real_data / "vci_citr"], ["vci-dut", "vci-citr"])
    check_near_misses(result.table, "table")
    assert 320 <= result.table["interaction"].n_unique() <= 370
    assert result.summaries[0].quartiles == pytest.approx((1.8, 2.95, 3.9), abs=0.15)


def test_a_source_may_be_named_and_the_table_keeps_the_sizes_of_its_vehicles(tmp_path: Path) -> None:
    made = synthetic_near_misses(interactions=4, seed=3)
    found = named(made, "my_corner")
    assert found.table["source"].unique().to_list() == ["my_corner"]
    assert found.metadata["sources"]["my_corner"]["vehicle_length"] == made.summaries[0].vehicle_length
    assert found.table.drop("source").equals(made.table.drop("source"))
    with pytest.raises(InvalidInput, match="expected letters, digits, _ and -"):
        named(made, "my/corner")
    with pytest.raises(InvalidInput, match=f"expected one source, got {SOURCE}, {SOURCE}; import them one by one"):
        named(ImportResult(made.table, (made.summaries[0],) * 2), "both")
