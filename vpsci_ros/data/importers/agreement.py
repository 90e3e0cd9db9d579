"""What recordings say twice: speeds, velocities, headings and sizes, compared with positions and times.

Positions and times are believed. A check judges the road users of one kind in one clip together. If they fail, those
that also fail alone are left out, or all of them where these are most. A message has both numbers, and the unit, rate
or axis that fits. Tables are compared by their layouts, and clips of every importer once more.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout_file import ANGLES, HEADINGS, LENGTHS, SPEEDS, Layout
from vpsci_ros.data.importers.tracks import ROLES, Checks, Clip, Track, hypot, spacing
from vpsci_ros.data.near_misses import TURN_LIMIT, WALKER
from vpsci_ros.world.observation import STEP

Names = Mapping[int, str]  # ids in the recording by number, where they differ
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


def _odd(
    checks: Checks, what: str, rows: pl.DataFrame, fault: Callable[[pl.DataFrame], str], where: str, names: Names
) -> Collection[int]:
    """Return, and report, whom a check leaves out: those that fail alone, or all where most do or none does alone.

    :param rows: of all road users that the check judges, with their id.
    :param fault: rows -> what is wrong with the road users whose rows they are; "": nothing.
    """
    numbers = rows["id"].unique(maintain_order=True).to_list()
    text = fault(rows) if numbers else ""
    odd = [own["id"][0] for own in rows.partition_by("id", maintain_order=True) if fault(own)] if text else []
    if 0 < 2 * len(odd) <= len(numbers):
        text = fault(rows.filter(pl.col("id") == odd[0]))
        where = f"{where}, road user {names.get(odd[0], odd[0])}"
    elif text:
        odd = numbers
    return checks.report(what, len(numbers), odd, f"{where}: {text}")


def steps(tracks: pl.DataFrame, rate: float, ahead: int = 1) -> pl.DataFrame:
    """Return rows with what lies between them and the `ahead`th row after: dx, dy, their length way [m], seconds."""
    dx, dy, frames = (pl.col(name).shift(-ahead).over("id") - pl.col(name) for name in ("x", "y", "frame"))
    rows = tracks.with_columns(dx=dx, dy=dy, seconds=frames / rate).drop_nulls(["dx", "dy", "seconds"])
    return rows.with_columns(way=hypot("dx", "dy"))


def said_speed(tracks: pl.DataFrame) -> pl.Expr:
    """Return the speed [m/s] that rows say, by vx and vy or by speed; 0 without them."""
    if "vx" in tracks.columns:
        return hypot("vx", "vy")
    return pl.col("speed").abs() if "speed" in tracks.columns else pl.lit(0.0)


def _windows(tracks: pl.DataFrame, rate: float) -> pl.DataFrame:
    """Return `steps` over about `WINDOW` without gaps, with the speeds [m/s] that they came with and said."""
    apart, speed = spacing(tracks, rate), said_speed(tracks)
    ahead = max(1, round(WINDOW / (apart or WINDOW)))
    tracks = tracks.with_columns(said=0.5 * (speed + speed.shift(-ahead).over("id").fill_null(speed)))
    rows = steps(tracks, rate, ahead)
    if rows.is_empty():
        rows = steps(tracks, rate)
    rows = rows.filter(pl.col("seconds") < 2.0 * max(WINDOW, apart))
    return rows.with_columns(came=pl.col("way") / pl.col("seconds"))


def checked_table(
    tracks: pl.DataFrame, layout: Layout, whose: str, where: str, names: Names, checks: Checks
) -> pl.DataFrame:
    """Return the rows of vehicles or pedestrians that agree with themselves; `checks` counts the others.

    :param tracks: id, frame, x, y [m], and those of vx, vy or speed [m/s, null where unknown], heading (as in the
        file), length and width [m, 0 where unknown] that the table has; without them nothing is compared.
    :param whose, where: the openings of what is counted, and of messages.
    """

    def leave_out(what: str, rows: pl.DataFrame, fault: Callable[[pl.DataFrame, Layout], str]) -> pl.Expr:
        return ~pl.col("id").is_in(_odd(checks, f"{whose} {what}", rows, lambda own: fault(own, layout), where, names))

    rows = _windows(tracks, layout.rate) if {"vx", "speed", "heading"} & set(tracks.columns) else tracks
    if layout.speeds_agree and {"vx", "speed"} & set(tracks.columns):
        moving = rows.drop_nulls("said").filter(pl.max_horizontal("came", "said") > WALKING)
        stay = leave_out("whose speeds contradict their positions", moving, _speeds)
        if "vx" in tracks.columns:
            stay &= leave_out("whose velocities do not point along their ways", moving.filter(stay), _velocities)
        tracks, rows = tracks.filter(stay), rows.filter(stay)
    if "heading" in tracks.columns:
        headed = rows.filter(pl.col("came") > HEADED)
        tracks = tracks.filter(leave_out("whose headings contradict their motion", headed, _headings))
    if "length" in tracks.columns:
        rows = tracks.filter((pl.col("length") > 0.0) & (pl.col("width") > 0.0))
        tracks = tracks.filter(leave_out("of a size that no vehicle has", rows, _sizes))
    return tracks


def _said_by(rows: pl.DataFrame, layout: Layout) -> str:
    return " and ".join(layout.columns[name] for name in ("vx", "vy", "speed") if name in rows.columns)


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
    right, own = ratio * layout.unit("speed"), layout.described
    if fits := [unit for unit, factor in SPEEDS.items() if abs(right / factor - 1.0) < _NEAR]:
        return f"likely in {fits[0]}" + f": `units: {{speed: {fits[0]}}}`" * own
    if not math.isfinite(ratio) or ratio <= 0.0:
        return "the column may hold something else"
    if "frame" in layout.columns:
        rate = layout.frame_rate / ratio
        clock = f"{rate:.4g} frames a second (here {layout.frame_rate:g})" + f", `frame_rate: {rate:.4g}`" * own
    else:
        unit = layout.time_unit * ratio
        clock = f"`time_unit: {unit:.3g}` (here {layout.time_unit:g})" if own else f"a unit of {unit:.3g} s"
    return f"they fit {clock}" + ", or `units: {speed: ...}` or `metres` is another" * own


def _velocities(rows: pl.DataFrame, layout: Layout) -> str:
    if (apart := _apart(rows, pl.arctan2("vy", "vx"))) <= ASKEW:
        return ""
    text = (
        f"column {_said_by(rows, layout)}: velocities point {apart:.2f} rad away from the motion of positions (median)"
    )
    leave = "; or leave the columns out" * layout.described
    return f"{text}; they may be exchanged, of another sign, or in the axes of the vehicle{leave}"


def _apart(rows: pl.DataFrame, direction: pl.Expr | pl.Series) -> float:
    """Return the median angle [rad] between the motion of `steps` and a direction."""
    apart = rows.select(off=pl.arctan2("dy", "dx") - direction).to_series().to_numpy()
    return float(np.median(np.abs(np.angle(np.exp(1j * apart)))))


def _headings(rows: pl.DataFrame, layout: Layout) -> str:
    def apart(unit: float, way: str) -> float:
        return _apart(rows, layout.directions(rows["heading"], unit, way))

    own, described = next(unit for unit, factor in ANGLES.items() if factor == layout.angle), layout.described
    if (off := apart(layout.angle, layout.heading)) <= ASKEW:
        return ""
    least, unit, way = min(
        ((apart(ANGLES[unit], way), unit, way) for unit in ANGLES for way in HEADINGS), key=lambda e: e[0]
    )
    said = f"they fit `units: {{angle: {unit}}}` and `heading: {way}`" if described else f"they fit {unit} {way}"
    return (
        f"column {layout.columns['heading']}: headings differ from the direction of motion by {off:.2f} rad (median); "
        f"expected {own} {layout.heading}; {said if least < ASKEW else 'no unit and axis fits them'}"
        + "; or leave the column out: headings are then directions of motion"
        * described
    )


def _sizes(rows: pl.DataFrame, layout: Layout) -> str:
    length, width = (float(np.median(rows[name].to_numpy())) for name in SIZES)
    (shortest, longest), (narrowest, widest) = SIZES.values()
    if width <= length and shortest <= length <= longest and narrowest <= width <= widest:
        return ""
    units = {unit: factor / layout.unit("length") for unit, factor in LENGTHS.items()}
    fits = [unit for unit, times in units.items() if 3.0 <= times * length <= 15.0 and times * width < 3.0]
    likely = "the columns may be exchanged or others"
    if fits:
        likely = f"likely in {fits[0]}" + f": `units: {{size: {fits[0]}}}`" * layout.described
    return (
        f"columns {layout.columns['length']} and {layout.columns['width']}: the median vehicle is {length:.3g} m long "
        f"and {width:.3g} m wide; {likely}"
    )


def checked(source: str, clip: Clip) -> Clip:
    """Return a clip of any importer without the road users that contradict themselves."""
    where, checks = f"{source}, clip {clip.name}", Checks(clip.road_users)
    vehicles, people = (_checked(role, getattr(clip, role), where, checks) for role in ROLES)
    for what, fault in (
        ("pedestrians in clips whose positions are no metres", partial(_no_metres, vehicles)),
        (MOVING_SENSOR, (lambda _, described: "") if clip.fixed else moving_sensor),
    ):
        text, numbers = fault(people, described=clip.described), {track.number for track in people}
        if checks.report(what, len(numbers), numbers if text else (), f"{where}: {text}"):
            people = []
    return replace(clip, vehicles=vehicles, pedestrians=people, road_users=checks)


def _checked(role: str, tracks: list[Track], where: str, checks: Checks) -> list[Track]:
    """Return the tracks of vehicles or pedestrians that agree with themselves."""
    said = ("heading", "speed") if role == "vehicles" else ("vx", "vy")
    jumps = [role == "vehicles" and (np.abs(np.diff(t.values["heading"])) >= TURN_LIMIT).any() for t in tracks]
    finite = ("x", "y") if role == "vehicles" else ("x", "y", *said)
    finites = [np.isfinite([track.values[name] for name in finite]).all() for track in tracks]
    odd = [t.number for t, jump, right in zip(tracks, jumps, finites, strict=True) if jump or not right]
    text = f"{where}: road user {odd[0]}: expected finite numbers, and headings in radians, unwrapped" if odd else ""
    what = f"{role} with values that are not finite, or headings that jump"
    tracks = _without(tracks, checks.report(what, len(tracks), odd, text))
    if not tracks:
        return tracks
    lengths = [len(track.values["x"]) for track in tracks]
    rows = pl.DataFrame({n: np.concatenate([track.values[n] for track in tracks]) for n in ("x", "y", *said)})
    number = np.repeat([track.number for track in tracks], lengths)
    rows = rows.with_columns(id=np.repeat(np.arange(len(tracks)), lengths), number=number, frame=pl.int_range(pl.len()))
    rows = _windows(rows, 1.0 / STEP).drop("id").rename({"number": "id"})
    rows = rows.filter(pl.max_horizontal("came", "said") > WALKING)
    way = pl.col("heading") if role == "vehicles" else pl.arctan2("vy", "vx")
    headed = rows.with_columns(way=way).filter((pl.col("came") > HEADED) & pl.col("way").is_finite())
    names = {track.number: track.name for track in tracks if track.name}
    for what, own, fault in (
        (f"{role} whose speeds are not those of their positions", rows, _clip_speeds),
        (f"{role} whose directions are not those of their motion", headed, _clip_directions),
    ):
        tracks = _without(tracks, _odd(checks, what, own, partial(fault, whose=role), where, names))
    return tracks


def _without(tracks: list[Track], odd: Collection[int]) -> list[Track]:
    return [track for track in tracks if track.number not in odd] if odd else tracks


def _clip_speeds(rows: pl.DataFrame, whose: str) -> str:
    came, said = rows["came"].to_numpy(), rows["said"].to_numpy()
    text = f"{whose} say speeds of {np.median(said):.3g} m/s, their positions {np.median(came):.3g} m/s"
    agree = 1.0 / MOST_APART <= float(np.median(came / np.maximum(said, 1e-9))) <= MOST_APART
    return "" if agree else f"{text} (medians while they move); check the units of both and the frame rate"


def _clip_directions(rows: pl.DataFrame, whose: str) -> str:
    apart = _apart(rows, pl.col("way"))
    text = f"directions of {whose} differ from the motion of their positions by {apart:.2f} rad (median)"
    return "" if apart <= ASKEW else f"{text}; expected radians counter-clockwise from x"


def _no_metres(vehicles: Sequence[Track], pedestrians: Sequence[Track], *, described: bool) -> str:
    """Return what is wrong with a clip in which a vehicle and a pedestrian have no room beside each other."""
    if not vehicles or not pedestrians:
        return ""
    x, y = (np.concatenate([track.values[name] for track in (*vehicles, *pedestrians)]) for name in ("x", "y"))
    extent = float(np.hypot(np.ptp(x), np.ptp(y)))
    if extent >= LEAST_EXTENT:
        return ""
    zone = f"EPSG:32{'6' if y.mean() >= 0.0 else '7'}{int((x.mean() + 180.0) // 6.0) % 60 + 1:02}"
    return (
        f"all road users are within {extent:.2g} of each other: expected positions in metres"
        + "; say `metres` of their unit" * described
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
