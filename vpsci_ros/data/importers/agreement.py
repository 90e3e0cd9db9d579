"""What recordings say twice: speeds, velocities, headings and sizes, compared with positions and times.

Positions and times are believed. A check judges the road users of one kind in one clip together. If they fail, those
that also fail alone are left out, or all of them where these are most. A message has both numbers, and the unit, rate
or axis that fits. Tables are compared by their layouts, and clips of every importer once more.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.importers.layout_file import ANGLES, HEADINGS, LENGTHS, SPEEDS, Layout
from vpsci_ros.data.importers.tracks import ROLES, Clip, Floats, Track, Verdict, spacing
from vpsci_ros.data.near_misses import TURN_LIMIT
from vpsci_ros.data.reference import WALKER
from vpsci_ros.world.observation import STEP

TOLERANCE = 0.1  # by which speeds and positions may differ (median)
ASKEW = 0.5  # [rad] by which directions may differ from the motion (median)
WINDOW = 0.5  # [s] over which positions say a speed: over a row, their noise would
WALKING = 0.5  # [m/s] above it road users move
HEADED = 1.0  # [m/s] above it the direction of motion says what the heading must be
SIZES = {"length": (1.0, 30.0), "width": (0.4, 5.0)}  # [m] between which the median vehicle is
ALIKE = 2.5  # [m/s] of the mean velocity of pedestrians: nobody walks so fast, but a sensor moves so
FEWEST_ALIKE = 3  # pedestrians whose mean velocity is compared
MOST_APART = 2.0  # factor between speeds and positions of a clip: filtered speeds lag, but a wrong unit is more
LEAST_EXTENT = 1.0  # [m] of a clip: as far apart are the middles of a vehicle and of a pedestrian at least
MOVING_SENSOR = "pedestrians that all move alike, as seen by a moving sensor"
_NEAR = 0.05  # by which a unit may miss the ratio that it explains


def verdict(
    what: str, where: str, rows: pl.DataFrame, fault: Callable[[pl.DataFrame], str], names: Mapping[int, str]
) -> Verdict:
    """Return which road users a check leaves out: those that fail alone, or all where most do or none does alone.

    :param rows: of all road users that the check judges, with their id.
    :param fault: rows -> what is wrong with the road users whose rows they are; "": nothing.
    :param names: id in the recording by number, where they differ.
    """
    numbers = rows["id"].unique(maintain_order=True).to_list()
    text = fault(rows) if numbers else ""
    if not text:
        return Verdict(what, len(numbers))
    odd = [own["id"][0] for own in rows.partition_by("id", maintain_order=True) if fault(own)]
    if not odd or 2 * len(odd) > len(numbers):
        return Verdict(what, len(numbers), numbers, f"{where}: {text}")
    text = fault(rows.filter(pl.col("id") == odd[0]))
    return Verdict(what, len(numbers), odd, f"{where}, road user {names.get(odd[0], odd[0])}: {text}")


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


def checked_table(
    tracks: pl.DataFrame, layout: Layout, whose: str, where: str, names: Mapping[int, str]
) -> tuple[pl.DataFrame, list[Verdict]]:
    """Return the rows of vehicles or pedestrians that agree with themselves, and what checks say of the others.

    :param tracks: id, frame, x, y [m], and those of vx, vy or speed [m/s, null where unknown], heading (as in the
        file), length and width [m, 0 where unknown] that the table has; without them nothing is compared.
    :param whose: of `ROLES`; where, names: see `verdict`.
    """
    verdicts: list[Verdict] = []

    def leave_out(what: str, rows: pl.DataFrame, fault: Callable[[pl.DataFrame, Layout], str]) -> pl.DataFrame:
        verdicts.append(verdict(f"{whose} {what}", where, rows, lambda own: fault(own, layout), names))
        return verdicts[-1].rest(tracks)

    if layout.speeds_agree and {"vx", "speed"} & set(tracks.columns):
        rows = _moving(tracks, layout)
        tracks = leave_out("whose speeds contradict their positions", rows, _speeds)
        if "vx" in tracks.columns:
            tracks = leave_out("whose velocities do not point along their ways", verdicts[-1].rest(rows), _velocities)
    if "heading" in tracks.columns:
        rows = _windows(tracks, layout.rate).filter(pl.col("came") > HEADED)
        tracks = leave_out("whose headings contradict their motion", rows, _headings)
    if "length" in tracks.columns:
        rows = tracks.filter((pl.col("length") > 0.0) & (pl.col("width") > 0.0))
        tracks = leave_out("of a size that no vehicle has", rows, _sizes)
    return tracks, verdicts


def _moving(tracks: pl.DataFrame, layout: Layout) -> pl.DataFrame:
    """Return rows of road users that move, with the speeds [m/s] that they say and that they came with."""
    by_axes = "vx" in tracks.columns
    speed = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt() if by_axes else pl.col("speed").abs()
    ahead = max(1, round(WINDOW / (spacing(tracks, layout.rate) or WINDOW)))
    later = speed.shift(-ahead).over("id").fill_null(speed)
    rows = _windows(tracks.with_columns(said=0.5 * (speed + later)), layout.rate).drop_nulls("said")
    return rows.filter(pl.max_horizontal("came", "said") > WALKING)


def _said_by(rows: pl.DataFrame, layout: Layout) -> str:
    names = ("vx", "vy") if "vx" in rows.columns else ("speed",)
    return " and ".join(layout.columns.get(name, name) for name in names)


def _speeds(rows: pl.DataFrame, layout: Layout) -> str:
    said, came = (float(np.median(rows[name].to_numpy())) for name in ("said", "came"))
    ratio = float(np.median((rows["came"] / rows["said"]).to_numpy()))
    if abs(ratio - 1.0) <= TOLERANCE:
        return ""
    leave = "; or leave the column out: speeds then follow from positions" * layout.described
    return (
        f"column {_said_by(rows, layout)} says {said:.3g} m/s, positions and times say {came:.3g} m/s (medians of "
        f"road users that move), {ratio:.3g} times as much; {_unit(ratio, layout)}{leave}"
    )


def _unit(ratio: float, layout: Layout) -> str:
    """Return the unit that takes speeds to what positions say, or the frame rate that takes positions to the speeds."""
    right = ratio * layout.unit("speed")
    fits = [unit for unit, factor in SPEEDS.items() if abs(right / factor - 1.0) < _NEAR]
    if fits:
        return f"likely in {fits[0]}" + f": `units: {{speed: {fits[0]}}}`" * layout.described
    if not math.isfinite(ratio) or ratio <= 0.0:
        return "the column may hold something else"
    if "frame" in layout.columns:
        rate = layout.frame_rate / ratio
        clock = f"{rate:.4g} frames a second (here {layout.frame_rate:g})"
        clock += f", `frame_rate: {rate:.4g}`" * layout.described
    else:
        unit = layout.time_unit * ratio
        clock = (
            f"`time_unit: {unit:.3g}` (here {layout.time_unit:g})" if layout.described else f"a unit of {unit:.3g} s"
        )
    return f"they fit {clock}" + ", or `units: {speed: ...}` or `metres` is another" * layout.described


def _velocities(rows: pl.DataFrame, layout: Layout) -> str:
    if (apart := _apart(rows, pl.arctan2("vy", "vx"))) <= ASKEW:
        return ""
    return (
        f"column {_said_by(rows, layout)}: velocities point {apart:.2f} rad away from the motion of positions "
        "(median); they may be exchanged, of another sign, or in the axes of the vehicle"
        + "; or leave the columns out"
        * layout.described
    )


def _apart(rows: pl.DataFrame, direction: pl.Expr | pl.Series) -> float:
    """Return the median angle [rad] between the motion of `steps` and a direction."""
    apart = rows.select(off=pl.arctan2("dy", "dx") - direction).to_series().to_numpy()
    return float(np.median(np.abs(np.angle(np.exp(1j * apart)))))


def _headings(rows: pl.DataFrame, layout: Layout) -> str:
    apart = _apart(rows, layout.directions(rows["heading"], layout.angle, layout.heading))
    if apart <= ASKEW:
        return ""
    found = {
        (unit, way): _apart(rows, layout.directions(rows["heading"], factor, way))
        for unit, factor in ANGLES.items()
        for way in HEADINGS
    }
    (unit, way), least = min(found.items(), key=lambda each: each[1])
    own = next((unit for unit, factor in ANGLES.items() if factor == layout.angle), "rad")
    said = f"`units: {{angle: {unit}}}` and `heading: {way}`" if layout.described else f"{unit} {way}"
    leave = "; or leave the column out: headings are then directions of motion" * layout.described
    return (
        f"column {layout.columns['heading']}: headings differ from the direction of motion by {apart:.2f} rad "
        f"(median); expected {own} {layout.heading}; "
        + (f"they fit {said}" if least < ASKEW else "no unit and axis fits them")
        + leave
    )


def _sizes(rows: pl.DataFrame, layout: Layout) -> str:
    size = {name: float(np.median(rows[name].to_numpy())) for name in SIZES}
    if size["width"] <= size["length"] and all(low <= size[name] <= high for name, (low, high) in SIZES.items()):
        return ""
    units = {unit: factor / layout.unit("length") for unit, factor in LENGTHS.items()}
    fits = [
        unit for unit, times in units.items() if 3.0 <= times * size["length"] <= 15.0 and times * size["width"] < 3.0
    ]
    likely = "the columns may be exchanged or others"
    if fits:
        likely = f"likely in {fits[0]}" + f": `units: {{size: {fits[0]}}}`" * layout.described
    return (
        f"columns {layout.columns['length']} and {layout.columns['width']}: the median vehicle is "
        f"{size['length']:.3g} m long and {size['width']:.3g} m wide; {likely}"
    )


def checked(source: str, clip: Clip) -> Clip:
    """Return a clip of any importer without the road users that contradict themselves, see `verdict`."""
    where = f"{source}, clip {clip.name}"
    for role in ROLES:
        clip = clip.without(role, _readable(where, role, getattr(clip, role)))
        tracks: list[Track] = getattr(clip, role)
        names = {track.number: track.name for track in tracks if track.name}
        said, came, apart, numbers = _said_and_came(tracks)
        moves = np.maximum(said, came) > WALKING
        headed = moves & (came > HEADED) & np.isfinite(apart)
        rows = pl.DataFrame({"id": numbers, "said": said, "came": came, "apart": np.abs(apart)})
        for what, own, fault in (
            (f"{role} whose speeds are not those of their positions", moves, _clip_speeds),
            (f"{role} whose directions are not those of their motion", headed, _clip_directions),
        ):
            clip = clip.without(role, verdict(what, where, rows.filter(own), partial(fault, whose=role), names))
    for what, text in (
        ("pedestrians in clips whose positions are no metres", _no_metres(clip)),
        (MOVING_SENSOR, "" if clip.fixed else moving_sensor(clip.pedestrians, described=clip.described)),
    ):
        people = list({track.number for track in clip.pedestrians})
        clip = clip.without("pedestrians", Verdict(what, len(people), people if text else (), f"{where}: {text}"))
    return clip


def _readable(where: str, role: str, tracks: Sequence[Track]) -> Verdict:
    """Return which road users have no finite positions, or headings that jump."""
    odd = []
    for track in tracks:
        values = [track.values[name] for name in ("x", "y", "vx", "vy") if name in track.values]
        jumps = "heading" in track.values and (np.abs(np.diff(track.values["heading"])) >= TURN_LIMIT).any()
        if jumps or not np.isfinite(values).all():
            odd.append(track.number)
    text = f"{where}: road user {odd[0]}: expected finite numbers, and headings in radians, unwrapped" if odd else ""
    return Verdict(f"{role} with values that are not finite, or headings that jump", len(tracks), odd, text)


def _clip_speeds(rows: pl.DataFrame, whose: str) -> str:
    came, said = rows["came"].to_numpy(), rows["said"].to_numpy()
    if 1.0 / MOST_APART <= float(np.median(came / np.maximum(said, 1e-9))) <= MOST_APART:
        return ""
    return (
        f"{whose} say speeds of {np.median(said):.3g} m/s, their positions {np.median(came):.3g} m/s (medians while "
        "they move); check the units of both and the frame rate"
    )


def _clip_directions(rows: pl.DataFrame, whose: str) -> str:
    if (apart := float(np.median(rows["apart"].to_numpy()))) <= ASKEW:
        return ""
    return (
        f"directions of {whose} differ from the motion of their positions by {apart:.2f} rad (median); expected "
        "radians counter-clockwise from x"
    )


def _said_and_came(tracks: Sequence[Track]) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Return said and measured speeds [m/s] over `WINDOW`, angles [rad] between both directions, and whose they are."""
    parts: list[tuple[Floats, Floats, Floats, NDArray[np.int64]]] = [(np.empty(0),) * 3 + (np.empty(0, np.int64),)]
    for track in tracks:
        own, ahead = track.values, min(round(WINDOW / STEP), len(track.values["x"]) - 1)
        if ahead < 1:
            continue
        dx, dy = (own[name][ahead:] - own[name][:-ahead] for name in ("x", "y"))
        if "heading" in own:
            speed, way = own["speed"], own["heading"]
        else:
            speed, way = np.hypot(own["vy"], own["vx"]), np.arctan2(own["vy"], own["vx"])
        apart = np.angle(np.exp(1j * (np.arctan2(dy, dx) - way[:-ahead])))
        said, came = 0.5 * (speed[ahead:] + speed[:-ahead]), np.hypot(dx, dy) / (ahead * STEP)
        parts.append((said, came, apart, np.full(len(dx), track.number)))
    said, came, apart, numbers = (np.concatenate(column) for column in zip(*parts, strict=True))
    return said, came, apart, numbers


