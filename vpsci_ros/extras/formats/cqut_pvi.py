"""CQUT-PVI: cars that turn right while a pedestrian crosses, at two unsignalised corners in Chongqing, from a drone.

Source: Zhang et al., "A Pedestrian Trajectory Prediction Model for Right-Turn Unsignalized Intersections Based on Game
Theory", IEEE T-ITS 2024, doi 10.1109/TITS.2024.3398648 (MIT licence). A file NAME.txt holds events, a row a step, tab
separated, without a header: event, then x, y, speed, acceleration and waiting time of the pedestrian and of the
vehicle, and their distance, which has to be that of the positions; columns after these are not read. Files of corner 1
have a 1 in their names, those of corner 2 a 2. `clips.csv` (file, event, clip, part) says which events share a road
user, and so make one clip, and which part, train or dev, a clip belongs to.

There is no heading, no size and no clock, and what is measured by hand from video is noisy. So the time step of each
event is found from its speeds, positions are smoothed, headings are directions of the way, and events whose motion
does not come out plausible are left out and counted. A clip is called PART/cornerN/CLIP. Its events follow one another
in time, a second apart, in the order of their files: times say nothing about when an event was recorded.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.tracks import Clip, Floats, Importer, LeftOut, Track, read_csv, require_columns
from vpsci_ros.documents import require_regular, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

INDEX = "clips.csv"
PARTS = ("train", "dev")
TIME_STEPS = (0.2, 1.0 / 30.0)  # [s] of six frames, or of one
SPURIOUS_FIRST = ("NCP1_v2", "NCP2_v2")  # files in which the first row of each event has half the speed
CUTOFF = 0.8  # [Hz] above which the smoothing takes motion for noise
RESIDUAL = {"pedestrian": 0.05, "vehicle": 0.06}  # [m] root mean square between measured and smoothed positions
ACCELERATION = 4.5  # [m/s2] of either road user
CHORD = 0.75  # [m] of way before and after a place, between which its heading is the direction
ASSUMED = (
    "headings are directions of the way",
    "vehicles are 4.5 x 1.8 m",
    "times within a clip say nothing about when its events were recorded",
)
_COLUMNS = ("event", *(f"{who}_{what}" for who in RESIDUAL for what in ("x", "y", "speed", "acceleration", "waiting")))
_MOVING = 0.4  # [m/s] above which speeds are compared with positions
_STANDING = 0.1  # [m/s] below which a vehicle makes no way
_STEP_TOLERANCE = 0.1  # by which the time step from positions and speeds may differ
_WAIT_TOLERANCE = 0.2  # by which the median increment of the waiting times may differ
_LONGEST_GAP = 2  # rows without a position that are bridged
_DISTANCE = 0.1  # [m] by which the median distance may differ from that of the positions
_FEWEST = 5  # rows of an event
_SAME = 0.9  # share of equal positions, of both road users, by which two events are the same one
_APART = 10  # steps between two events of a clip


@dataclass(frozen=True)
class _Event:
    """The rows of one event: of each road user positions [T, 2] [m], speeds [m/s] and waiting times [s], float64[T]."""

    file: str
    number: int
    place: dict[str, Floats]
    speed: dict[str, Floats]
    waiting: dict[str, Floats]


class _LeftOut(Exception):
    """An event that is left out, and why."""


def read_folder(folder: Path) -> Iterator[Clip]:
    """Yield the clips of a folder, those of part train first, each part sorted by name.

    :raises InvalidInput: no such folder, no `clips.csv`, a file that it names is missing, an event without a clip or a
        clip's event without rows, or a value that is no number.
    """
    index = _read_index(folder / INDEX)
    events = [event for file in sorted(index["file"].unique()) for event in _read_events(folder / f"{file}.txt")]
    known = {(file, event): number for number, (file, event) in enumerate(index.select("file", "event").rows())}
    found = {(event.file, event.number): event for event in events}
    if odd := sorted(known.keys() ^ found.keys()):
        file, event = odd[0]
        there, missing = (INDEX, f"{file}.txt") if odd[0] in known else (f"{file}.txt", INDEX)
        raise InvalidInput(
            f"{folder}: {len(odd)} events do not have both rows and a clip; the first is event {event} of {file}, "
            f"which {there} has and {missing} has not; take the files and their {INDEX} as they belong together"
        )
    groups = {key: sorted(rows.select("file", "event").rows()) for key, rows in index.group_by("part", "clip")}
    for part, name in sorted(groups, key=lambda key: (PARTS.index(key[0]), key[1])):
        members = [found[key] for key in groups[part, name]]
        unique = [event for i, event in enumerate(members) if not any(_same(event, earlier) for earlier in members[:i])]
        twice = len(members) - len(unique)
        for corner in ("1", "2"):
            own = [event for event in unique if corner in event.file.partition("_")[0]]
            numbers = [known[event.file, event.number] for event in own]
            if own:
                yield _clip(f"{part}/corner{corner}/{name}", own, numbers, twice)
                twice = 0


CQUT_PVI = Importer(read_folder, length=4.5, width=1.8)


def _read_index(path: Path) -> pl.DataFrame:
    if not path.is_file():
        raise InvalidInput(f"{path}: no such file; expected {INDEX} (file, event, clip, part) beside the recordings")
    table = read_csv(path)
    require_columns(table, ("file", "event", "clip", "part"), path)
    odd = table.filter(~pl.col("part").is_in(PARTS))
    if odd.height:
        raise InvalidInput(f"{path}: column part: expected {' or '.join(PARTS)}, got {odd['part'][0]!r}")
    events = table["event"].cast(pl.Int64, strict=False)
    if events.null_count() or table.select("file", "event").is_duplicated().any():
        raise InvalidInput(f"{path}: expected each event of a file, a whole number, once")
    return table.with_columns(events)


def _read_events(path: Path) -> list[_Event]:
    """Return the events of one file, in its order; missing values are NaN."""
    require_regular(path)
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: not readable as text: {error}; take the file as published") from error
    rows: dict[int, list[list[float]]] = {}
    for count, line in enumerate(lines, 1):
        cells = line.split("\t")
        try:
            values = [float(cell) if cell.strip() else np.nan for cell in cells[: len(_COLUMNS) + 1]]
            number = int(cells[0])
        except ValueError:
            values = []
        if len(values) < len(_COLUMNS):
            expected = f"{', '.join(_COLUMNS)}, with tabs between them"
            raise InvalidInput(f"{path}: line {count}: expected {expected}; got {shown(line)}")
        rows.setdefault(number, []).append([*values, np.nan][: len(_COLUMNS) + 1])
    _require_distances(np.array([row for own in rows.values() for row in own]), path)
    events = []
    for number, own in rows.items():
        column = dict(zip(_COLUMNS, np.array(own)[int(path.stem in SPURIOUS_FIRST) :].T, strict=False))
        place = {who: np.stack([column[f"{who}_x"], column[f"{who}_y"]], axis=1) for who in RESIDUAL}
        speed, waiting = ({who: column[f"{who}_{what}"] for who in RESIDUAL} for what in ("speed", "waiting"))
        events.append(_Event(path.stem, number, place, speed, waiting))
    return events


def _require_distances(rows: Floats, path: Path) -> None:
    """Refuse rows whose last column, the distance, is not that of the positions (median)."""
    said = rows[:, -1]
    apart = np.hypot(rows[:, 1] - rows[:, 6], rows[:, 2] - rows[:, 7])
    known = np.isfinite(said - apart)
    if known.any() and (off := float(np.median(np.abs(said - apart)[known]))) > _DISTANCE:
        raise InvalidInput(
            f"{path}: distances differ from those of the positions by {off:.2g} m (median; they say "
            f"{np.median(said[known]):.3g} m, the positions {np.median(apart[known]):.3g} m); expected metres in both"
        )


def _same(one: _Event, other: _Event) -> bool:
    """Return whether two events are the same event, stored twice: most positions, to the centimetre, are equal."""
    for who in RESIDUAL:
        tracks = one.place[who], other.place[who]
        places, theirs = ({tuple(place) for place in np.round(100.0 * track).tolist()} for track in tracks)
        if len(places & theirs) < _SAME * max(min(len(places), len(theirs)), 1):
            return False
    return True


def _clip(name: str, events: list[_Event], numbers: list[int], twice: int) -> Clip:
    vehicles, pedestrians = [], []
    left_out = Counter[str]()
    first = 0
    for event, number in zip(events, numbers, strict=True):
        try:
            vehicle, pedestrian = _tracks(event)
        except _LeftOut as reason:
            left_out[str(reason)] += 1
            continue
        vehicles.append(Track(number, first, vehicle))
        pedestrians.append(Track(number, first, pedestrian))
        first += len(vehicle["x"]) + _APART
    unlike = {reason: LeftOut(count) for reason, count in left_out.items()}
    return Clip(name, vehicles, pedestrians, {"events filed twice": twice}, ASSUMED, road_users=unlike)


def _tracks(event: _Event) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the columns of vehicle and pedestrian at 0.1 s.

    :raises _LeftOut: the event is left out.
    """
    missing = np.stack([~np.isfinite(place).all(axis=1) for place in event.place.values()])
    both = np.flatnonzero(~missing.any(axis=0))
    if len(both) < _FEWEST:
        raise _LeftOut(f"events of fewer than {_FEWEST} rows with both positions")
    rows = slice(both[0], both[-1] + 1)
    if (np.lib.stride_tricks.sliding_window_view(missing[:, rows], _LONGEST_GAP + 1, axis=1).all(axis=2)).any():
        raise _LeftOut(f"events with more than {_LONGEST_GAP} rows in succession without a position")
    step = _time_step(event)
    motion = {}
    for who, limit in RESIDUAL.items():
        smooth, residual = smoothed(event.place[who][rows], step)
        velocity = np.gradient(smooth, STEP, axis=0, edge_order=2)
        if residual > limit:
            raise _LeftOut(f"events with a {who} whose positions are more than {100.0 * limit:g} cm off a smooth way")
        if np.linalg.norm(np.gradient(velocity, STEP, axis=0), axis=1).max() > ACCELERATION:
            raise _LeftOut(f"events with a {who} that accelerates by more than {ACCELERATION:g} m/s2")
        motion[who] = np.concatenate([smooth, velocity], axis=1).T
    x, y, vx, vy = motion["vehicle"]
    heading = way_heading(x, y)
    speed = np.maximum(vx * np.cos(heading) + vy * np.sin(heading), 0.0)
    vehicle = {"x": x, "y": y, "heading": heading, "speed": speed}
    return vehicle, dict(zip(("x", "y", "vx", "vy"), motion["pedestrian"], strict=True))


