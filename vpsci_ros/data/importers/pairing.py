"""Each vehicle with each pedestrian of a clip: CurvTTC along their joint track, and those that become critical.

The whole joint track of a near miss is kept; `vpsci_ros.data.reference` says which of its rows learning takes.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import polars as pl

from vpsci_ros.data.importers.importer import Clip
from vpsci_ros.data.importers.result import ImportResult, SourceSummary, least_quartiles
from vpsci_ros.data.importers.tracks import Track, slope
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS
from vpsci_ros.data.reference import causal_curvttc, flags, trailing_slope
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC, PEDESTRIAN_RADIUS, curvature_from_yaw_rate, curvttc
from vpsci_ros.world.observation import STEP

LEAST_EXTENT = 1.0  # [m] of a clip: as far apart are the middles of a vehicle and of a pedestrian at least


def near_misses_of(
    source: str, clips: Iterable[Clip], *, length: float, width: float, critical: float = CRITICAL_TTC
) -> ImportResult:
    """Return the near misses of a source, interactions numbered from 0 in order of clip, vehicle and pedestrian.

    :param length, width: of vehicles whose tracks do not say [m].
    :param critical: CurvTTC below which a pair is a near miss [s].
    :raises InvalidInput: no vehicle at all, or no pedestrian; or see `clips`.
    """
    parts: list[pl.DataFrame] = []
    clip_count = pairs = vehicles = pedestrians = 0
    left_out: Counter[str] = Counter()
    assumed: dict[str, None] = {}
    for clip in clips:
        clip_count += 1
        _require_metres(source, clip)
        vehicles, pedestrians = vehicles + len(clip.vehicles), pedestrians + len(clip.pedestrians)
        left_out.update(clip.left_out)
        assumed |= dict.fromkeys(clip.assumed)
        for vehicle, pedestrian in _together(clip):
            near_miss = _near_miss(vehicle, pedestrian, *(vehicle.size or (length, width)), critical)
            pairs += 1
            if near_miss is not None:
                number = pl.lit(len(parts), pl.Int64)
                table = near_miss.with_columns(interaction=number, source=pl.lit(source), clip=pl.lit(clip.name))
                parts.append(table.select(list(NEAR_MISS_COLUMNS)))
    events = any(what.startswith("events") for what in left_out)  # whole pairs, each for a reason of its own
    if clip_count and not (vehicles and pedestrians) and not events:
        others = ", ".join(f"{count:,} {what}" for what, count in (+left_out).items()) or "nothing"
        what = "vehicle" if not vehicles else "pedestrian"
        raise InvalidInput(
            f"{source}: no {what} in {clip_count} clips; left out were {others}; name the classes as there"
        )
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
        vehicle_length=length,
        vehicle_width=width,
        left_out=dict(+left_out),
        assumed=tuple(assumed),
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
            + (f", or, for longitude and latitude, with `projection: {zone}`" * bool(np.abs((x, y)).max() <= 180.0))
        )


def _together(clip: Clip) -> Iterable[tuple[Track, Track]]:
    """Yield each vehicle, with its yaw rates, and each pedestrian that is there at some of its steps."""
    begins, ends = (np.array([getattr(each, end) for each in clip.pedestrians], int) for end in ("first", "last"))
    for vehicle in clip.vehicles:
        together = np.flatnonzero((begins <= vehicle.last) & (ends >= vehicle.first))  # of thousands, a few
        if len(together):
            heading = vehicle.values["heading"]
            rates = {"yaw_rate": slope(heading), "yaw_rate_causal": trailing_slope(heading)}
            turning = replace(vehicle, values=vehicle.values | rates)
            yield from ((turning, clip.pedestrians[number]) for number in together)


def _near_miss(vehicle: Track, pedestrian: Track, length: float, width: float, critical: float) -> pl.DataFrame | None:
    first, last = max(vehicle.first, pedestrian.first), min(vehicle.last, pedestrian.last)
    veh, ped = (
        {name: values[first - track.first : last - track.first + 1] for name, values in track.values.items()}
        for track in (vehicle, pedestrian)
    )
    curvature = curvature_from_yaw_rate(veh["yaw_rate"], veh["speed"])
    ttc = curvttc(
        *(veh["x"], veh["y"], veh["heading"], veh["speed"], curvature),
        *(ped["x"], ped["y"], ped["vx"], ped["vy"]),
        length=length,
        width=width,
        radius=PEDESTRIAN_RADIUS,
    )
    if not (ttc < critical).any():
        return None
    columns = {f"veh_{name}": veh[name] for name in ("x", "y", "heading", "speed")}
    columns["veh_vx"] = veh["speed"] * np.cos(veh["heading"])
    columns["veh_vy"] = veh["speed"] * np.sin(veh["heading"])
    columns |= {f"ped_{name}": ped[name] for name in ("x", "y", "vx", "vy")}
    steps = np.arange(len(ttc))
    return pl.DataFrame(
        {
            "step": steps,
            "time": (first + steps) * STEP,
            "veh_id": np.full(len(ttc), vehicle.number),
            "ped_id": np.full(len(ttc), pedestrian.number),
            **columns,
            "curvttc": ttc,
            "distance": np.hypot(veh["x"] - ped["x"], veh["y"] - ped["y"]),
            "curvttc_causal": causal_curvttc(columns, veh["yaw_rate_causal"], length, width),
        }
    ).with_columns(**{name: pl.lit(value) for name, value in flags(ttc, veh["speed"]).items()})
