"""The page that plays episodes, as one HTML file: template, style, script, and the episodes in a compact form.

An episode is a row of JSON, and 16-bit integers in base64. A frame takes 22 bytes, 29 in base64: a thousand episodes of
10 s at 0.05 s come to 6 MB. Positions count from the middle of their episode. Each pedestrian besides the most critical
one takes eight bytes a frame.
"""

import base64
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vpsci_ros.data.episode import YIELDED, Episode, Floats
from vpsci_ros.report import html
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC, Yielded
from vpsci_ros.world import COLLISION, OUTCOME_NAMES, Scenario
from vpsci_ros.world.scenario import shipped_scenarios
from vpsci_ros.world.surroundings import surroundings_of

TEMPLATES = Path(__file__).resolve().parent / "templates"
SCENE = ("data.js", "scene.js")
"""Scripts that draw an episode, for other pages too."""
LIMIT = 1000  # episodes of a source on one page, unless more are requested
UNKNOWN, INFINITE, LARGEST = -32768, 32767, 32766
FINEST = {
    "x": 5e-3,  # [m] centre of the vehicle
    "y": 5e-3,  # [m]
    "heading": 5e-4,  # [rad] counter-clockwise from x, without jumps
    "speed": 1e-3,  # [m/s]
    "curvature": 2e-5,  # [1/m] positive to the left
    "ped_x": 5e-3,  # [m] centre of the pedestrian
    "ped_y": 5e-3,  # [m]
    "ped_vx": 1e-3,  # [m/s]
    "ped_vy": 1e-3,  # [m/s]
    "curvttc": 1e-3,  # [s] infinity where no contact is predicted, NaN where it is not known
    "held": 1.0,  # 1 while the policies control the agents
}
"""Steps by which numbers are kept, in their units; coarser ones where a source's numbers are larger than 32766."""
FIELDS = tuple(FINEST)
_WALK = ("ped_x", "ped_y", "ped_vx", "ped_vy")
OTHER_STEPS = [FINEST[name] for name in _WALK]


class Shown(NamedTuple):
    """An episode on the page, with its most critical pedestrian first.

    :ivar yielded: one of `YIELDED`.
    :ivar marks: filters of the page, such as "hard_braking".
    :ivar failure: group of its failure, in words; empty without a failure.
    """

    episode: Episode
    yielded: str
    marks: tuple[str, ...]
    failure: str = ""


@dataclass(frozen=True)
class Source:
    """The episodes of one source on the page.

    :ivar key: name in links, unique on its page.
    :ivar title: displayed name.
    :ivar period: time from one frame to the next [s].
    :ivar total: number of all episodes; `episodes` may be a part of them.
    :ivar changes: name of another source's episode -> what was changed in it, each a list of episodes of this source by
        the amount: the page has a slider through them.
    """

    key: str
    title: str
    period: float
    episodes: Sequence[Shown]
    total: int
    changes: Mapping[str, Any] = field(default_factory=dict)


def write_view(path: Path, sources: Sequence[Source], title: str) -> int:
    """Write the page, whole or not at all, and return its size in bytes.

    :param sources: at least one, each with an episode, in the order of the page's menu.
    """
    html.write_page(
        path,
        TEMPLATES / "view.html",
        title=title,
        sources=[packed(source) for source in with_unique_keys(sources)],
        grounds=grounds(sources, shipped=True),
        style=inlined("view.css"),
        script=inlined(*SCENE, "charts.js", "list.js", "changes.js", "view.js", "controls.js"),
    )
    return path.stat().st_size


def with_unique_keys(sources: Sequence[Source]) -> list[Source]:
    """Return sources with unique keys; a source with a repeated key gets a number in key and title."""
    seen: Counter[str] = Counter()
    out = []
    for source in sources:
        seen[source.key] += 1
        again = seen[source.key]
        renamed = dataclasses.replace(source, key=f"{source.key}-{again}", title=f"{source.title} {again}")
        out.append(source if again == 1 else renamed)
    return out


def inlined(*names: str) -> str:
    """Return the concatenated text of these files in `templates`."""
    return "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names)


def shown(episode: Episode) -> Shown:
    """Return an episode with who yielded, and with the properties by which the page filters."""
    code, least = episode.yielded(), episode.least_curvttc
    applies = {
        "critical": least < CRITICAL_TTC,
        "conflict": least < CONFLICT_TTC,
        "vehicle_yields": code & Yielded.VEHICLE,
        "pedestrian_yields": code & Yielded.PEDESTRIAN,
    }
    return Shown(episode, YIELDED[code], (*(name for name, does in applies.items() if does), *episode.marks))


