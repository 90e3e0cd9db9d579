"""HC and TAF-BW recordings become near misses; what they leave out of a track is found or left out."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.data.importers import import_trajectories
from vpsci_ros.data.near_misses import check_near_misses
from vpsci_ros.extras.formats.hc import PIXELS


def write_hc(folder: Path, turn: float = 0.0) -> None:
    """Write a car at 5 m/s along x and a walker at 1.2 m/s who crosses 30 m ahead, at 2 Hz, in pixels with y down."""
    rows = []
    for k in range(14):
        t = 0.5 * k
        for number, kind, x, y in ((1, 2, 5.0 * t, 0.0), (2, 1, 30.0, 1.2 * (t - 6.0)), (3, 3, 0.0, 0.0)):
            east, north = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
            rows.append(f"{k + 100},{number},{PIXELS * east},{-PIXELS * north},{kind}")
    (folder / "D1.csv").write_text("\n".join(rows) + "\n")


def write_taf(folder: Path, *, flipped: bool = False) -> None:
    """Write the same scene at 10 Hz in the INTERACTION columns."""
    header = "track_id,frame_id,timestamp_ms,agent_type,vx,vy,psi_rad,length,width,x,y"
    rows = []
    for k in range(65):
        t = 0.1 * k
        x = 5.0 * t
        heading = np.pi if flipped and k >= 40 else 0.0
        rows.append(f"1,{k},{100 * k},Car,{-5.0 if heading else 5.0},0,{heading},4.6,2.1,{x},0")
        rows.append(f"2,{k},{100 * k},Pedestrian,0,1.2,0,0.5,0.5,30,{1.2 * (t - 6.0)}")
    order = sorted(rows, key=lambda row: int(row.partition(",")[0]))
    (folder / "vehicle_tracks_000.csv").write_text("\n".join([header, *order]) + "\n")


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_pixels_at_2_hz_become_metres_with_speed_and_heading(tmp_path: Path, turn: float) -> None:
    write_hc(tmp_path, turn)
    table = import_trajectories(tmp_path, "hc").table
    check_near_misses(table, "hc")
    assert table["veh_speed"].to_numpy() == pytest.approx(5.0, abs=1e-6)
    assert table["veh_heading"].to_numpy() == pytest.approx(turn, abs=1e-6)
    assert np.hypot(table["ped_vx"].to_numpy(), table["ped_vy"].to_numpy()) == pytest.approx(1.2, abs=1e-6)
    assert table["time"].diff().drop_nulls().to_numpy() == pytest.approx(0.1)


def test_the_same_scene_in_interaction_columns_has_the_curvttc_of_its_contact(tmp_path: Path) -> None:
    write_taf(tmp_path)
    table = import_trajectories(tmp_path, "taf-bw").table
    check_near_misses(table, "taf-bw")
    late = table.filter(table["curvttc"].is_between(0.1, 3.0))
    contact = late["veh_x"] + 5.0 * late["curvttc"]  # front, 2.3 m ahead, at the walker, 0.3 m wide
    assert contact.to_numpy() == pytest.approx(30.0 - 0.3 - 2.3, abs=0.05)


def test_a_track_is_cut_where_the_tracker_takes_front_for_rear(tmp_path: Path) -> None:
    write_taf(tmp_path, flipped=True)
    table = import_trajectories(tmp_path, "taf-bw").table
    check_near_misses(table, "taf-bw")  # no heading jumps within an interaction
    first = table.filter(table["interaction"] == 0)
    assert first["veh_heading"].to_numpy() == pytest.approx(0.0)
    assert first["time"].max() == pytest.approx(3.9)


@pytest.mark.parametrize(("form", "folder", "least"), [("hc", "hc", 100), ("taf-bw", "taf_bw/recorded_trackfiles", 5)])
def test_the_published_recordings_hold_near_misses(real_data: Path, form: str, folder: str, least: int) -> None:
    if not (real_data / folder).is_dir():
        pytest.skip(f"no {folder} in {real_data}")
    table = import_trajectories(real_data / folder, form).table
    check_near_misses(table, form)
    assert table["interaction"].n_unique() >= least
