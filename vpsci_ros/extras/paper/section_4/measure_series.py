"""Every safety measure along every recorded interaction, and when each first says "conflict"."""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.importers.tracks import slope
from vpsci_ros.data.recorded import vehicle_size
from vpsci_ros.data.reference import around_critical
from vpsci_ros.safety import (
    CONFLICT_TTC,
    closest_encounter,
    curvature_from_yaw_rate,
    curvttc,
    drac,
    post_encroachment_time,
    second_order_ttc,
    ttc_2d,
)
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
MEASURES = ("CurvTTC", "center", "TTC 2D", "2nd order", "DRAC", "TTCE", "PET")


CLOSEST = 2.0  # [m] distance of the centres below which a TTCE is a conflict
BRAKING = 3.4  # [m/s2] DRAC above which braking is no longer comfortable
ENCROACHMENT = 2.0  # [s] PET below which it is a conflict
THRESHOLDS = (
    f"TTC < {CONFLICT_TTC:g} s; DRAC > {BRAKING:g} m/s2; TTCE < {CONFLICT_TTC:g} s with DCE < {CLOSEST:g} m; "
    f"PET < {ENCROACHMENT:g} s"
)


def first_flags(table: pl.DataFrame) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64]]:
    """Return when each measure first flags each interaction, where PET is defined, and the clip of each interaction.

    :param table: a near-miss table. Vehicles have the size of their source, else the default size.
    :returns: float64[N, len(MEASURES)], time since the interaction's first row [s], infinity where never; bool[N]; and
        int64[N], clips numbered from 0. PET's time is that of the second agent's arrival.
    """
    parts = around_critical(table).partition_by("interaction", maintain_order=True)
    found = [_flags(part) for part in parts]
    keys = pl.Series([f"{part['source'][0]}/{part['clip'][0]}" for part in parts])
    times, defined = np.stack([times for times, _ in found]), np.array([defined for _, defined in found])
    return times, defined, keys.rank("dense").cast(pl.Int64).to_numpy() - 1


def _flags(part: pl.DataFrame) -> tuple[Floats, bool]:
    length, width = vehicle_size(part["source"][0])
    column = {name: part[name].to_numpy() for name in part.columns if part[name].dtype == pl.Float64}
    x, y, heading, speed = (column[name] for name in ("veh_x", "veh_y", "veh_heading", "veh_speed"))
    walker = tuple(column[name] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy"))
    curvature = curvature_from_yaw_rate(slope(heading), speed)
    curved = column["curvttc"]
    state = (x, y, heading, speed, curvature, *walker)
    center = curvttc(*state, length=length, width=width, method="center")
    straight = ttc_2d(x, y, heading, speed, *walker, length=length, width=width)
    second = second_order_ttc(x, y, heading, speed, slope(speed), curvature, *walker, length=length, width=width)
    ttce, dce = closest_encounter(x, y, speed * np.cos(heading), speed * np.sin(heading), *walker)
    flagged = np.stack(
        [
            curved < CONFLICT_TTC,
            center < CONFLICT_TTC,
            straight < CONFLICT_TTC,
            second < CONFLICT_TTC,
            drac(curved, speed) > BRAKING,
            (ttce < CONFLICT_TTC) & (ttce > 0.0) & (dce < CLOSEST),
        ]
    )
    first = np.where(flagged.any(axis=1), flagged.argmax(axis=1) * STEP, np.inf)
    pet, arrival = post_encroachment_time(x, y, heading, walker[0], walker[1], dt=STEP, length=length, width=width)
    return np.append(first, arrival if pet < ENCROACHMENT else np.inf), not np.isnan(pet)
