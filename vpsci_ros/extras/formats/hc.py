"""Importer of HC: pedestrians and cars in a shared space in Hamburg, at 2 Hz, from above, in pixels.

Source: Cheng, Li and Sester, IEEE IV 2019, by way of the MCENET repository (MIT). A clip is a file D1.csv without a
header: frame, id, x, y, class (1 pedestrian, 2 vehicle, 3 cyclist), in pixels with y down. There is no heading, no
velocity and no size: cubic splines through the positions give the first two.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
from scipy.interpolate import CubicSpline

from vpsci_ros.data.importers.tracks import Clip, Floats, Importer, Track, require_short_line
from vpsci_ros.documents import require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

PIXELS = 21.1857  # [1/m]
FRAME_RATE = 2.0  # [1/s], inferred from walking speed
PEDESTRIAN, VEHICLE = 1, 2
_COLUMNS = ("frame", "id", "x", "y", "class")
_MOVED = 0.5  # [m] in a second; what comes less far says nothing about its heading
_LONGEST = 1  # frames from one position to the next; a track is cut where there are more
_FEWEST = 4  # positions of a track


def read_folder(folder: Path) -> Iterator[Clip]:
    """Yield a clip for each CSV file of a folder, sorted by name.

    :raises InvalidInput: no such folder, no CSV file in it, or a file without five columns of numbers.
    """
    files = sorted(folder.glob("*.csv")) if folder.is_dir() else []
    if not files:
        raise InvalidInput(f"{folder}: expected a folder with D1.csv and so on, as published; found none")
    return (read_clip(path) for path in files)


HC = Importer(read_folder, length=4.5, width=1.8)


def read_clip(path: Path) -> Clip:
    """Return the clip of one file; pieces of at least 4 positions (1.5 s) become tracks on the 0.1 s grid.

    :raises InvalidInput: not five columns of numbers.
    """
    require_regular(path)
    data = path.read_bytes()
    require_short_line(data, path)
    try:
        table = pl.read_csv(data, has_header=False, schema_overrides=[pl.Float64] * len(_COLUMNS))
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInput(
            f"{path}: expected rows of {', '.join(_COLUMNS)}, numbers without a header: {error}"
        ) from error
    if table.width != len(_COLUMNS) or table.select(pl.all().is_null().any()).row(0) != (False,) * table.width:
        raise InvalidInput(f"{path}: expected {', '.join(_COLUMNS)} in every row, got {table.width} columns")
    table.columns = list(_COLUMNS)
    tracks: dict[int, list[Track]] = {PEDESTRIAN: [], VEHICLE: []}
    for part in table.sort("id", "frame").partition_by("id", maintain_order=True):
        kind = int(part["class"][0])
        if kind not in tracks:
            continue
        frames = part["frame"].to_numpy()
        for piece in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames) > _LONGEST) + 1):
            if len(piece) >= _FEWEST:
                place = part.select("x", "y").to_numpy()[piece] / [PIXELS, -PIXELS]
                tracks[kind].append(_track(int(part["id"][0]), frames[piece] / FRAME_RATE, place, kind))
    return Clip(path.stem, tracks[VEHICLE], tracks[PEDESTRIAN])


def _track(number: int, times: Floats, place: Floats, kind: int) -> Track:
    """Return a track on the grid from positions [T, 2] [m] at `times` [s]."""
    curve = CubicSpline(times, place)
    first = int(np.ceil(times[0] / STEP - 1e-6))
    grid = STEP * np.arange(first, int(np.floor(times[-1] / STEP + 1e-6)) + 1)
    (x, y), (vx, vy) = curve(grid).T, curve(grid, 1).T
    if kind == PEDESTRIAN:
        return Track(number, first, {"x": x, "y": y, "vx": vx, "vy": vy})
    speed = np.hypot(vx, vy)
    ends = [curve(np.clip(grid + side, times[0], times[-1])) for side in (-0.5, 0.5)]
    return Track(number, first, {"x": x, "y": y, "heading": _heading(ends[1] - ends[0]), "speed": speed})


def _heading(way: Floats) -> Floats:
    """Return the direction [rad] of the way [T, 2] of a second around each step, unwrapped.

    While a vehicle stands its heading is interpolated to the next one; zeros if it never moves.
    """
    moving = np.flatnonzero(np.hypot(way[:, 0], way[:, 1]) > _MOVED)
    if moving.size == 0:
        return np.zeros(len(way))
    direction = np.unwrap(np.arctan2(way[moving, 1], way[moving, 0]))
    return np.interp(np.arange(len(way)), moving, direction)
