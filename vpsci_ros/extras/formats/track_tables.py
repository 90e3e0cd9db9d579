"""Published recordings that hold tables of tracks: levelXData, INTERACTION, SinD, Argoverse 2 and TGSIM.

Vehicles are motor vehicles on four wheels or more; bicycles, motorcycles and the like are left out, and the import says
how many. Sizes are the tracks' own where the format has them. Each function yields a clip a recording, sorted by name.
"""

from collections.abc import Iterator
from pathlib import Path

import polars as pl

from vpsci_ros.data.importers.importer import Clip, Importer
from vpsci_ros.data.importers.layout import Layout, clip_of, read_csv
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.errors import InvalidInput

_MOTION = {"x": "x", "y": "y", "vx": "vx", "vy": "vy"}
_WALKERS = frozenset({"pedestrian", "pedestrain", "pedestrian/bicycle"})  # as SinD and INTERACTION spell them


def _found(folder: Path, pattern: str, what: str) -> list[Path]:
    files = sorted(folder.rglob(pattern)) if folder.is_dir() else []
    if not files:
        raise InvalidInput(f"{folder}: expected {what} as published ({pattern}), found none")
    return files


def _beside(path: Path, name: str) -> Path:
    other = path.with_name(name)
    if not other.is_file():
        raise InvalidInput(f"{path.name}: {name} is missing beside it; take all files of a recording as published")
    return other


def levelx(folder: Path) -> Iterator[Clip]:
    """Yield the recordings of inD, rounD or uniD: NN_tracks.csv, NN_tracksMeta.csv, NN_recordingMeta.csv.

    Source: https://levelxdata.com. Metres, y up, headings in degrees; classes and sizes are in tracksMeta, the frame
    rate in recordingMeta.
    """
    columns = {"id": "trackId", "frame": "frame", "class": "class", "x": "xCenter", "y": "yCenter"}
    columns |= {"vx": "xVelocity", "vy": "yVelocity", "heading": "heading", "length": "length", "width": "width"}
    vehicles = frozenset({"car", "van", "truck", "bus", "truck_bus", "trailer"})
    for path in _found(folder, "*_tracks.csv", "recordings of levelXData"):
        name = path.name.removesuffix("_tracks.csv")
        tracks = read_csv(path)
        meta = read_csv(_beside(path, f"{name}_tracksMeta.csv"))
        recording = read_csv(_beside(path, f"{name}_recordingMeta.csv"))
        if not {"trackId", "class"} <= set(meta.columns) or "frameRate" not in recording.columns:
            raise InvalidInput(
                f"{path}: expected trackId and class in tracksMeta, frameRate in recordingMeta; take them as published"
            )
        rate = recording["frameRate"].cast(pl.Float64, strict=False)[0]
        if rate is None or not rate > 0.0:
            raise InvalidInput(f"{path}: frameRate of its recordingMeta: expected a number above 0, got {rate}")
        table = tracks.join(meta.select("trackId", "class"), on="trackId", how="left", maintain_order="left")
        layout = Layout(columns, vehicles, frozenset({"pedestrian"}), frame_rate=float(rate), degrees=True)
        yield clip_of(name, {path: (table, layout)})


def interaction(folder: Path) -> Iterator[Clip]:
    """Yield the recordings of INTERACTION: vehicle_tracks_NNN.csv and, where there are any, pedestrian_tracks_NNN.csv.

    Source: Zhan et al., "INTERACTION Dataset", arXiv 1910.03088. Milliseconds, metres, radians. Its class
    "pedestrian/bicycle" does not distinguish these two; all of them count as pedestrians here.
    """
    walkers = {"id": "track_id", "time": "timestamp_ms", "class": "agent_type", **_MOTION}
    cars = walkers | {"heading": "psi_rad", "length": "length", "width": "width"}
    vehicles = frozenset({"car", "truck", "bus"})
    for path in _found(folder, "vehicle_tracks_*.csv", "recordings of INTERACTION"):
        number = path.stem.removeprefix("vehicle_tracks_")
        parts = {path: (read_csv(path), Layout(cars, vehicles, frozenset(), time_unit=1e-3))}
        other = path.with_name(f"pedestrian_tracks_{number}.csv")
        if other.is_file():
            parts[other] = read_csv(other), Layout(walkers, frozenset(), _WALKERS, time_unit=1e-3)
        yield clip_of(f"{path.parent.name}/{number}", parts)