def _no_metres(clip: Clip) -> str:
    """Return what is wrong with a clip in which a vehicle and a pedestrian have no room beside each other."""
    if not clip.vehicles or not clip.pedestrians:
        return ""
    tracks = [track.values for track in (*clip.vehicles, *clip.pedestrians)]
    x, y = (np.concatenate([values[name] for values in tracks]) for name in ("x", "y"))
    extent = float(np.hypot(np.ptp(x), np.ptp(y)))
    if extent >= LEAST_EXTENT:
        return ""
    zone = f"EPSG:32{'6' if y.mean() >= 0.0 else '7'}{int((x.mean() + 180.0) // 6.0) % 60 + 1:02}"
    return (
        f"all road users are within {extent:.2g} of each other: expected positions in metres"
        + "; say `metres` of their unit" * clip.described
        + f"; or project longitude and latitude, to {zone} say" * bool(np.abs((x, y)).max() <= 180.0)
    )


def moving_sensor(pedestrians: Sequence[Track], *, described: bool) -> str:
    """Return what is wrong where pedestrians all move alike, faster than they walk; "" where nothing is.

    Of classes that tell cyclists from walkers, walkers alone count: cyclists side by side are no moving sensor.
    """
    long = [t.values for t in pedestrians if len(t.values["x"]) > round(WINDOW / STEP) and t.kind in (WALKER, "")]
    if len(long) < FEWEST_ALIKE:
        return ""
    ways = [[(own[name][-1] - own[name][0]) / (STEP * (len(own["x"]) - 1)) for name in ("x", "y")] for own in long]
    mean = float(np.hypot(*np.mean(ways, axis=0)))
    if mean <= ALIKE:
        return ""
    return (
        f"the mean velocity of {len(long)} pedestrians is {mean:.1f} m/s, as in the frame of a moving sensor; expected "
        "positions in a frame fixed to the ground: add the sensor's own motion"
        + ", or, if they are fixed, say `fixed: true`"
        * described
    )