def packed(source: Source) -> dict[str, Any]:
    """Return a source as JSON values; its key `frames` is base64 of int16[frames, 11], little-endian.

    An episode with further pedestrians has their number in `others`; the source's `others` is base64 of their
    int16[n * frames, 4] in order, in steps of `other_steps`. The source contains the grounds of your own scenarios.
    """
    groups = sorted({shown.episode.group for shown in source.episodes})
    marks = sorted({mark for shown in source.episodes for mark in shown.marks})
    rows, parts, others = [], [], []
    for episode, yielded, own, failure in source.episodes:
        values, beside = _values(episode)
        middle = _middle(values)
        values[:, (0, 1)] -= middle
        values[:, (5, 6)] -= middle
        values[:, 2] -= 2.0 * np.pi * np.round(values[0, 2] / (2.0 * np.pi))
        parts.append(values)
        others.append((beside - [*middle, 0.0, 0.0]).reshape(-1, 4))
        critical = np.flatnonzero(values[:, FIELDS.index("curvttc")] < CRITICAL_TTC)
        least = episode.least_curvttc
        rows.append(
            {
                "name": episode.name,
                "group": groups.index(episode.group),
                "scenario": episode.key[0],
                "outcome": episode.outcome,
                "yielded": yielded,
                "least": round(least, 3) if np.isfinite(least) else None,
                "onset": int(critical[0]) if len(critical) else None,
                "frames": len(values),
                "middle": middle.round(3).tolist(),
                "size": [float(value) for value in (episode.length, episode.width, episode.radius)],
                "marks": [marks.index(mark) for mark in own],
            }
            | ({"others": len(beside)} if len(beside) else {})
            | ({"impact": round(float(values[-1, 3]), 3)} if episode.outcome == OUTCOME_NAMES[COLLISION] else {})
            | ({"failure": failure} if failure else {})
        )
    steps, frames = _coded(np.concatenate(parts), list(FINEST.values()))
    further = np.concatenate(others)
    if len(further):
        other_steps, other_frames = _coded(further, OTHER_STEPS)
    return {
        "key": source.key,
        "title": source.title,
        "period": source.period,
        "total": source.total,
        "groups": groups,
        "marks": marks,
        "episodes": rows,
        "fields": FIELDS,
        "steps": steps,
        "grounds": grounds([source], shipped=False),
        "frames": frames,
        "changes": dict(source.changes),
    } | ({"other_steps": other_steps, "others": other_frames} if len(further) else {})


def _values(episode: Episode) -> tuple[Floats, Floats]:
    """Return the vehicle and the most critical pedestrian, float64[T, 11], and the others, float64[n - 1, T, 4]."""
    seen, chosen = episode.filled(), episode.most_critical
    walk = np.stack([getattr(seen, name) for name in _WALK], axis=-1)
    vehicle = np.column_stack([seen.x, seen.y, seen.heading, seen.speed, seen.curvature])
    values = np.column_stack([vehicle, walk[chosen], seen.curvttc[chosen], seen.controlled[chosen]])
    return values, np.delete(walk, chosen, axis=0)


def grounds(sources: Sequence[Source], *, shipped: bool) -> dict[int, Any]:
    """Return number -> `ground` of the scenarios of these sources: those of Table 6 if `shipped`, else the others."""
    table_6 = {scenario.number for scenario in shipped_scenarios()}
    used = (shown.episode.scenario for source in sources for shown in source.episodes)
    found = {road.number: road for road in used if road is not None and (road.number in table_6) == shipped}
    return {number: ground(found[number]) for number in sorted(found)}


def ground(scenario: Scenario) -> dict[str, Any]:
    """Return lane, lane_width, route, crosswalk, parked, kerbs and marks of a scenario [m, rad] as JSON values."""
    lines = {"lane": scenario.vehicle.path.points[::2], "route": scenario.pedestrian.path.points[::2],
             "crosswalk": scenario.crosswalk, "parked": scenario.parked}  # fmt: skip
    around = {name: [line.tolist() for line in found] for name, found in surroundings_of(scenario).items()}
    return (
        {"lane_width": scenario.vehicle.lane_width}
        | around
        | {name: np.asarray(points).round(3).tolist() for name, points in lines.items()}
    )


def _middle(values: np.ndarray) -> np.ndarray:
    places = np.concatenate([values[:, 0:2], values[:, 5:7]])
    middle: np.ndarray = ((np.nanmin(places, axis=0) + np.nanmax(places, axis=0)) / 2.0).round(3)
    return middle


def _coded(numbers: Floats, finest: Sequence[float]) -> tuple[list[float], str]:
    """Return the step of each column, and float64[n, columns] in these steps as base64 of int16[n, columns].

    :param finest: step of each column, unless its largest number needs a coarser one.
    """
    finite = np.isfinite(numbers)
    steps = np.maximum(finest, np.where(finite, np.abs(numbers), 0.0).max(axis=0) / LARGEST)
    codes = np.zeros(numbers.shape, "<i2")
    codes[finite] = np.round((numbers / steps)[finite])
    codes[np.isposinf(numbers)] = INFINITE
    codes[np.isnan(numbers) | np.isneginf(numbers)] = UNKNOWN
    return steps.tolist(), base64.b64encode(codes.tobytes()).decode()
