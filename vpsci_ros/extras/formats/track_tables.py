"""Recordings published as tables of tracks: levelXData, INTERACTION, SinD, Argoverse 2, TGSIM and TAF-BW.

Vehicles are motor vehicles on four wheels or more; bicycles, motorcycles and the like are left out, and the import says
how many. Sizes are the tracks' own where the format has them. Most formats are a layout in `layouts/`, as users write
one for their own recordings (`vpsci_ros.data.importers.described`); levelXData spreads a recording over three files.
TAF-BW (Test Area Autonomous Driving Baden-Wuerttemberg) has frozen positions and flipped headings, which are left out.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.described import described
from vpsci_ros.data.importers.layout import Layout, clip_of
from vpsci_ros.data.importers.tracks import Clip, Importer, Track, read_csv, require_columns
from vpsci_ros.errors import InvalidInput

_LAYOUTS = Path(__file__).resolve().parent / "layouts"
_TAF_BW_FILES = "vehicle_tracks_*.csv"
_TAF_BW = Layout(
    {"id": "track_id", "time": "timestamp_ms", "class": "agent_type", "heading": "psi_rad"}
    | {name: name for name in ("x", "y", "vx", "vy")},
    vehicles=frozenset({"car", "truck", "bus", "van"}),
    pedestrians=frozenset({"pedestrian", "pedestrian/bicycle"}),
    time_unit=1e-3,
    speeds_agree=False,
)
_FROZEN = 0.3  # [m/s] a track that says it moves faster than this, and does not move, is frozen
_FLIP = 0.5  # [rad] a heading that turns by more in 0.1 s


def levelx(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each recording of inD, rounD or uniD: NN_tracks.csv, _tracksMeta.csv, _recordingMeta.csv.

    Source: https://levelxdata.com. Metres, y up, headings in degrees; classes and sizes are in tracksMeta, the frame
    rate in recordingMeta.

    :raises InvalidInput: no such files, one of the three is missing, or a column or the frame rate is.
    """
    columns = {"id": "trackId", "frame": "frame", "class": "class", "x": "xCenter", "y": "yCenter"}
    columns |= {"vx": "xVelocity", "vy": "yVelocity", "heading": "heading", "length": "length", "width": "width"}
    vehicles = frozenset({"car", "van", "truck", "bus", "truck_bus", "trailer"})
    files = sorted(folder.rglob("*_tracks.csv"))
    if not files:
        raise InvalidInput(f"{folder}: expected recordings of levelXData as published (*_tracks.csv), found none")
    for path in files:
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


def _beside(path: Path, name: str) -> Path:
    other = path.with_name(name)
    if not other.is_file():
        raise InvalidInput(f"{path.name}: {name} is missing beside it; take all files of a recording as published")
    return other


def _importer(name: str) -> Importer:
    return Importer(partial(described, description=_LAYOUTS / f"{name}.yaml"), length=4.5, width=1.8)


def taf_bw(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each file of Test Area Autonomous Driving Baden-Wuerttemberg below a folder, sorted by name.

    Source: FZI, "TAF-BW dataset" (CC BY-NC-SA 4.0), two signalised junctions at 10 Hz, metres, x east and y north. A
    clip is one file vehicle_tracks_NNN.csv with INTERACTION's columns track_id, frame_id, timestamp_ms, agent_type
    (Car, Pedestrian ...), x, y, vx, vy, psi_rad, length, width, in any order. Positions of online tracking may freeze
    for some frames; the frozen ones are left out and bridged.

    :raises InvalidInput: no such folder, no track file in it, or a file that does not hold what it should.
    """
    files = sorted(folder.rglob(_TAF_BW_FILES)) if folder.is_dir() else []
    if not files:
        raise InvalidInput(f"{folder}: expected a folder with files {_TAF_BW_FILES}, as published; found none")
    for path in files:
        name = path.stem.removeprefix("vehicle_tracks_")
        yield read_clip(f"{path.parent.name}/{name}" if path.parent != folder else name, path)


def read_clip(name: str, path: Path) -> Clip:
    """Return the clip of one file of TAF-BW, with tracks resampled to 0.1 s.

    :raises InvalidInput: a column is missing or holds something else.
    """
    table = read_csv(path)
    require_columns(table, _TAF_BW.columns.values(), path)
    kind = pl.col("agent_type").first().over("track_id").str.to_lowercase()
    clip = clip_of(name, {path: (table.with_columns(kind).filter(~_frozen(table)), _TAF_BW)})
    return replace(clip, vehicles=[piece for track in clip.vehicles for piece in _without_flips(track)])


def _frozen(table: pl.DataFrame) -> pl.Series:
    """Return, as bool[n], the rows that repeat the track's previous position although their velocity says it moves."""
    x, y, vx, vy = (pl.col(name).cast(pl.Float64, strict=False) for name in ("x", "y", "vx", "vy"))
    still = (x.diff().over("track_id") == 0.0) & (y.diff().over("track_id") == 0.0)
    moving = (vx**2 + vy**2).sqrt() > _FROZEN
    return table.select((still & moving).fill_null(False).alias("frozen"))["frozen"]


def _without_flips(track: Track) -> Iterator[Track]:
    """Yield the pieces of a track cut where its heading jumps, as when the tracker takes the front for the rear."""
    cuts = np.flatnonzero(np.abs(np.diff(track.values["heading"])) > _FLIP) + 1
    for piece in np.split(np.arange(track.last - track.first + 1), cuts):
        own = slice(int(piece[0]), int(piece[-1]) + 1)
        yield Track(track.number, track.first + own.start, {name: v[own] for name, v in track.values.items()})


LEVELX = Importer(levelx, length=4.5, width=1.8)
INTERACTION, SIND, ARGOVERSE2, TGSIM = map(_importer, ("interaction", "sind", "argoverse2", "tgsim"))
TAF_BW = Importer(taf_bw, length=4.6, width=2.1)
