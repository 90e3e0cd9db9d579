"""Near misses of clips: the CurvTTC of each vehicle with each pedestrian while both are tracked.

The whole joint track of a near miss is stored; `vpsci_ros.data.reference` selects the rows for training.
"""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import polars as pl

from vpsci_ros.data.importers.agreement import require_fixed_frame, require_motion
from vpsci_ros.data.importers.summary import ImportResult, SourceSummary, least_quartiles
from vpsci_ros.data.importers.tracks import FAST, Clip, Floats, Track, median_speed, slope
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS
from vpsci_ros.data.reference import completed, curvttc_of, trailing_slope
from vpsci_ros.documents import counted
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import STEP

LEAST_STEPS = 5  # of a near miss: a slope over 0.4 s, as velocities and yaw rates are, takes so many
BRIEF = f"near misses of fewer than {LEAST_STEPS} steps"  # a count of `SourceSummary.left_out`
LEAST_EXTENT = 1.0  # [m] of a clip: as far apart are the middles of a vehicle and of a pedestrian at least


def near_misses_of(
    source: str,
    clips: Iterable[Clip],
    *,
    length: float,
    width: float,
    fastest: float = math.inf,
) -> ImportResult:
    """Return the near misses of a source, interactions numbered from 0 in order of clip, vehicle and pedestrian.

    :param source: its name, unless the clips say another.
    :param length, width: of vehicles whose tracks and clips do not say [m].
    :param fastest: pedestrians whose median speed exceeds this are left out [m/s], see `Clip.without_faster`.
    :raises InvalidInput: no vehicle at all, no pedestrian, two clips of one name, or of several sources or sizes; or
        see `clips`.
    """
    parts: list[pl.DataFrame] = []
    pairs = vehicles = pedestrians = fast = 0
    left_out: Counter[str] = Counter()
    assumed: dict[str, None] = {}
    names: set[str] = set()
    everybody: list[Track] = []
    size = length, width
    for recorded in clips:
        own = recorded.source or source, recorded.size or size
        if names and own != (source, size):
            raise InvalidInput(
                f"{source}: clip {recorded.name}: expected source {source} and vehicles of {size} m, as others say, "
                f"got {own[0]} and {own[1]} m; give recordings of each a folder of their own"
            )
        source, size = own
        _require_metres(source, recorded)
        require_motion(f"{source}, clip {recorded.name}", recorded)
        if not recorded.fixed:
            everybody += recorded.pedestrians
            require_fixed_frame(f"{source}, clip {recorded.name}", recorded.pedestrians)
        clip = recorded.with_headings().without_faster(fastest)
        if clip.name in names:
            raise InvalidInput(
                f"{source}: two recordings are called {clip.name}; rename one, or give their folders one by one, which "
                "tells clips of one name apart"
            )
        names.add(clip.name)
        fast += sum(median_speed(track) > FAST for track in clip.pedestrians)
        vehicles, pedestrians = vehicles + len(clip.vehicles), pedestrians + len(clip.pedestrians)
        left_out.update(clip.left_out)
        assumed |= dict.fromkeys(clip.assumed)
        for vehicle, pedestrian in _together(clip):
            near_miss = _near_miss(vehicle, pedestrian, *(vehicle.size or size))
            pairs += 1
            if near_miss is not None and near_miss.height < LEAST_STEPS:
                left_out[BRIEF] += 1
            elif near_miss is not None:
                number = pl.lit(len(parts), pl.Int64)
                parts.append(near_miss.with_columns(interaction=number, source=pl.lit(source), clip=pl.lit(clip.name)))
    require_fixed_frame(source, everybody)
    events = any(what.startswith("events") for what in left_out)  # whole pairs, each for a reason of its own
    if names and not (vehicles and pedestrians) and not events:
        others = "; ".join(f"{what}: {count:,}" for what, count in (+left_out).items()) or "nothing"
        what = "vehicle" if not vehicles else "pedestrian"
        raise InvalidInput(
            f"{source}: no {what} in {counted(len(names), 'clip')}; left out: {others}; name the classes as there"
        )
    empty = pl.DataFrame(schema={name: column.dtype for name, column in NEAR_MISS_COLUMNS.items()})
    table = completed(pl.concat(parts)).select(list(NEAR_MISS_COLUMNS)) if parts else empty
    summary = SourceSummary(
        source,
        clips=len(names),
        pairs=pairs,
        near_misses=len(parts),
        steps=table.height,
        critical_steps=table.filter(pl.col("curvttc") < CRITICAL_TTC).height,
        quartiles=least_quartiles(table),
        vehicle_length=size[0],
        vehicle_width=size[1],
        left_out=dict(+left_out),
        assumed=tuple(assumed),
        vehicles=vehicles,
        pedestrians=pedestrians,
        fast=fast,
    )
    return ImportResult(table, (summary,))


def _require_metres(source: str, clip: Clip) -> None:
    """Refuse a clip in which a vehicle and a pedestrian have no room beside each other.

    :raises InvalidInput: names the projection where its positions may be longitudes and latitudes.
    """
    if not clip.vehicles or not clip.pedestrians:
        return
    tracks = [track.values for track in (*clip.vehicles, *clip.pedestrians)]
    x, y = (np.concatenate([values[name] for values in tracks]) for name in ("x", "y"))
    extent = float(np.hypot(np.ptp(x), np.ptp(y)))
    if extent < LEAST_EXTENT:
        zone = f"EPSG:32{'6' if y.mean() >= 0.0 else '7'}{int((x.mean() + 180.0) // 6.0) % 60 + 1:02}"
        raise InvalidInput(
            f"{source}, clip {clip.name}: all road users are within {extent:.2g} of each other: expected positions in "
            "metres; describe the files (--format described) with `metres` of their unit"
            + (f", or project longitude and latitude, to {zone} say" * bool(np.abs((x, y)).max() <= 180.0))
        )


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
            "veh_length": float(length),
            "veh_width": float(width),
            **columns,
            "veh_vx": speed * np.cos(heading),
            "veh_vy": speed * np.sin(heading),
            "curvttc": ttc,
            "distance": np.hypot(columns["veh_x"] - columns["ped_x"], columns["veh_y"] - columns["ped_y"]),
            "curvttc_causal": curvttc_of(columns, along(vehicle, "yaw_rate_causal"), length, width),
        }
    )
