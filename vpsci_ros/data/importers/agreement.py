"""What recordings say twice: speeds, velocities, headings and sizes, compared with positions and times.

Positions and times are believed. A contradiction is refused with both numbers and the unit, rate or axis that fits.
Tables are compared by their layouts, and clips of every importer once more.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout_file import ANGLES, HEADINGS, LENGTHS, SPEEDS, Layout
from vpsci_ros.data.importers.tracks import Clip, Floats, Track, spacing
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

TOLERANCE = 0.1  # by which speeds and positions may differ (median)
ASKEW = 0.5  # [rad] by which directions may differ from the motion (median)
WINDOW = 0.5  # [s] over which positions say a speed: over a row, their noise would
WALKING = 0.5  # [m/s] above it road users move
HEADED = 1.0  # [m/s] above it the direction of motion says what the heading must be
SIZES = {"length": (1.0, 30.0), "width": (0.4, 5.0)}  # [m] between which the median vehicle is
ALIKE = 2.5  # [m/s] of the mean velocity of pedestrians: nobody walks so fast, but a sensor moves so
MOST_APART = 2.0  # factor between speeds and positions of a clip: filtered speeds lag, but a wrong unit is more
_NEAR = 0.05  # by which a unit may miss the ratio that it explains


def steps(tracks: pl.DataFrame, rate: float, ahead: int = 1) -> pl.DataFrame:
    """Return rows with a row of the road user `ahead` rows later: dx, dy [m] and seconds to it."""
    moved = {f"d{name}": pl.col(name).shift(-ahead).over("id") - pl.col(name) for name in ("x", "y")}
    seconds = (pl.col("frame").shift(-ahead).over("id") - pl.col("frame")) / rate
    return tracks.with_columns(**moved, seconds=seconds).drop_nulls(["dx", "dy", "seconds"])


def _windows(tracks: pl.DataFrame, rate: float) -> pl.DataFrame:
    """Return `steps` over about `WINDOW` without gaps, with came [m/s]."""
    apart = spacing(tracks, rate)
    rows = steps(tracks, rate, max(1, round(WINDOW / apart) if apart else 1))
    if rows.is_empty():
        rows = steps(tracks, rate)
    came = (pl.col("dx") ** 2 + pl.col("dy") ** 2).sqrt() / pl.col("seconds")
    return rows.filter(pl.col("seconds") < 2.0 * max(WINDOW, apart)).with_columns(came=came)


def require_speeds(tracks: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse speeds or velocities that contradict positions and times, whose unit or frame rate is wrong.

    :param tracks: id, frame, x, y [m], and vx, vy or speed [m/s], null where unknown; without them nothing is compared.
    """
    if "vx" in tracks.columns:
        speed, names = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt(), ["vx", "vy"]
    elif "speed" in tracks.columns:
        speed, names = pl.col("speed").abs(), ["speed"]
    else:
        return
    ahead = max(1, round(WINDOW / (spacing(tracks, layout.rate) or WINDOW)))
    later = speed.shift(-ahead).over("id").fill_null(speed)
    rows = _windows(tracks.with_columns(said=0.5 * (speed + later)), layout.rate).drop_nulls("said")
    rows = rows.filter(pl.max_horizontal("came", "said") > WALKING)
    if rows.is_empty():
        return
    columns = " and ".join(layout.columns.get(name, name) for name in names)
    said, came = (float(np.median(rows[name].to_numpy())) for name in ("said", "came"))
    ratio = float(np.median((rows["came"] / rows["said"]).to_numpy()))
    if not abs(ratio - 1.0) <= TOLERANCE:
        raise InvalidInput(
            f"{path}: column {columns} says {said:.3g} m/s, positions and times say {came:.3g} m/s (medians of road "
            f"users that move), {ratio:.3g} times as much; {_unit(ratio, layout)}; or leave the column out: speeds "
            "then follow from positions"
        )
    if "vx" in tracks.columns and (apart := _apart(rows, pl.arctan2("vy", "vx"))) > ASKEW:
        raise InvalidInput(
            f"{path}: column {columns}: velocities point {apart:.2f} rad away from the motion of positions (median); "
            "they may be exchanged, of another sign, or in the axes of the vehicle; or leave the columns out"
        )


def _unit(ratio: float, layout: Layout) -> str:
    """Return the unit that takes speeds to what positions say, or the frame rate that takes positions to the speeds."""
    right = ratio * layout.unit("speed")
    fits = [unit for unit, factor in SPEEDS.items() if abs(right / factor - 1.0) < _NEAR]
    if fits:
        return f"likely in {fits[0]}: `units: {{speed: {fits[0]}}}`"
    if not math.isfinite(ratio) or ratio <= 0.0:
        return "the column may hold something else"
    if "frame" in layout.columns:
        clock = f"{layout.frame_rate / ratio:.4g} frames a second (here {layout.frame_rate:g})"
    else:
        clock = f"`time_unit: {layout.time_unit * ratio:.3g}` (here {layout.time_unit:g})"
    return f"they fit {clock}, or `units: {{speed: ...}}` or `metres` is another"


def _apart(rows: pl.DataFrame, direction: pl.Expr | pl.Series) -> float:
    """Return the median angle [rad] between the motion of `steps` and a direction."""
    apart = rows.select(off=pl.arctan2("dy", "dx") - direction).to_series().to_numpy()
    return float(np.median(np.abs(np.angle(np.exp(1j * apart)))))


