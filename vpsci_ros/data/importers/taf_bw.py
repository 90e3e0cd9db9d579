"""The INTERACTION data set's columns, as Test Area Autonomous Driving Baden-Wuerttemberg publishes its tracks.

Source: FZI, "TAF-BW dataset" (CC BY-NC-SA 4.0), two signalised junctions at 10 Hz, metres, x east and y north. A clip
is one file vehicle_tracks_NNN.csv: track_id, frame_id, timestamp_ms, agent_type (Car, Pedestrian ...), x, y, vx, vy,
psi_rad, length, width, in any order. Positions of online tracking may freeze for some frames; the frozen ones are left
out and bridged.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.importer import BACKWARDS, Clip, Importer
from vpsci_ros.data.importers.layout import REVERSING
from vpsci_ros.data.importers.tracks import Floats, Track, read_tracks_csv, resample
from vpsci_ros.errors import InvalidInput

_PATTERN = "vehicle_tracks_*.csv"
_VALUES = ("x", "y", "vx", "vy", "psi_rad")
_FRAME_RATE = 1000.0  # [1/s] of timestamp_ms
VEHICLES, PEDESTRIANS = ("car", "truck", "bus", "van"), ("pedestrian", "pedestrian/bicycle")
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
    table, kinds = _read(path)
    moving = table.filter(~_frozen(table))
    vehicles, pedestrians = (
        moving.filter(pl.col("id").is_in([number for number, kind in kinds.items() if kind in of]))
        for of in (VEHICLES, PEDESTRIANS)
    )
    along = pl.col("vx") * pl.col("psi_rad").cos() + pl.col("vy") * pl.col("psi_rad").sin()
    forward = vehicles.filter(along >= REVERSING)
    return Clip(
        name,
        [
            Track(piece.number, piece.first, _vehicle(piece.values))
            for track in resample(forward, _FRAME_RATE, angle="psi_rad")
            for piece in _without_flips(track)
        ],
        [
            Track(t.number, t.first, {key: t.values[key] for key in ("x", "y", "vx", "vy")})
            for t in resample(pedestrians.drop("psi_rad"), _FRAME_RATE)
        ],
        {BACKWARDS: vehicles.height - forward.height},
    )


def _read(path: Path) -> tuple[pl.DataFrame, dict[int, str]]:
    """Return id, frame [ms] and `_VALUES` of a file, and the kind of each id in lower case."""
    table = read_tracks_csv(path, _VALUES, ("track_id", "timestamp_ms"))
    kinds = pl.read_csv(path, columns=["track_id", "agent_type"], schema_overrides={"agent_type": pl.String})
    first = kinds.group_by("track_id").agg(pl.col("agent_type").first().str.to_lowercase())
    return table, dict(first.rows())


def _frozen(table: pl.DataFrame) -> pl.Series:
    """Return which rows repeat the position before, though the agent says that it moves."""
    still = (pl.col("x").diff().over("id") == 0.0) & (pl.col("y").diff().over("id") == 0.0)
    moving = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt() > _FROZEN
    return table.select((still & moving).fill_null(False).alias("frozen"))["frozen"]


def _without_flips(track: Track) -> Iterator[Track]:
    """Yield the pieces of a track between two steps at which the tracker took the front for the rear."""
    cuts = np.flatnonzero(np.abs(np.diff(track.values["psi_rad"])) > _FLIP) + 1
    for piece in np.split(np.arange(track.last - track.first + 1), cuts):
        own = slice(int(piece[0]), int(piece[-1]) + 1)
        yield Track(track.number, track.first + own.start, {name: v[own] for name, v in track.values.items()})


def _vehicle(values: dict[str, Floats]) -> dict[str, Floats]:
    heading = values["psi_rad"]
    along = values["vx"] * np.cos(heading) + values["vy"] * np.sin(heading)
    return {"x": values["x"], "y": values["y"], "heading": heading, "speed": np.maximum(along, 0.0)}
