"""The INTERACTION data set's columns, as Test Area Autonomous Driving Baden-Wuerttemberg publishes its tracks.

Source: FZI, "TAF-BW dataset" (CC BY-NC-SA 4.0), two signalised junctions at 10 Hz, metres, x east and y north. A clip
is one file vehicle_tracks_NNN.csv: track_id, frame_id, timestamp_ms, agent_type (Car, Pedestrian ...), x, y, vx, vy,
psi_rad, length, width, in any order. Positions of online tracking may freeze for some frames; the frozen ones are left
out and bridged.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.importer import Clip, Importer
from vpsci_ros.data.importers.layout import Layout, clip_of, read_csv
from vpsci_ros.data.importers.tracks import Track, require_columns
from vpsci_ros.errors import InvalidInput

_PATTERN = "vehicle_tracks_*.csv"
_LAYOUT = Layout(
    {"id": "track_id", "time": "timestamp_ms", "class": "agent_type", "heading": "psi_rad"}
    | {name: name for name in ("x", "y", "vx", "vy")},
    vehicles=frozenset({"car", "truck", "bus", "van"}),
    pedestrians=frozenset({"pedestrian", "pedestrian/bicycle"}),
    time_unit=1e-3,
    speeds_agree=False,
)
_FROZEN = 0.3  # [m/s] a track that says it moves faster than this, and does not move, is frozen
_FLIP = 0.5  # [rad] a heading that turns by more in 0.1 s


def read_folder(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each track file of a folder and of the folders in it, sorted by name.

    :raises InvalidInput: no such folder, no track file in it, or a file that does not hold what it should.
    """
    files = sorted(folder.rglob(_PATTERN)) if folder.is_dir() else []
    if not files:
        raise InvalidInput(f"{folder}: expected a folder with files {_PATTERN}, as published; found none")
    for path in files:
        name = path.stem.removeprefix("vehicle_tracks_")
        yield read_clip(f"{path.parent.name}/{name}" if path.parent != folder else name, path)


TAF_BW = Importer(read_folder, length=4.6, width=2.1)


def read_clip(name: str, path: Path) -> Clip:
    """Read one file and resample its tracks to 0.1 s.

    :raises InvalidInput: a column is missing or holds something else.
    """
    table = read_csv(path)
    require_columns(table, _LAYOUT.columns.values(), path)
    kind = pl.col("agent_type").first().over("track_id").str.to_lowercase()
    clip = clip_of(name, {path: (table.with_columns(kind).filter(~_frozen(table)), _LAYOUT)})
    return replace(clip, vehicles=[piece for track in clip.vehicles for piece in _without_flips(track)])


def _frozen(table: pl.DataFrame) -> pl.Series:
    """Return which rows repeat the position before, though the agent says that it moves."""
    x, y, vx, vy = (pl.col(name).cast(pl.Float64, strict=False) for name in ("x", "y", "vx", "vy"))
    still = (x.diff().over("track_id") == 0.0) & (y.diff().over("track_id") == 0.0)
    moving = (vx**2 + vy**2).sqrt() > _FROZEN
    return table.select((still & moving).fill_null(False).alias("frozen"))["frozen"]


def _without_flips(track: Track) -> Iterator[Track]:
    """Yield the pieces of a track between two steps at which the tracker took the front for the rear."""
    cuts = np.flatnonzero(np.abs(np.diff(track.values["heading"])) > _FLIP) + 1
    for piece in np.split(np.arange(track.last - track.first + 1), cuts):
        own = slice(int(piece[0]), int(piece[-1]) + 1)
        yield Track(track.number, track.first + own.start, {name: v[own] for name, v in track.values.items()})
