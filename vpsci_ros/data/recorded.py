"""Recorded interactions as episodes, from a near-miss table."""

from collections.abc import Collection, Iterator

import numpy as np
import polars as pl

from vpsci_ros.data.courses import slope
from vpsci_ros.data.episode import RECORDED, Episode, Listed
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, curvature_from_yaw_rate
from vpsci_ros.world.observation import STEP

FLAGS = ("standing", "begins_critical", "contact", "apart")
"""Columns of the table that become marks of its episodes."""


def recorded_list(table: pl.DataFrame) -> list[Listed]:
    """Return the interactions of a near-miss table without their motion, named by their numbers."""
    rows = table.group_by("interaction", maintain_order=True).agg(
        pl.col("source").first(), pl.col("clip").first(), pl.col("curvttc").min()
    )
    return [_listed(*row) for row in rows.rows()]


def recorded_episodes(
    table: pl.DataFrame, wanted: Collection[str] | None = None, source: str = ""
) -> Iterator[Episode]:
    """Yield the interactions of a near-miss table as episodes, vehicles of the size that the table says.

    :param wanted: names; None: all.
    """
    for part in table.partition_by("interaction", maintain_order=True):
        if wanted is None or str(part["interaction"][0]) in wanted:
            yield _episode(part, source)


def _listed(number: int, source: str, clip: str, least: float) -> Listed:
    return Listed(str(number), f"{source}/{clip}", 0, number, RECORDED, least)


def _episode(part: pl.DataFrame, source: str) -> Episode:
    column = {name: part[name].to_numpy() for name in part.columns if part[name].dtype == pl.Float64}
    own = part["source"][0]
    length, width = size_of(part)
    x, y, heading, speed = (column[f"veh_{name}"] for name in ("x", "y", "heading", "speed"))
    walk = (column[name][None] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc", "distance"))
    px, py, vx, vy, curvttc, distance = walk
    listed = _listed(part["interaction"][0], own, part["clip"][0], float(curvttc.min()))
    vehicle = x, y, heading, speed, curvature_from_yaw_rate(slope(heading), speed)
    marks = tuple(name for name in FLAGS if part[name][0])
    return Episode(
        *(source, listed, None, STEP),
        *vehicle,
        *(px, py, vx, vy, curvttc, distance),
        controlled=np.zeros(curvttc.shape, np.bool_),
        seen=np.ones(curvttc.shape, np.bool_),
        length=length,
        width=width,
        marks=marks,
    )


def size_of(rows: pl.DataFrame) -> tuple[float, float]:
    """Return length and width [m] of the vehicle of an interaction; rows without sizes have the default vehicle's."""
    if not {"veh_length", "veh_width"} <= set(rows.columns):
        return VEHICLE_LENGTH, VEHICLE_WIDTH
    return float(rows["veh_length"][0]), float(rows["veh_width"][0])
