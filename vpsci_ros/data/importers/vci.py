"""VCI-DUT and VCI-CITR: drone recordings of pedestrians among cars on a campus, and around a golf cart.

Source: Yang, Li, Redmill and Ozguner, "Top-view Trajectories: A Pedestrian Dataset of Vehicle-Crowd Interaction from
Controlled Experiments and Crowded Campus", IEEE IV 2019, arXiv 1902.00487. A clip is a pair of files,
NAME_traj_ped_filtered.csv (id, frame, label, x_est, y_est, vx_est, vy_est) and NAME_traj_veh_filtered.csv (id, frame,
label, x_est, y_est, psi_est [rad], vel_est [m/s]), Kalman-filtered, in metres.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.importer import BACKWARDS, Clip, Importer
from vpsci_ros.data.importers.layout import ASKEW, MOVING, RATE_TOLERANCE, REVERSING, WALKING, median_angle, steps
from vpsci_ros.data.importers.tracks import read_tracks_csv, resample
from vpsci_ros.errors import InvalidInput

_VEHICLE_END = "_traj_veh_filtered.csv"
_PEDESTRIAN_END = "_traj_ped_filtered.csv"
_NO_VEHICLE = "_no_vehicle_"
_VEHICLE = {"x_est": "x", "y_est": "y", "psi_est": "heading", "vel_est": "speed"}
_PEDESTRIAN = {"x_est": "x", "y_est": "y", "vx_est": "vx", "vy_est": "vy"}

FRAME_RATES = {"vci-dut": 23.976, "vci-citr": 29.97}  # [1/s]


def read_folder(folder: Path, form: str) -> Iterator[Clip]:
    """Yield every clip of a folder as published, sorted by name.

    :param form: a key of `FRAME_RATES`.
    :raises InvalidInput: see `find_clips` and `read_clip`.
    """
    return (read_clip(*files, FRAME_RATES[form]) for files in find_clips(folder))


VCI_DUT = Importer(partial(read_folder, form="vci-dut"), length=4.5, width=1.8)
VCI_CITR = Importer(partial(read_folder, form="vci-citr"), length=2.4, width=1.2)


def find_clips(folder: str | Path) -> list[tuple[str, Path, Path]]:
    """Return (clip, pedestrian file, vehicle file) of a folder, sorted by name.

    VCI-CITR also has recordings of pedestrians alone, "no_vehicle" in their names; they hold no pair and are left out.

    :raises InvalidInput: no such folder, no clip in it, or one file of a pair without the other.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InvalidInput(
            f"{folder}: no such folder; expected one with NAME{_PEDESTRIAN_END} and NAME{_VEHICLE_END}, as published"
        )
    pedestrians = {path.name.removesuffix(_PEDESTRIAN_END): path for path in folder.glob(f"*{_PEDESTRIAN_END}")}
    vehicles = {path.name.removesuffix(_VEHICLE_END): path for path in folder.glob(f"*{_VEHICLE_END}")}
    pedestrians = {name: path for name, path in pedestrians.items() if _NO_VEHICLE not in name}
    if not pedestrians and not vehicles:
        raise InvalidInput(f"{folder}: no clip; expected files NAME{_PEDESTRIAN_END} and NAME{_VEHICLE_END}")
    for name in sorted(pedestrians.keys() ^ vehicles.keys()):
        there, end = (pedestrians[name], _VEHICLE_END) if name in pedestrians else (vehicles[name], _PEDESTRIAN_END)
        raise InvalidInput(f"{folder}: {there.name} is there without {name}{end}; add that file or remove this one")
    return [(name, pedestrians[name], vehicles[name]) for name in sorted(vehicles)]


def read_clip(name: str, pedestrian_file: Path, vehicle_file: Path, frame_rate: float) -> Clip:
    """Read one clip and resample its tracks to 0.1 s; see `tracks.resample` for gaps.

    Speeds that the filter puts just below zero on standing vehicles become zero.

    :raises InvalidInput: a file that does not hold what it should, or headings or a frame rate that contradict the
        motion.
    """
    vehicles = read_tracks_csv(vehicle_file, tuple(_VEHICLE)).rename(_VEHICLE)
    pedestrians = read_tracks_csv(pedestrian_file, tuple(_PEDESTRIAN)).rename(_PEDESTRIAN)
    _check_frame_rate(pedestrians, frame_rate, pedestrian_file)
    _check_heading(vehicles, frame_rate, vehicle_file)
    forward = vehicles.filter(pl.col("speed") >= REVERSING)
    cars = list(resample(forward, frame_rate, angle="heading"))
    for track in cars:
        track.values["speed"] = np.maximum(track.values["speed"], 0.0)
    return Clip(name, cars, list(resample(pedestrians, frame_rate)), {BACKWARDS: vehicles.height - forward.height})


def _check_frame_rate(pedestrians: pl.DataFrame, frame_rate: float, path: Path) -> None:
    """Refuse a frame rate by which pedestrians come further, or less far, than their speeds say: the other format's."""
    speed = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt()
    moving = steps(pedestrians, 1.0).with_columns(speed=speed).filter(pl.col("speed") > WALKING)
    if moving.is_empty():
        return
    came = (moving["dx"] ** 2 + moving["dy"] ** 2).sqrt() / moving["seconds"]  # [m] a frame
    rate = 1.0 / float(np.median(came / moving["speed"]))
    if abs(rate / frame_rate - 1.0) > RATE_TOLERANCE:
        fits = next((name for name, own in FRAME_RATES.items() if abs(rate / own - 1.0) < RATE_TOLERANCE), "")
        hint = f"this looks like {fits}: give --format {fits} for this folder" if fits else "convert the speeds"
        raise InvalidInput(
            f"{path}: pedestrians' speeds and positions belong to {rate:.1f} frames a second (median), "
            f"expected {frame_rate:g}; {hint}"
        )


def _check_heading(vehicles: pl.DataFrame, frame_rate: float, path: Path) -> None:
    """Refuse headings that are not radians counter-clockwise from x, by comparing them with the motion."""
    way = (pl.col("dx") ** 2 + pl.col("dy") ** 2).sqrt()
    following = steps(vehicles, frame_rate).filter(way * frame_rate > MOVING, pl.col("speed") > MOVING)
    if following.is_empty():
        return
    direction, heading = np.arctan2(*following.select("dy", "dx").to_numpy().T), following["heading"].to_numpy()
    apart, as_degrees = median_angle(direction - heading), median_angle(direction - np.radians(heading))
    degrees = np.abs(heading).max() > 2.0 * np.pi and as_degrees < apart
    if apart > ASKEW or degrees:
        guess = "they look like degrees" if degrees else "they may be measured from another axis, or with y down"
        raise InvalidInput(
            f"{path}: column psi_est: headings differ from the direction of motion by {apart:.2f} rad (median), the "
            f"largest is {np.abs(heading).max():.4g}; expected radians counter-clockwise from x; {guess}: convert them"
        )
