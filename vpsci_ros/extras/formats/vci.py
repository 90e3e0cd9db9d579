"""VCI-DUT and VCI-CITR: drone recordings of pedestrians among cars on a campus, and around a golf cart.

Source: Yang, Li, Redmill and Ozguner, "Top-view Trajectories: A Pedestrian Dataset of Vehicle-Crowd Interaction from
Controlled Experiments and Crowded Campus", IEEE IV 2019, arXiv 1902.00487. A clip is a pair of files,
NAME_traj_ped_filtered.csv (id, frame, label, x_est, y_est, vx_est, vy_est) and NAME_traj_veh_filtered.csv (id, frame,
label, x_est, y_est, psi_est [rad], vel_est [m/s]), Kalman-filtered, in metres.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from vpsci_ros.data.importers.layout import clip_of
from vpsci_ros.data.importers.layout_file import Layout
from vpsci_ros.data.importers.tracks import Clip, Importer, attempted, read_csv
from vpsci_ros.errors import InvalidInput

_VEHICLE_END = "_traj_veh_filtered.csv"
_PEDESTRIAN_END = "_traj_ped_filtered.csv"
_NO_VEHICLE = "_no_vehicle_"
_TRACK = {"id": "id", "frame": "frame", "x": "x_est", "y": "y_est"}
_VEHICLE = _TRACK | {"heading": "psi_est", "speed": "vel_est"}
_PEDESTRIAN = _TRACK | {"vx": "vx_est", "vy": "vy_est"}
_KIND = frozenset({"label"})  # every track of a file is of one kind


def read_folder(folder: Path, frame_rate: float) -> Iterator[Clip]:
    """Yield every clip of a folder as published, sorted by name.

    :raises InvalidInput: see `find_clips`.
    """
    return (attempted(files[0], partial(read_clip, *files, frame_rate)) for files in find_clips(folder))


VCI_DUT, VCI_CITR = (
    Importer(partial(read_folder, frame_rate=rate), length=length, width=width, frame_rate=rate)
    for rate, length, width in ((23.976, 4.5, 1.8), (29.97, 2.4, 1.2))
)


def find_clips(folder: str | Path) -> list[tuple[str, Path, Path]]:
    """Return (clip, pedestrian file, vehicle file) of a folder, sorted by name.

    VCI-CITR also has recordings of pedestrians alone, "no_vehicle" in their names; they hold no pair and are left out.

    :raises InvalidInput: no such folder, or no clip in it.
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
    names = sorted(vehicles.keys() | pedestrians.keys())
    return [(name, folder / f"{name}{_PEDESTRIAN_END}", folder / f"{name}{_VEHICLE_END}") for name in names]


def read_clip(name: str, pedestrian_file: Path, vehicle_file: Path, frame_rate: float) -> Clip:
    """Read one clip; see `layout.clip_of`.

    :raises InvalidInput: one file of the pair is missing.
    """
    for there, other in ((vehicle_file, pedestrian_file), (pedestrian_file, vehicle_file)):
        if not other.is_file():
            where = f"{there.parent}: {there.name} is there without {other.name}"
            raise InvalidInput(f"{where}; add that file or remove this one")
    vehicle = Layout(_VEHICLE, _KIND, frozenset(), frame_rate, speeds_agree=False)
    pedestrian = Layout(_PEDESTRIAN, frozenset(), _KIND, frame_rate)
    layouts = {pedestrian_file: pedestrian, vehicle_file: vehicle}
    return clip_of(name, {file: (read_csv(file), layout) for file, layout in layouts.items()})
