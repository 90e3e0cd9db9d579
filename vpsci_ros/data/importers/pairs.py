"""Near misses of clips: the CurvTTC of each vehicle with each pedestrian while both are tracked.

The whole joint track of a near miss is stored; `vpsci_ros.data.corpus` selects the rows for training.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from vpsci_ros.data.courses import Floats, slope, trailing_slope
from vpsci_ros.data.importers.agreement import MOVING_SENSOR, checked, moving_sensor
from vpsci_ros.data.importers.summary import ImportResult, SourceSummary, least_quartiles, summed
from vpsci_ros.data.importers.tracks import FAST, Clip, LeftOut, Track, median_speed
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS, WALKER, completed, curvttc_of
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC, PEDESTRIAN_RADIUS
from vpsci_ros.world.observation import STEP

LEAST_STEPS = 5  # of a near miss: a slope over 0.4 s, as velocities and yaw rates are, takes so many
BRIEF = f"near misses of fewer than {LEAST_STEPS} steps"  # a count of `SourceSummary.left_out`


def near_misses_of(
    source: str,
    clips: Iterable[Clip],
    *,
    length: float,
    width: float,
    fastest: float = math.inf,
    kinds: Collection[str] = (WALKER,),
    strict: bool = False,
) -> ImportResult:
    """Return the near misses of a source, interactions numbered from 0 in order of clip, vehicle and pedestrian.

    :param source: its name, unless the clips say another.
    :param length, width: of vehicles whose tracks and clips do not say [m].
    :param fastest: pedestrians whose median speed exceeds this are left out [m/s].
    :param kinds: of `KINDS`, those of the pedestrians to import, see `Clip.of_kinds`.
    :param strict: refuse what a check would leave out.
    :raises InvalidInput: two clips of one name, or of several sources or sizes; or see `clips`.
    """
    parts, counts = list[pl.DataFrame](), dict[str, SourceSummary]()
    everybody: list[Track] = []
    size, described = (length, width), False

    def counted(found: Mapping[str, LeftOut]) -> dict[str, LeftOut]:
        if strict and (text := next((own.example for own in found.values() if own.example), "")):
            raise InvalidInput(text)
        return {what: replace(own, odd_clips=int(own.count > 0), clips=1) for what, own in found.items()}

    for recorded in clips:
        own = recorded.source or source, recorded.size or size
        if counts and own != (source, size):
            raise InvalidInput(
                f"{source}: clip {recorded.name}: expected source {source} and vehicles of {size} m, as others say, "
                f"got {own[0]} and {own[1]} m; give recordings of each a folder of their own"
            )
        source, size = own
        if recorded.name in counts:
            raise InvalidInput(
                f"{source}: two recordings are called {recorded.name}; rename one, or give their folders one by one, "
                "which tells clips of one name apart"
            )
        clip = checked(source, recorded)
        everybody += [] if clip.fixed else clip.pedestrians
        described |= clip.described
        clip = clip.with_headings().of_kinds(kinds, fastest)
        left_out, pairs = Counter(clip.left_out), 0
        for vehicle, pedestrian in _together(clip):
            pairs += 1
            near_miss = _near_miss(vehicle, pedestrian, *(vehicle.size or size))
            if near_miss is not None and near_miss.height < LEAST_STEPS:
                left_out[BRIEF] += 1
            elif near_miss is not None:
                number = pl.lit(len(parts), pl.Int64)
                parts.append(near_miss.with_columns(interaction=number, source=pl.lit(source), clip=pl.lit(clip.name)))
        before = sum(own.count for own in recorded.road_users.values()) if recorded.usable else 0
        counts[clip.name] = SourceSummary(
            source,
            clips=1,
            pairs=pairs,
            left_out=left_out,
            assumed=clip.assumed,
            vehicles=len(clip.vehicles),
            pedestrians=len(clip.pedestrians),
            fast=sum(median_speed(track) > FAST for track in clip.pedestrians),
            used=clip.users(),
            unused=before + recorded.users() - clip.users(),
            checks=counted(clip.road_users),
        )
    total = summed([SourceSummary(source, vehicle_length=size[0], vehicle_width=size[1]), *counts.values()])
    if text := moving_sensor(everybody, described=described):
        more = {MOVING_SENSOR: LeftOut(len(everybody), len(everybody), f"{source}: {text}")}
        moving = SourceSummary(source, used=-total.used, unused=total.used, checks=counted(more))
        parts, total = [], summed([total, moving])
    empty = pl.DataFrame(schema={name: column.dtype for name, column in NEAR_MISS_COLUMNS.items()})
    table = completed(pl.concat(parts)).select(list(NEAR_MISS_COLUMNS)) if parts else empty
    of_users = {what: own.count for what, own in total.checks.items() if own.count}
    summary = replace(
        total,
        near_misses=len(parts),
        steps=table.height,
        critical_steps=table.filter(pl.col("curvttc") < CRITICAL_TTC).height,
        quartiles=least_quartiles(table),
        left_out={**total.left_out, **of_users},
        checks={what: own for what, own in total.checks.items() if own.judged or own.example},
    )
    return ImportResult(table, (summary,))


def _together(clip: Clip) -> Iterable[tuple[Track, Track]]:
    """Yield each vehicle, with its yaw rates, and each pedestrian that is there at some of its steps."""
    begins, ends = (np.array([getattr(each, end) for each in clip.pedestrians], int) for end in ("first", "last"))
    order = np.argsort(begins, kind="stable")
    begun, longest = begins[order], int((ends - begins).max(initial=0))
    for vehicle in clip.vehicles:
        near = order[np.searchsorted(begun, vehicle.first - longest) : np.searchsorted(begun, vehicle.last, "right")]
        together = np.sort(near[ends[near] >= vehicle.first])
        if len(together):
            heading = vehicle.values["heading"]
            rates = {"yaw_rate": slope(heading), "yaw_rate_causal": trailing_slope(heading)}
            turning = replace(vehicle, values=vehicle.values | rates)
            yield from ((turning, clip.pedestrians[number]) for number in together)


def _near_miss(vehicle: Track, pedestrian: Track, length: float, width: float) -> pl.DataFrame | None:
    first, last = max(vehicle.first, pedestrian.first), min(vehicle.last, pedestrian.last)

    def along(track: Track, name: str) -> Floats:
        return track.values[name][first - track.first : last - track.first + 1]

    columns = {f"veh_{name}": along(vehicle, name) for name in ("x", "y", "heading", "speed")}
    columns |= {f"ped_{name}": along(pedestrian, name) for name in ("x", "y", "vx", "vy")}
    apart = np.hypot(columns["veh_x"] - columns["ped_x"], columns["veh_y"] - columns["ped_y"])
    reach = CRITICAL_TTC * (columns["veh_speed"] + np.hypot(columns["ped_vx"], columns["ped_vy"]))
    if not (apart < reach + length + width + PEDESTRIAN_RADIUS).any():
        return None  # too far apart to touch within that time, however they turn
    ttc = curvttc_of(columns, along(vehicle, "yaw_rate"), length, width)
    if not (ttc < CRITICAL_TTC).any():
        return None
    steps, heading, speed = np.arange(len(ttc)), columns["veh_heading"], columns["veh_speed"]
    return pl.DataFrame(
        {
            "step": steps,
            "time": (first + steps) * STEP,
            "veh_id": np.full(len(ttc), vehicle.number),
            "ped_id": np.full(len(ttc), pedestrian.number),
            "veh_name": vehicle.name or str(vehicle.number),
            "ped_name": pedestrian.name or str(pedestrian.number),
            "kind": pedestrian.kind,
            "veh_length": float(length),
            "veh_width": float(width),
            **columns,
            "veh_vx": speed * np.cos(heading),
            "veh_vy": speed * np.sin(heading),
            "curvttc": ttc,
            "distance": apart,
            "curvttc_causal": curvttc_of(columns, along(vehicle, "yaw_rate_causal"), length, width),
        }
    )
