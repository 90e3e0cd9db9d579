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

from vpsci_ros.data.importers.importer import Clip, Importer
from vpsci_ros.data.importers.tracks import Floats, Track, read_tracks_csv, resample
from vpsci_ros.errors import InvalidInput

_VEHICLE_END = "_traj_veh_filtered.csv"
_PEDESTRIAN_END = "_traj_ped_filtered.csv"
_NO_VEHICLE = "_no_vehicle_"
_VEHICLE = ("x_est", "y_est", "psi_est", "vel_est")
_PEDESTRIAN = ("x_est", "y_est", "vx_est", "vy_est")
REVERSING = -0.1  # [m/s] slower than this is driving backwards, not the noise of a standing car
_MOVING = 1.0  # [m/s] above it the direction of motion says what the heading must be
_WALKING = 0.5  # [m/s] above it pedestrians' speeds tell the frame rate
_RATE_TOLERANCE = 0.1  # by which it may differ; published clips do by 0.03 at most, and the two data sets by 0.25
_ASKEW = 0.5  # [rad] by which headings may differ from it, by noise and side slip (median)


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
    vehicles = read_tracks_csv(vehicle_file, _VEHICLE)
    pedestrians = read_tracks_csv(pedestrian_file, _PEDESTRIAN)
    _check_frame_rate(pedestrians, frame_rate, pedestrian_file)
    _check_heading(vehicles, frame_rate, vehicle_file)
    forward = vehicles.filter(pl.col("vel_est") >= REVERSING)
    return Clip(
        name,
        [
            Track(track.number, track.first, _vehicle_values(track))
            for track in resample(forward, frame_rate, angle="psi_est")
        ],
        [
            Track(track.number, track.first, {k.removesuffix("_est"): v for k, v in track.values.items()})
            for track in resample(pedestrians, frame_rate)
        ],
        vehicles.height - forward.height,
    )


def _vehicle_values(track: Track) -> dict[str, Floats]:
    own = track.values
    return {
        "x": own["x_est"],
        "y": own["y_est"],
        "heading": own["psi_est"],
        "speed": np.maximum(own["vel_est"], 0.0),
    }


def _check_frame_rate(pedestrians: pl.DataFrame, frame_rate: float, path: Path) -> None:
    """Refuse a frame rate by which pedestrians come further, or less far, than their speeds say: the other format's."""
    step = {name: pl.col(name).shift(-1).over("id") - pl.col(name) for name in ("x_est", "y_est", "frame")}
    moving = pedestrians.select(
        ((step["x_est"] ** 2 + step["y_est"] ** 2).sqrt() / step["frame"]).alias("came"),
        (pl.col("vx_est") ** 2 + pl.col("vy_est") ** 2).sqrt().alias("speed"),
    ).filter(pl.col("came").is_not_null() & (pl.col("speed") > _WALKING))
    if moving.is_empty():
        return
    rate = 1.0 / float(np.median(moving["came"] / moving["speed"]))
    if abs(rate / frame_rate - 1.0) > _RATE_TOLERANCE:
        fits = next((name for name, own in FRAME_RATES.items() if abs(rate / own - 1.0) < _RATE_TOLERANCE), "")
        hint = f"this looks like {fits}: give --format {fits} for this folder" if fits else "convert the speeds"
        raise InvalidInput(
            f"{path}: pedestrians' speeds and positions belong to {rate:.1f} frames a second (median), "
            f"expected {frame_rate:g}; {hint}"
        )


def _check_heading(vehicles: pl.DataFrame, frame_rate: float, path: Path) -> None:
    """Refuse headings that are not radians counter-clockwise from x, by comparing them with the motion."""
    following = vehicles.select(
        (pl.col("x_est").shift(-1).over("id") - pl.col("x_est")).alias("dx"),
        (pl.col("y_est").shift(-1).over("id") - pl.col("y_est")).alias("dy"),
        "psi_est",
    ).filter((pl.col("dx") ** 2 + pl.col("dy") ** 2).sqrt() * frame_rate > _MOVING, vehicles["vel_est"] > _MOVING)
    if following.is_empty():
        return
    direction, heading = np.arctan2(*following.select("dy", "dx").to_numpy().T), following["psi_est"].to_numpy()
    apart, as_degrees = _median_angle(direction - heading), _median_angle(direction - np.radians(heading))
    degrees = np.abs(heading).max() > 2.0 * np.pi and as_degrees < apart
    if apart > _ASKEW or degrees:
        guess = "they look like degrees" if degrees else "they may be measured from another axis, or with y down"
        raise InvalidInput(
            f"{path}: column psi_est: headings differ from the direction of motion by {apart:.2f} rad (median), the "
            f"largest is {np.abs(heading).max():.4g}; expected radians counter-clockwise from x; {guess}: convert them"
        )


def _median_angle(difference: Floats) -> float:
    return float(np.median(np.abs(np.angle(np.exp(1j * difference)))))
