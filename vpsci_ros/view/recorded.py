"""Recorded people: the interactions of a near-miss table."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.tracks import slope
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.recorded import vehicle_size
from vpsci_ros.safety import curvature_from_yaw_rate
from vpsci_ros.view.episodes import RECORDED, Episode, Size, Source, judged, named, spread
from vpsci_ros.world.observation import STEP

_COLUMNS = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc")
FLAGS = ("standing", "begins_critical", "contact")
"""Columns of the table that the page filters by."""


def near_miss_source(path: Path, limit: int, wanted: Sequence[str] = ()) -> Source:
    """Return the interactions of a near-miss table, named by their numbers.

    :raises InvalidInput: no near-miss table, or none of a wanted name.
    """
    return table_source(read_near_misses(path), path.stem, limit, wanted, where=str(path))


def table_source(table: pl.DataFrame, key: str, limit: int, wanted: Sequence[str] = (), *, where: str = "") -> Source:
    """Return the interactions of a near-miss table in memory."""
    parts = table.partition_by("interaction", maintain_order=True)
    names = [str(part["interaction"][0]) for part in parts]
    rows = named(names, wanted, where or key) if wanted else spread(len(parts), limit)
    return Source(key, f"{key} (recorded)", STEP, [_episode(parts[row], names[row]) for row in rows], len(parts))


def _episode(part: pl.DataFrame, name: str) -> Episode:
    x, y, heading, speed, *rest = (part[column].to_numpy() for column in _COLUMNS)
    rate = slope(heading) if part.height > 1 else np.zeros(1)
    curvature = curvature_from_yaw_rate(rate, speed)
    values = np.column_stack([x, y, heading, speed, curvature, *rest, np.zeros(part.height)])
    size = Size(*vehicle_size(part["source"][0]))
    yielded, marks = judged(values, STEP, size)
    marks += tuple(name for name in FLAGS if part[name][0])
    group = f"{part['source'][0]}/{part['clip'][0]}"
    return Episode(name, group, 0, RECORDED, yielded, values, size, marks)