def sind(folder: Path) -> Iterator[Clip]:
    """Yield the recordings of SinD: folders with Veh_smoothed_tracks.csv and Ped_smoothed_tracks.csv.

    Source: Xu et al., "SIND: A Drone Dataset at Signalized Intersection in China", ITSC 2022. Milliseconds, metres,
    radians; `yaw_rad` is where the vehicle points, `heading_rad` where it moves: the former is taken.
    """
    walkers = {"id": "track_id", "time": "timestamp_ms", "class": "agent_type", **_MOTION}
    cars = walkers | {"heading": "yaw_rad", "length": "length", "width": "width"}
    vehicles = frozenset({"car", "truck", "bus"})
    for path in _found(folder, "Veh_smoothed_tracks.csv", "recordings of SinD"):
        other = _beside(path, "Ped_smoothed_tracks.csv")
        yield clip_of(
            path.parent.name,
            {
                path: (read_csv(path), Layout(cars, vehicles, frozenset(), time_unit=1e-3)),
                other: (read_csv(other), Layout(walkers, frozenset(), _WALKERS, time_unit=1e-3)),
            },
        )


def argoverse2(folder: Path) -> Iterator[Clip]:
    """Yield the scenarios of Argoverse 2 motion forecasting: scenario_ID.parquet, 11 s at 10 Hz each.

    Source: Wilson et al., "Argoverse 2", NeurIPS 2021. Metres, radians, no sizes. Names of tracks become numbers.
    """
    columns = {"id": "track_id", "frame": "timestep", "class": "object_type", "x": "position_x", "y": "position_y"}
    columns |= {"vx": "velocity_x", "vy": "velocity_y", "heading": "heading"}
    layout = Layout(columns, frozenset({"vehicle", "bus"}), frozenset({"pedestrian"}), frame_rate=10.0)
    for path in _found(folder, "scenario_*.parquet", "scenarios of Argoverse 2"):
        try:
            table = read_parquet(path, "a scenario")
        except (pl.exceptions.PolarsError, OSError) as error:
            raise InvalidInput(f"{path}: not readable as Parquet: {error}; take the file as published") from error
        yield clip_of(path.stem.removeprefix("scenario_"), {path: (table, layout)})


def tgsim(folder: Path) -> Iterator[Clip]:
    """Yield the runs of TGSIM's Foggy Bottom trajectories, from its one CSV file.

    Source: Third Generation Simulation Data, US DOT, data.transportation.gov. Seconds, metres, the origin at the upper
    left of the picture, so that y points down; no headings. Types: 0 pedestrians, 3 to 7 motor vehicles.
    """
    columns = {"id": "id", "time": "time", "class": "type_most_common", "x": "xloc_kf", "y": "yloc_kf"}
    columns |= {"vx": "speed_kf_x", "vy": "speed_kf_y", "length": "length_smoothed", "width": "width_smoothed"}
    vehicles = frozenset({"3", "4", "5", "6", "7"})
    layout = Layout(columns, vehicles, frozenset({"0"}), y_down=True)
    for path in _found(folder, "*Foggy_Bottom*.csv", "trajectories of TGSIM Foggy Bottom"):
        table = read_csv(path)
        runs = table.partition_by("run_index", as_dict=True) if "run_index" in table.columns else {("0",): table}
        for (run,), rows in sorted(runs.items()):
            yield clip_of(f"{path.stem}/{run}", {path: (rows, layout)})


LEVELX = Importer(levelx, length=4.5, width=1.8)
INTERACTION = Importer(interaction, length=4.5, width=1.8)
SIND = Importer(sind, length=4.5, width=1.8)
ARGOVERSE2 = Importer(argoverse2, length=4.5, width=1.8)
TGSIM = Importer(tgsim, length=4.5, width=1.8)
