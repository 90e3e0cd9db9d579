"""The times at which an exam's pedestrians set out: for the driving system's own approach.

An episode is drawn so that its own driver, the autopilot, and a pedestrian become critical: at the onset they would
touch if both went on unchanged. A system with another speed would pass before or after the pedestrian. So the system
drives the empty road first, and the pedestrian gets a head start, or sets out later: the two touch if neither reacts,
and the pedestrian is as early or late as it was at the onset, as a share of the span in which they touch at all. Euro
NCAP's targets set off by the approach of the car under test, too.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ADS, OWN_TIMING, Exam, title_of
from vpsci_ros.exam.recorded_people import FAR
from vpsci_ros.lockstep.intervention import HeadStarts
from vpsci_ros.runs.files import write_json
from vpsci_ros.safety import HORIZON, clearance
from vpsci_ros.world import IDLE, Recorded, World, WorldConfig
from vpsci_ros.world.loop import Loop

Floats = NDArray[np.float64]
TIMING = "timing.json"
BOUND = 0.25  # [s] between the head starts for two systems, within which both get that of the earlier exam
MOST_MISSED = 0.05  # share of episodes that are not timed, or avoided by hurrying, above which an exam is not passed
HURRY = 1.0  # [s] before its time on the empty road, from which on a system hurries
_REACH = 3.0  # [m] between the middles of car and pedestrian, more than where they touch
_SIDE_BY_SIDE = 256
_LARGEST_ARC = 0.5 * math.pi  # [rad] as that of CurvTTC


class Encounter(NamedTuple):
    """The walk of a drawn pedestrian that does not react, and how early it is for the car.

    :ivar walk: float64[T, 2], its places at each tick [m], in the map frame.
    :ivar share: 0: the pedestrian is so late that it would just touch the car; 1: so early.
    :ivar onset: EPISODE record of the pair at its onset; None: the autopilot has none.
    """

    walk: Floats
    share: float = 0.5
    onset: np.void | None = None


class Timed(NamedTuple):
    """The timing of one episode.

    :ivar head_start: time [s] by which the pedestrians are ahead of the drawn ones as the episode begins.
    :ivar straight: time [s] for which they have walked straight on since.
    :ivar of: whose drive set it: "own", "baseline" (the earlier exam's), or "" (not timed: as drawn).
    :ivar time, way: of the system on the empty road, where it would touch the pedestrian [s], [m] driven; NaN: nowhere.
    """

    head_start: float = 0.0
    straight: float = 0.0
    of: str = ""
    time: float = math.nan
    way: float = math.nan

    @property
    def ahead(self) -> float:
        """Both times together [s]."""
        return self.head_start + self.straight


Timing = Mapping[Key, Timed]


def timing_of(exam: Exam, alone: Sequence[Episode], folder: Path, against: Path | None = None) -> Timing:
    """Return the timing of an exam's episodes, which is stored in its folder; a stored one is read.

    :param alone: the system's episodes on the empty road.
    :param against: folder of an earlier exam, whose head starts are taken where they differ by less than `BOUND`.
    :raises InvalidInput: a stored timing cannot be read, or is of other episodes.
    """
    if stored := read_timing(folder):
        if set(stored) != set(exam.episodes):
            raise InvalidInput(f"{folder / TIMING}: of other episodes than this exam's; choose another output folder")
        return stored
    earlier = {} if against is None else read_timing(against)
    drives, met = {episode.key: episode for episode in alone}, encounters(exam)
    timing = {}
    for key in exam.episodes:
        timed = _timed(met[key], drives[key], exam.world.tick) if key in drives else Timed()
        before = earlier.get(key)
        if before and before.of and timed.of and abs(before.ahead - timed.ahead) < BOUND:
            timed = timed._replace(head_start=before.head_start, straight=before.straight, of="baseline")
        timing[key] = timed
    rows = [[*key, *timed] for key, timed in timing.items()]
    write_json(folder / TIMING, {"columns": ["scenario", "episode", *Timed._fields], "episodes": rows})
    return timing


def read_timing(folder: Path) -> Timing:
    """Return the timing of the exam in `folder`; empty if the exam has none.

    :raises InvalidInput: it cannot be read.
    """
    path = folder / TIMING
    if not path.is_file():
        return {}
    stored = read_json(path)
    require_form(stored, {"episodes": list}, f"{path}: not what an exam writes")
    try:
        return {(int(s), int(e)): Timed(float(start), float(straight), str(of), float(time), float(way))
                for s, e, start, straight, of, time, way in stored["episodes"]}  # fmt: skip
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: not what an exam writes ({error}); choose another output folder") from None


def encounters(exam: Exam) -> dict[Key, Encounter]:
    """Return the encounter of each episode: with the pedestrian that becomes critical first when the autopilot drives.

    Without an onset it is the first pedestrian, in the middle of the span.
    """
    config, keys = exam.with_pedestrian("walker", "autopilot"), exam.episodes
    found: dict[Key, Encounter] = {}
    for begin in range(0, len(keys), _SIDE_BY_SIDE):
        part = keys[begin : begin + _SIDE_BY_SIDE]
        onsets: dict[Key, np.void] = {}
        for step in Loop(World(config, exam.scenarios, part, len(part), exam.run.seed)):
            for record in step.state[step.assessment.critical]:
                onsets.setdefault(key_of(record), record.copy())
            if len(onsets) == len(part):
                break
        for key, walks in _walks(exam, config, part).items():
            found[key] = Encounter(walks[:, 0])
            if (onset := onsets.get(key)) is not None:
                starts, _ = _predicted(onset, _car(onset), exam.world.tick)
                found[key] = Encounter(walks[:, onset["pedestrian"]], _share(starts), onset)
    return found


def key_of(record: np.void) -> Key:
    """Return the (scenario, episode) of an EPISODE record."""
    return int(record["scenario"]), int(record["episode"])


def _walks(exam: Exam, config: WorldConfig, keys: Sequence[Key]) -> dict[Key, Floats]:
    """Return the walkers' places in each episode, float64[T, P, 2] [m], with the car a kilometre away."""
    away = (np.array([[FAR, FAR, 0.0, 0.0, 0.0]]), np.zeros((1, 4)))
    world = World(
        dataclasses.replace(config, vehicle_driver="replay"), exam.scenarios, keys, len(keys), exam.run.seed,
        Recorded(dict.fromkeys(keys, away)),
    )  # fmt: skip
    places: dict[Key, list[Floats]] = {key: [] for key in keys}
    for step in Loop(world):
        pairs = np.stack([step.state["pedestrian_x"], step.state["pedestrian_y"]], axis=1)
        for first in np.flatnonzero((step.state["status"] != IDLE) & (step.state["pedestrian"] == 0)).tolist():
            places[key_of(step.state[first])].append(pairs[first : first + config.pedestrians])
    return {key: np.stack(found) for key, found in places.items()}


def _share(starts: Floats) -> float:
    """Return where head start 0 is in the span of `starts`, 0 to 1; see `Encounter`."""
    wide = len(starts) > 0 and starts.max() > starts.min()
    return float(np.clip(-starts.min() / (starts.max() - starts.min()), 0.0, 1.0)) if wide else 0.5


def _car(record: np.void) -> list[float]:
    """Return x, y [m], heading [rad], speed [m/s] and curvature [1/m] of the vehicle of an EPISODE record."""
    return [float(record[f"vehicle_{name}"]) for name in ("x", "y", "heading", "speed", "curvature")]


def _predicted(onset: np.void, car: Sequence[float], tick: float) -> tuple[Floats, NDArray[np.int64]]:
    """Return the `contacts` of a car that goes on unchanged and a pedestrian that goes on as at its onset."""
    around = np.arange(-HORIZON, 2.0 * HORIZON, tick)
    place = np.array([onset["pedestrian_x"], onset["pedestrian_y"]])
    walk = place + np.array([onset["pedestrian_vx"], onset["pedestrian_vy"]]) * around[:, None]
    return contacts(*_unchanged(car, tick), walk, around)


def _unchanged(car: Sequence[float], tick: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return places [m], headings [rad] and times [s] of a `_car` that keeps speed and curvature, float64[T] each."""
    x, y, heading, speed, curvature = car
    ahead = np.arange(0.0, HORIZON, tick)
    headings = heading + math.copysign(1.0, curvature) * np.minimum(abs(curvature) * speed * ahead, _LARGEST_ARC)
    way = [np.concatenate([[0.0], np.cumsum(speed * tick * part(headings[:-1]))]) for part in (np.cos, np.sin)]
    return x + way[0], y + way[1], headings, ahead


def contacts(
    x: Floats, y: Floats, heading: Floats, time: Floats, walk: Floats, clock: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the head starts [s] with which car and pedestrian touch, float64[n], and the car's frame then, int64[n].

    :param x, y, heading, time: float64[T] [m], [rad], [s] of the car.
    :param walk: float64[S, 2] [m], places of the pedestrian; `clock` float64[S] [s].
    """
    cars, walkers = np.stack([x, y], axis=1), np.arange(len(walk))
    frames = np.arange(len(x))
    for _ in range(2):  # pairs that are far from each other need no exact look
        low, high = walk[walkers].min(axis=0) - _REACH, walk[walkers].max(axis=0) + _REACH
        frames = frames[((cars[frames] >= low) & (cars[frames] <= high)).all(axis=1)]
        if not len(frames):
            return np.empty(0), np.empty(0, np.int64)
        low, high = cars[frames].min(axis=0) - _REACH, cars[frames].max(axis=0) + _REACH
        walkers = walkers[((walk[walkers] >= low) & (walk[walkers] <= high)).all(axis=1)]
        if not len(walkers):
            return np.empty(0), np.empty(0, np.int64)
    at = frames[:, None]
    touch, who = np.nonzero(clearance(x[at], y[at], heading[at], walk[walkers, 0], walk[walkers, 1]) <= 0.0)
    return clock[walkers][who] - time[frames][touch], frames[touch]


def _timed(met: Encounter, alone: Episode, tick: float) -> Timed:
    """Return the timing of one episode by a drive on the empty road.

    A walker that turns away after the onset touches nobody who keeps the lane. Then the onset alone is timed: as the
    system comes to its place, with its own speed and curvature there, both would touch if they went on unchanged.
    """
    drive, time = alone.filled(), alone.time
    clock: Floats = tick * np.arange(len(met.walk), dtype=np.float64)
    starts, frames = contacts(drive.x, drive.y, drive.heading, time, met.walk, clock)
    if len(starts):
        start = tick * round(_within(starts, met.share) / tick)
        at = int(frames[np.abs(starts - start).argmin()])
        return Timed(start, 0.0, OWN_TIMING, float(time[at]), float(drive.path[at]))
    if met.onset is None:
        return Timed()
    away = np.hypot(drive.x - met.onset["vehicle_x"], drive.y - met.onset["vehicle_y"])
    at = int(away.argmin())
    car = [float(values[at]) for values in (drive.x, drive.y, drive.heading, drive.speed, drive.curvature)]
    starts, _ = _predicted(met.onset, car, tick)
    if away[at] > _REACH or not len(starts):
        return Timed()
    onset = int(met.onset["frame"]) * tick
    start = tick * round((onset + _within(starts, min(0.75, max(0.25, met.share))) - time[at]) / tick)
    return Timed(min(start, onset), max(0.0, start - onset), OWN_TIMING, float(time[at]), float(drive.path[at]))


def _within(starts: Floats, share: float) -> float:
    return float(starts.min() + share * (starts.max() - starts.min()))


def head_starts(timing: Timing) -> HeadStarts:
    """Return the head starts of a timing, see `HeadStarts`."""
    return {key: (timed.head_start, timed.straight) for key, timed in timing.items()}


def summary(timing: Timing, table: pl.DataFrame) -> dict[str, Any]:
    """Return, as JSON values, whose approach set the times of how many episodes, and which the system did not meet.

    :param table: a row an episode, see `vpsci_ros.exam.measures`.
    """
    avoided = pl.col("hurried").is_not_nan() & (pl.col("hurried") > HURRY) & ~pl.col("critical")
    return {
        "episodes": len(timing),
        **{of: sum(timed.of == of for timed in timing.values()) for of in (OWN_TIMING, "baseline")},
        "untimed": [f"{scenario}:{episode}" for (scenario, episode), timed in timing.items() if not timed.of],
        "hurried": dict(sorted(table.filter(avoided).group_by("pedestrian").len().rows())),
    }


def not_met(report: Mapping[str, Any]) -> list[str]:
    """Return, in words, the encounters of a report that the system did not meet as timed, where these are too many."""
    found = report["timing"]
    if found is None:
        return []
    untimed, of = len(found["untimed"]), found["episodes"]
    reasons = []
    if untimed > MOST_MISSED * of:
        reasons.append(
            f"{untimed} of {of} episodes could not be timed to the system, which alone does not come to the "
            "pedestrian's way, or did not drive to the end; they show nothing"
        )
    return reasons + [
        f"in {count} of {of} episodes with the {title_of(name)} the system came more than {HURRY:g} s earlier than on "
        "the empty road, and nothing became critical: it drives otherwise where somebody is, and these show nothing"
        for name, count in found["hurried"].items()
        if count > MOST_MISSED * of
    ]


def sentence(report: Mapping[str, Any]) -> str:
    """Return in words whose approach the pedestrians of a report's exam are timed to."""
    found = report.get("timing")
    if found is None and not report["drivers"].get(ADS):
        return "The system drove no episode with a pedestrian."
    if found is None:
        return "The pedestrians are timed to the autopilot's approach."
    of, same, untimed = found["episodes"], found["baseline"], len(found["untimed"])
    text = f"The pedestrians are timed to the system's own approach in {found[OWN_TIMING]} of {of} episodes"
    text += f", to that of the earlier exam's system, which differs by less than {BOUND:g} s, in {same}" if same else ""
    return f"{text}; {untimed} could not be timed and are as drawn." if untimed else f"{text}."
