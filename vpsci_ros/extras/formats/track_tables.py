"""Recordings published as tables of tracks: levelXData, INTERACTION, SinD, Argoverse 2 and TGSIM.

Vehicles are motor vehicles on four wheels or more; bicycles, motorcycles and the like are left out, and the import says
how many. Sizes are the tracks' own where the format has them. Argoverse 2 and TGSIM are a layout in `layouts/`, as
users write one for their own recordings (`vpsci_ros.data.importers.described`); the others have several files each.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import polars as pl

from vpsci_ros.data.importers.described import described
from vpsci_ros.data.importers.layout import clip_of
from vpsci_ros.data.importers.layout_file import ANGLES, Layout
from vpsci_ros.data.importers.tracks import Clip, Importer, attempted, read_csv
from vpsci_ros.errors import InvalidInput

_LAYOUTS = Path(__file__).resolve().parent / "layouts"


def levelx(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each recording of inD, rounD or uniD: NN_tracks.csv, _tracksMeta.csv, _recordingMeta.csv.

    Source: https://levelxdata.com. Metres, y up, headings in degrees; classes and sizes are in tracksMeta, the frame
    rate in recordingMeta.

    :raises InvalidInput: no such files.
    """
    files = sorted(folder.rglob("*_tracks.csv"))
    if not files:
        raise InvalidInput(f"{folder}: expected recordings of levelXData as published (*_tracks.csv), found none")
    return (attempted(path.name.removesuffix("_tracks.csv"), partial(_levelx, path)) for path in files)


def _levelx(path: Path) -> Clip:
    """Return a recording; refuse one of which a file, a column or the frame rate is missing."""
    columns = {"id": "trackId", "frame": "frame", "class": "class", "x": "xCenter", "y": "yCenter"}
    columns |= {"vx": "xVelocity", "vy": "yVelocity", "heading": "heading", "length": "length", "width": "width"}
    vehicles = frozenset({"car", "van", "truck", "bus", "truck_bus", "trailer"})
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
    walkers, cyclists = (frozenset({name}) for name in ("pedestrian", "bicycle"))
    layout = Layout(columns, vehicles, walkers, frame_rate=float(rate), angle=ANGLES["deg"], cyclists=cyclists)
    return clip_of(name, {path: (table, layout)})


def _beside(path: Path, name: str) -> Path:
    other = path.with_name(name)
    if not other.is_file():
        raise InvalidInput(f"{path.name}: {name} is missing beside it; take all files of a recording as published")
    return other


def two_files(vehicles: str, pedestrians: str, heading: str, folder: Path) -> Iterator[Clip]:
    """Yield a clip for each file of vehicles and the file of pedestrians beside it: INTERACTION and SinD.

    Milliseconds, metres, radians. Sources: Zhan et al., arXiv 1910.03088; Xu et al., ITSC 2022. Some files of SinD
    spell pedestrian "pedestrain".

    :param vehicles, pedestrians: parts of the two files' names.
    :param heading: column that says where a vehicle points.
    :raises InvalidInput: no such files.
    """
    columns = {"id": "track_id", "time": "timestamp_ms", "class": "agent_type"}
    columns |= {name: name for name in ("x", "y", "vx", "vy")}
    own = columns | {"heading": heading, "length": "length", "width": "width"}
    walkers, cyclists = frozenset({"pedestrian", "pedestrian/bicycle", "pedestrain"}), frozenset({"bicycle", "bike"})
    motor = frozenset({"car", "truck", "bus"})
    every = Layout(own, motor, walkers, time_unit=0.001, cyclists=cyclists, mixed=True)  # some have walkers, too
    layouts = {vehicles: every, pedestrians: Layout(columns, frozenset(), walkers, time_unit=0.001, mixed=True)}
    files = sorted(folder.rglob(f"{vehicles}*.csv"))
    if not files:
        raise InvalidInput(f"{folder}: expected recordings as published ({vehicles}*.csv), found none")

    def clip(name: str, path: Path) -> Clip:
        both = ((path.with_name(path.name.replace(vehicles, part)), layout) for part, layout in layouts.items())
        return clip_of(name, {file: (read_csv(file), layout) for file, layout in both if file.is_file()})

    for path in files:  # some have no pedestrians
        name = path.relative_to(folder).with_suffix("").as_posix()
        yield attempted(name, partial(clip, name, path))


def _importer(name: str, frame_rate: float = 0.0) -> Importer:
    read = partial(described, description=_LAYOUTS / f"{name}.yaml")
    return Importer(read, length=4.5, width=1.8, frame_rate=frame_rate)


LEVELX = Importer(levelx, length=4.5, width=1.8)
INTERACTION, SIND = (
    Importer(partial(two_files, *names), length=4.5, width=1.8)
    for names in (("vehicle_tracks", "pedestrian_tracks", "psi_rad"), ("Veh_smoothed", "Ped_smoothed", "yaw_rad"))
)
TGSIM = _importer("tgsim")
ARGOVERSE2 = _importer("argoverse2", frame_rate=10.0)