def _time_step(event: _Event) -> float:
    """Return the one of `TIME_STEPS` [s] by which positions agree with speeds and waiting times, of both road users.

    :raises _LeftOut: there is none.
    """
    found = []
    for who in RESIDUAL:
        way = 0.5 * np.linalg.norm(event.place[who][2:] - event.place[who][:-2], axis=1)
        speed = event.speed[who][1:-1]
        moving = np.isfinite(way) & (speed > _MOVING)
        if moving.any():
            found.append((float(np.median(way[moving] / speed[moving])), _STEP_TOLERANCE))
    waits = np.concatenate([np.diff(waiting) for waiting in event.waiting.values()])
    if (waits > 0.0).any():
        found.append((float(np.median(waits[waits > 0.0])), _WAIT_TOLERANCE))
    for step in TIME_STEPS:
        if found and all(abs(own / step - 1.0) < tolerance for own, tolerance in found):
            return step
    raise _LeftOut("events whose positions, speeds and waiting times have no time step in common")


def smoothed(place: Floats, step: float, cutoff: float = CUTOFF) -> tuple[Floats, float]:
    """Return a smooth path at steps of 0.1 s through measured positions, and its root mean square distance from these.

    The way x minimises the integral of |x - p|^2 + (2 pi `cutoff`)^-6 |x'''|^2 over time, in which p counts where it
    was measured: a penalty on jerk, which keeps constant accelerations.

    :param place: float64[T, 2] [m], `step` [s] apart, NaN where nothing was measured; cutoff: [1/s].
    :returns: float64[S, 2] [m], the first at the first position; root mean square residual [m].
    """
    from scipy.linalg import solveh_banded  # its import is a sixth of that of an exam's worker, which needs none of it

    fine = min(step, STEP)
    every = round(step / fine)
    measured = np.full(((len(place) - 1) * every + 1, 2), np.nan)
    measured[::every] = place
    there = np.isfinite(measured).all(axis=1)
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    weight = (2.0 * np.pi * cutoff) ** -6 / (step * fine**5)
    n = len(measured)
    bands = np.zeros((4, n))  # upper bands of the symmetric system: row 3 is the diagonal
    bands[3] = there
    for i in range(4):
        for j in range(i, 4):
            bands[3 - (j - i), j : n - 3 + j] += weight * third[i] * third[j]
    smooth = solveh_banded(bands, np.where(there[:, None], measured, 0.0))
    residual = float(np.sqrt(np.mean((smooth - measured)[there] ** 2)))
    return smooth[:: round(STEP / fine)], residual


def way_heading(x: Floats, y: Floats) -> Floats:
    """Return headings [rad], unwrapped: the direction from 0.75 m before a position on the path to 0.75 m after it.

    Where the way begins or ends sooner, from or to there. A vehicle that stands keeps its place on the way, and so its
    heading.

    :raises _LeftOut: the whole way is shorter than 0.75 m.
    """
    moved = np.hypot(np.diff(x), np.diff(y))
    way = np.concatenate([[0.0], np.cumsum(np.where(moved > _STANDING * STEP, moved, 0.0))])
    if way[-1] < CHORD:
        raise _LeftOut(f"events with a vehicle that moves less than {CHORD:g} m")
    kept = np.concatenate([[True], np.diff(way) > 0.0])
    (x0, x1), (y0, y1) = ([np.interp(way + side, way[kept], own[kept]) for side in (-CHORD, CHORD)] for own in (x, y))
    heading: Floats = np.unwrap(np.arctan2(y1 - y0, x1 - x0))
    return heading
