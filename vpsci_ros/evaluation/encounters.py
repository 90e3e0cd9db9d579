"""A row an interaction: the moment at which the risk emerges, and what came of it (sections 4.3, 4.5 and 4.6).

The onset is the first frame with CurvTTC of 5 s or less; initial speeds, accelerations and distance are those of that
frame. A conflict falls below 2 s later on. Who yielded says `vpsci_ros.safety.who_yielded`; the paper's authors judged
by eye. Recorded near misses and generated episodes go through the same lines, so that they compare.
"""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset, EpisodeArrays
from vpsci_ros.data.recorded import vehicle_size
from vpsci_ros.evaluation.yields import seen, yields
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC, who_yielded
from vpsci_ros.safety.episodes import onset
from vpsci_ros.safety.yielding import Yielded
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
ACCELERATION_OVER = 0.2  # [s] before the onset, or after it where nothing was seen before

SCHEMA = {
    "group": pl.String,  # scenario, or clip: what interactions share agents or a place with
    "onset_curvttc": pl.Float64,  # [s]
    "least_curvttc": pl.Float64,  # [s]
    "distance": pl.Float64,  # [m] between the centres at the onset
    "vehicle_speed": pl.Float64,  # [m/s] at the onset, as are the next three
    "vehicle_acceleration": pl.Float64,  # [m/s2]
    "pedestrian_speed": pl.Float64,
    "pedestrian_acceleration": pl.Float64,
    "conflict": pl.Boolean,
    "vehicle_yields": pl.Boolean,
    "pedestrian_yields": pl.Boolean,
}


def generated_encounters(data: Dataset) -> pl.DataFrame:
    """Return the kept episodes of a dataset as a table of `SCHEMA`.

    :raises InvalidInput: a file of the dataset is missing or damaged.
    """
    parts = [_generated(part, name, data.period) for name in data.scenarios for part in data.episodes(name)]
    return pl.concat(parts) if parts else pl.DataFrame(schema=SCHEMA)


def recorded_encounters(near_misses: pl.DataFrame) -> pl.DataFrame:
    """Return a near-miss table as a table of `SCHEMA`; vehicles have the size of their source.

    The onset is that of CurvTTC as known at the step. Who yielded is judged on the whole tracks.
    """
    parts = near_misses.partition_by("interaction", maintain_order=True)
    return pl.concat([_recorded(part) for part in parts]) if parts else pl.DataFrame(schema=SCHEMA)


def _generated(part: EpisodeArrays, name: str, period: float) -> pl.DataFrame:
    column = {key: seen(part[key], part.lengths) for key in _GENERATED}
    speeds = {
        "vehicle": np.hypot(column["velocity_x_av"], column["velocity_y_av"]),
        "pedestrian": np.hypot(column["velocity_x_ped"], column["velocity_y_ped"]),
    }
    ttc = np.nan_to_num(part["CurvTTC"].astype(np.float64), nan=np.inf, posinf=np.inf)
    ttc[np.arange(ttc.shape[1]) >= part.lengths[:, None]] = np.inf
    return _table(name, ttc, column["distance"], speeds, part.lengths, period, yields(part, period))


_GENERATED = ("velocity_x_av", "velocity_y_av", "velocity_x_ped", "velocity_y_ped", "distance")


def _recorded(part: pl.DataFrame) -> pl.DataFrame:
    column = {name: part[name].to_numpy()[None] for name in part.columns if part[name].dtype == pl.Float64}
    length, width = vehicle_size(part["source"][0])
    x, y, heading, speed, ped_x, ped_y, ped_vx, ped_vy, ttc = (column[name] for name in _RECORDED)
    walk = (ped_x, ped_y, ped_vx, ped_vy)
    codes = who_yielded(x, y, heading, speed, *walk, ttc, dt=STEP, length=length, width=width)
    speeds = {"vehicle": speed, "pedestrian": np.hypot(ped_vx, ped_vy)}
    name = f"{part['source'][0]}/{part['clip'][0]}"
    causal = column["curvttc_causal"] if (column["curvttc_causal"] <= CRITICAL_TTC).any() else ttc
    return _table(name, ttc, column["distance"], speeds, np.array([part.height]), STEP, codes, causal)


_RECORDED = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc")


def _table(
    group: str,
    ttc: Floats,
    distance: Floats,
    speeds: Mapping[str, Floats],
    lengths: NDArray[np.int64],
    period: float,
    codes: NDArray[np.uint8],
    known: Floats | None = None,
) -> pl.DataFrame:
    """Return the rows of n interactions, arrays [n, T]; those that never become critical are left out.

    :param known: CurvTTC [s] that the onset is told by, [n, T]; None: `ttc`, which the least one is of.
    """
    known = ttc if known is None else known
    at = onset(known)
    rows = np.flatnonzero(at >= 0)
    at, least = at[rows], ttc[rows].min(axis=1)
    back = max(1, round(ACCELERATION_OVER / period))
    begin = np.maximum(at - back, 0)
    end = np.where(at > 0, at, np.minimum(back, lengths[rows] - 1))
    values = {"onset_curvttc": known[rows, at], "least_curvttc": least, "distance": distance[rows, at]}
    for agent, speed in speeds.items():
        values[f"{agent}_speed"] = speed[rows, at]
        change = speed[rows, end] - speed[rows, begin]
        values[f"{agent}_acceleration"] = change / (np.maximum(end - begin, 1) * period)
    code = codes[rows]
    flags = {
        "conflict": least < CONFLICT_TTC,
        "vehicle_yields": (code & Yielded.VEHICLE) > 0,
        "pedestrian_yields": (code & Yielded.PEDESTRIAN) > 0,
    }
    return pl.DataFrame({"group": [group] * len(rows), **values, **flags}, schema=SCHEMA)