def require_headings(cars: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse headings that contradict the direction of motion.

    :param cars: id, frame, x, y [m] and heading as in the file.
    """
    rows = _windows(cars, layout.rate).filter(pl.col("came") > HEADED)
    if rows.is_empty():
        return
    found = {
        (unit, way): _apart(rows, layout.directions(rows["heading"], factor, way))
        for unit, factor in ANGLES.items()
        for way in HEADINGS
    }
    apart = _apart(rows, layout.directions(rows["heading"], layout.angle, layout.heading))
    if apart <= ASKEW:
        return
    (unit, way), least = min(found.items(), key=lambda each: each[1])
    own = next((unit for unit, factor in ANGLES.items() if factor == layout.angle), "rad")
    fits = (
        f"they fit `units: {{angle: {unit}}}` and `heading: {way}`" if least < ASKEW else "no unit and axis fits them"
    )
    raise InvalidInput(
        f"{path}: column {layout.columns['heading']}: headings differ from the direction of motion by {apart:.2f} rad "
        f"(median); expected {own} {layout.heading}; {fits}; or leave the column out: headings are then directions of "
        "motion"
    )


def require_sizes(cars: pl.DataFrame, layout: Layout, path: Path) -> None:
    """Refuse sizes that no vehicle has, as by a wrong unit; 0 is a size that is not known.

    :param cars: length and width [m].
    """
    known = cars.filter((pl.col("length") > 0.0) & (pl.col("width") > 0.0))
    if known.is_empty():
        return
    size = {name: float(np.median(known[name].to_numpy())) for name in SIZES}
    if size["width"] <= size["length"] and all(low <= size[name] <= high for name, (low, high) in SIZES.items()):
        return
    units = {unit: factor / layout.unit("length") for unit, factor in LENGTHS.items()}
    fits = [
        unit for unit, times in units.items() if 3.0 <= times * size["length"] <= 15.0 and times * size["width"] < 3.0
    ]
    likely = f"likely in {fits[0]}: `units: {{size: {fits[0]}}}`" if fits else "the columns may be exchanged or others"
    raise InvalidInput(
        f"{path}: columns {layout.columns['length']} and {layout.columns['width']}: the median vehicle is "
        f"{size['length']:.3g} m long and {size['width']:.3g} m wide; {likely}"
    )


def require_motion(where: str, clip: Clip) -> None:
    """Refuse a clip whose speeds, velocities or headings contradict its positions by more than filters explain.

    :param where: names source and clip, the opening of the error message.
    """
    for whose, tracks in (("vehicles", clip.vehicles), ("pedestrians", clip.pedestrians)):
        rows = [_said_and_came(track) for track in tracks]
        said, came, apart = (np.concatenate([row[i] for row in rows]) if rows else np.empty(0) for i in range(3))
        moves = np.maximum(said, came) > WALKING
        if not moves.any():
            continue
        least, most = np.median(came[moves]), np.median(said[moves])
        if not 1.0 / MOST_APART <= float(np.median(came[moves] / np.maximum(said[moves], 1e-9))) <= MOST_APART:
            raise InvalidInput(
                f"{where}: {whose} say speeds of {most:.3g} m/s, their positions {least:.3g} m/s (medians while they "
                "move); check the units of both and the frame rate"
            )
        headed = (came > HEADED) & np.isfinite(apart)
        if headed.any() and np.median(np.abs(apart[headed])) > ASKEW:
            raise InvalidInput(
                f"{where}: directions of {whose} differ from the motion of their positions by "
                f"{np.median(np.abs(apart[headed])):.2f} rad (median); expected radians counter-clockwise from x"
            )


def _said_and_came(track: Track) -> tuple[Floats, Floats, Floats]:
    """Return said and measured speeds [m/s] over windows of `WINDOW`, and the angles [rad] between both directions."""
    ahead = min(round(WINDOW / STEP), len(track.values["x"]) - 1)
    if ahead < 1:
        return np.empty(0), np.empty(0), np.empty(0)
    dx, dy = (track.values[name][ahead:] - track.values[name][:-ahead] for name in ("x", "y"))
    if "heading" in track.values:
        speed, way = track.values["speed"], track.values["heading"]
    else:
        speed, way = (function(track.values["vy"], track.values["vx"]) for function in (np.hypot, np.arctan2))
    apart = np.angle(np.exp(1j * (np.arctan2(dy, dx) - way[:-ahead])))
    return 0.5 * (speed[ahead:] + speed[:-ahead]), np.hypot(dx, dy) / (ahead * STEP), apart


def require_fixed_frame(where: str, pedestrians: Sequence[Track]) -> None:
    """Refuse positions in which pedestrians all move alike, faster than they walk: those relative to a moving sensor.

    :param where: names source and clip, the opening of the error message.
    """
    long = [track.values for track in pedestrians if len(track.values["x"]) > round(WINDOW / STEP)]
    if len(long) < 3:
        return
    ways = [[(own[name][-1] - own[name][0]) / (STEP * (len(own["x"]) - 1)) for name in ("x", "y")] for own in long]
    mean = np.mean(ways, axis=0)
    if np.hypot(*mean) > ALIKE:
        raise InvalidInput(
            f"{where}: the mean velocity of {len(long)} pedestrians is {np.hypot(*mean):.1f} m/s, as in the frame of "
            "a moving sensor; expected positions in a frame fixed to the ground: add the sensor's own motion, or, if "
            "they are fixed, say `fixed: true` in layout.yaml"
        )
