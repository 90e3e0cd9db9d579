"""Each vehicle with each pedestrian of a clip: CurvTTC along their joint track, and the part of it that is kept.

What is kept runs from up to ten steps before the first critical step (CurvTTC < 5 s) to ten steps after the last one,
as far as both are observed. Ten before, because the closed-loop protocol starts at the first critical step after up to
ten observed ones, and the policies' attention spans ten; ten after, for how people go on when it is over: policies keep
control for a while then (the world's `release_time`). Steps between two critical spells stay: they are part of one
encounter. More would fill the buffer with people who walk undisturbed, and did not help: stage 1 with all 546 pairs
below 10 s and 30 steps after came to the same held-out errors (two folds).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import polars as pl

from vpsci_ros.data.importers.result import ImportResult, SourceSummary, least_quartiles
from vpsci_ros.data.importers.tracks import Floats, Track, slope
from vpsci_ros.data.importers.vci import Clip
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS, STEP
from vpsci_ros.safety import CRITICAL_TTC, PEDESTRIAN_RADIUS, curvature_from_yaw_rate, curvttc

BEFORE = 10  # steps kept before the first critical one
AFTER = 10  # steps kept after the last critical one


def near_misses_of(
    source: str, clips: Iterable[Clip], *, length: float, width: float, critical: float = CRITICAL_TTC
) -> ImportResult:
    """Return the near misses of a source, interactions numbered from 0 in order of clip, vehicle and pedestrian.

    :param length, width: of the source's vehicles [m].
    :param critical: CurvTTC below which a pair is a near miss [s].
    """
    parts: list[pl.DataFrame] = []
    clip_count = pairs = reversing = 0
    for clip in clips:
        clip_count += 1
        reversing += clip.reversing
        for joint in _joint_tracks(clip):
            pairs += 1
            table = _near_miss(joint, length, width, critical)
            if table is not None:
                number = pl.lit(len(parts), pl.Int64)
                table = table.with_columns(interaction=number, source=pl.lit(source), clip=pl.lit(clip.name))
                parts.append(table.select(list(NEAR_MISS_COLUMNS)))
    empty = pl.DataFrame(schema={name: column.dtype for name, column in NEAR_MISS_COLUMNS.items()})
    table = pl.concat(parts) if parts else empty
    summary = SourceSummary(
        source,
        clips=clip_count,
        pairs=pairs,
        near_misses=len(parts),
        steps=table.height,
        critical_steps=table.filter(pl.col("curvttc") < critical).height,
        quartiles=least_quartiles(table),
        reversing=reversing,
        vehicle_length=length,
        vehicle_width=width,
    )
    return ImportResult(table, (summary,))


@dataclass(frozen=True)
class _Joint:
    """The grid steps that a vehicle and a pedestrian have in common."""

    first: int
    vehicle: Track
    pedestrian: Track
    veh: dict[str, Floats]
    ped: dict[str, Floats]


def _joint_tracks(clip: Clip) -> Iterable[_Joint]:
    for vehicle in clip.vehicles:
        values = vehicle.values | {"yaw_rate": slope(vehicle.values["heading"])}
        for pedestrian in clip.pedestrians:
            first, last = max(vehicle.first, pedestrian.first), min(vehicle.last, pedestrian.last)
            if first <= last:
                veh = {k: v[first - vehicle.first : last - vehicle.first + 1] for k, v in values.items()}
                ped = {
                    k: v[first - pedestrian.first : last - pedestrian.first + 1] for k, v in pedestrian.values.items()
                }
                yield _Joint(first, vehicle, pedestrian, veh, ped)


def _near_miss(joint: _Joint, length: float, width: float, critical: float) -> pl.DataFrame | None:
    veh, ped = joint.veh, joint.ped
    curvature = curvature_from_yaw_rate(veh["yaw_rate"], veh["speed"])
    ttc = curvttc(
        *(veh["x"], veh["y"], veh["heading"], veh["speed"], curvature),
        *(ped["x"], ped["y"], ped["vx"], ped["vy"]),
        length=length,
        width=width,
        radius=PEDESTRIAN_RADIUS,
    )
    critical_steps = np.flatnonzero(ttc < critical)
    if len(critical_steps) == 0:
        return None
    begin = max(int(critical_steps[0]) - BEFORE, 0)
    keep = slice(begin, int(critical_steps[-1]) + AFTER + 1)
    time = (joint.first + np.arange(len(ttc))[keep]) * STEP
    return pl.DataFrame(
        {
            "step": np.arange(len(time)),
            "time": time,
            "veh_id": np.full(len(time), joint.vehicle.number),
            "ped_id": np.full(len(time), joint.pedestrian.number),
            "veh_x": veh["x"][keep],
            "veh_y": veh["y"][keep],
            "veh_heading": veh["heading"][keep],
            "veh_speed": veh["speed"][keep],
            "veh_vx": (veh["speed"] * np.cos(veh["heading"]))[keep],
            "veh_vy": (veh["speed"] * np.sin(veh["heading"]))[keep],
            "ped_x": ped["x"][keep],
            "ped_y": ped["y"][keep],
            "ped_vx": ped["vx"][keep],
            "ped_vy": ped["vy"][keep],
            "curvttc": ttc[keep],
            "distance": np.hypot(veh["x"] - ped["x"], veh["y"] - ped["y"])[keep],
        }
    )
