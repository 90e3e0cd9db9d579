"""A scenario: the vehicle's lane, the pedestrian's route, and the ranges of the spawn.

A scenario is a YAML file: your own, one of the paper's eight in `params/scenarios/` (the first of them explains each
key), or one of `params/scenarios/town10hd/`. Those of the package are found by number or name. Everything is checked on
reading, and an error names the file and the key.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import read_yaml, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import refuse_unknown
from vpsci_ros.resources import params_dir
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, clearance
from vpsci_ros.world.calibration import WAITING
from vpsci_ros.world.kinematics import MAX_STEERING_ANGLE, WHEELBASE
from vpsci_ros.world.opendrive import expand
from vpsci_ros.world.paths import Path, resample

Points: TypeAlias = NDArray[np.float64]
Interval: TypeAlias = tuple[float, float]

_NEEDED: Any = object()  # in place of a default
_TOP = {"number": _NEEDED, "name": _NEEDED, "location": _NEEDED, "vehicle": _NEEDED, "pedestrian": _NEEDED,
        "description": "", "crosswalk": [], "parked": []}  # fmt: skip
_VEHICLE = {"centreline": _NEEDED, "spawn": _NEEDED, "goal": _NEEDED, "lane_width": 3.5, "throttle": [0.6, 0.9],
            "full_throttle_speed": 6.0, "initial_speed": [0.0, 1.0]}  # fmt: skip
_PEDESTRIAN = {"route": _NEEDED, "goal": _NEEDED, "arrival": _NEEDED, "speed": [1.0, 4.0], "offset": [-0.8, 0.8],
               "standing_room": 1.0, "waiting": WAITING}  # fmt: skip
_PARKED = {"x": _NEEDED, "y": _NEEDED, "heading": 0.0, "length": VEHICLE_LENGTH, "width": VEHICLE_WIDTH}
MOST_PARKED = 32


@dataclass(frozen=True)
class VehicleScenario:
    """The vehicle's lane and goal, and the intervals of its spawn; places are arc lengths of the centreline [m]."""

    path: Path
    lane_width: float  # [m]
    spawn: Interval  # [m] along the centreline
    goal: float  # [m] along the centreline
    throttle: Interval  # 0 to 1, how fast the autopilot drives
    full_throttle_speed: float  # [m/s] the speed that throttle 1 stands for
    initial_speed: Interval  # as a share of the speed that the throttle stands for


@dataclass(frozen=True)
class PedestrianScenario:
    """The pedestrian's route and goal, and the intervals of its spawn; places are arc lengths of the route [m]."""

    path: Path
    goal: float  # [m] along the route: the other side
    speed: Interval  # [m/s]
    arrival: Interval  # [s] at its own speed, from the spawn to where the route crosses the lane
    offset: Interval  # [m] to the left of the route
    standing_room: float  # [m] at the start of the route, over which waiting pedestrians are spread (paper's spawn)
    waiting: float  # share of walkers who stand and set off before it becomes critical (human spawn)
    conflict: float  # [m] along the route, where it crosses the lane's centreline


@dataclass(frozen=True)
class Scenario:
    """The lane of one vehicle, the route of one pedestrian that crosses it, and the ranges of their spawn."""

    number: int
    name: str
    location: str
    description: str
    vehicle: VehicleScenario
    pedestrian: PedestrianScenario
    crosswalk: Points  # float64[K, 2] [m], for pictures; K = 0: not known
    parked: Points  # float64[K, 5]: x, y of the centre [m], heading [rad], length, width [m] of vehicles that stand
    document: Mapping[str, Any] = field(compare=False, repr=False)  # YAML, with coordinates in place of a map
    sha256: str = ""  # of its file and of the map that it names; empty: it was not read from a file


def scenario_files() -> list[FilePath]:
    """Return the files of the paper's scenarios, in the order of their numbers."""
    return list(_own(params_dir() / "scenarios").values())


def further_files() -> list[FilePath]:
    """Return the files of the scenarios beyond the paper's, in the order of their numbers.

    Bags and datasets contain their documents, as they do of your own scenarios; a file of yours may use their numbers.
    """
    return list(_own(params_dir() / "scenarios" / "town10hd").values())


@lru_cache
def _own(folder: FilePath) -> dict[int, FilePath]:
    """Return the scenario files of a folder by their number."""
    found = {}
    for path in folder.glob("*.yaml"):
        document = read_yaml(path)
        number = document.get("number") if isinstance(document, dict) else None
        if type(number) is not int:
            raise InvalidInput(f"{path}: expected a scenario with a whole number, got number {number!r}")
        found[number] = path
    return dict(sorted(found.items()))


def load_scenarios(
    which: Iterable[int | str | FilePath], own: Iterable[str | FilePath | Scenario] = ()
) -> list[Scenario]:
    """Return the scenarios `which`, in that order, each by number, name or path, see `load_scenario`.

    :param own: your own scenarios, or their files; `which` has to contain their numbers.
    :raises InvalidInput: as `load_scenario`; two scenarios with one number; one of `own` that is not in `which`, or has
        the number of one of the paper's.
    """
    which, added = list(which), {scenario.number: scenario for scenario in map(_of_ones_own, own)}
    if left := [scenario for number, scenario in added.items() if number not in which]:
        raise InvalidInput(
            f"scenario_files holds {left[0].name} with number {left[0].number}, but scenarios = {which} does not name "
            f"{left[0].number}; add it there, or leave the file out"
        )
    scenarios = [added[item] if isinstance(item, int) and item in added else load_scenario(item) for item in which]
    by_number: dict[int, Scenario] = {}
    for scenario in scenarios:
        other = by_number.setdefault(scenario.number, scenario)
        if other is not scenario:
            raise InvalidInput(f"scenarios {other.name} and {scenario.name} both have number {scenario.number}")
    return scenarios


def own_documents(scenarios: Iterable[Scenario]) -> dict[str, Any]:
    """Return the documents of the scenarios other than the paper's, as JSON values, by name.

    `scenario_from` makes a bit-identical scenario from each.
    """
    package = _own(params_dir() / "scenarios")
    return {s.name: json.loads(json.dumps(s.document)) for s in scenarios if s.number not in package}


def every_scenario(own: Mapping[str, Any] | None = None, where: str = "") -> list[Scenario]:
    """Return the paper's scenarios and those of `own_documents`; `where` opens error messages.

    :raises InvalidInput: a document is damaged.
    """
    return [*shipped_scenarios(), *own_scenarios(own, where)]


@lru_cache
def shipped_scenarios() -> tuple[Scenario, ...]:
    """Return the paper's scenarios, in the order of their numbers."""
    return tuple(load_scenarios(scenario_files()))


def own_scenarios(own: Mapping[str, Any] | None, where: str = "") -> list[Scenario]:
    """Return the scenarios of `own_documents`; `where` opens error messages.

    :raises InvalidInput: a document is damaged.
    """
    return [scenario_from(document, f"{where}, scenario {name}") for name, document in (own or {}).items()]


def load_scenario(which: int | str | FilePath) -> Scenario:
    """Return a scenario by its number or name (the package's own), or by the path of its YAML file.

    :raises InvalidInput: no such scenario, unreadable YAML, or a key that is missing, unknown or out of range.
    """
    path = _find(which)
    document = read_yaml(path)
    digest = hashlib.sha256(path.read_bytes())
    scenario = scenario_from(document, str(path))
    if "opendrive" in document:
        digest.update((path.parent / document["opendrive"]).read_bytes())
    return replace(scenario, sha256=digest.hexdigest())


def _of_ones_own(item: str | FilePath | Scenario) -> Scenario:
    scenario = item if isinstance(item, Scenario) else load_scenario(item)
    own = _own(params_dir() / "scenarios")
    if scenario.number in own:
        raise InvalidInput(
            f"{scenario.name}: number {scenario.number} is that of the package's own {own[scenario.number].stem}; "
            f"choose one from {max(own) + 1} to 255"
        )
    return scenario


def _find(which: int | str | FilePath) -> FilePath:
    papers, further = (_own(params_dir() / folder) for folder in ("scenarios", "scenarios/town10hd"))
    own = papers | further
    if isinstance(which, int) or (isinstance(which, str) and which.isdigit()):
        if int(which) in own:
            return own[int(which)]
        raise InvalidInput(
            f"scenario {which}: expected a number from 1 to {max(papers)} or {min(further)} to {max(further)}, that of "
            "a file of your own among scenario_files, or the path of a YAML file"
        )
    by_name = {path.stem: path for path in own.values()}
    if str(which) in by_name:
        return by_name[str(which)]
    if FilePath(which).is_file():
        return FilePath(which)
    raise InvalidInput(f"{which}: no such scenario file; the package's own are {', '.join(by_name)}")


def scenario_from(document: Any, where: str) -> Scenario:
    """Return the scenario of a YAML document; `where`, the file's path, opens each message.

    With a key `opendrive`, lane and crosswalk are taken from that map, see `vpsci_ros.world.opendrive.expand`.

    :raises InvalidInput: a key is missing, unknown, of the wrong type or out of range.
    """
    if isinstance(document, dict) and "opendrive" in document:
        document = expand(document, where)
    top = _section(document, _TOP, where)
    number = top["number"]
    if type(number) is not int or not 1 <= number <= 255:
        raise InvalidInput(f"{where}: number must be a whole number from 1 to 255, got {shown(number)}")
    if not re.fullmatch(r"\w[\w.-]*", str(top["name"])):
        raise InvalidInput(
            f"{where}: name becomes that of files: expected letters, digits, '_', '-' and '.', got {top['name']!r}"
        )
    vehicle = _vehicle(_section(top["vehicle"], _VEHICLE, f"{where}, vehicle"), f"{where}, vehicle")
    here = f"{where}, pedestrian"
    pedestrian = _pedestrian(_section(top["pedestrian"], _PEDESTRIAN, here), vehicle.path, here)
    polygon = _points(top["crosswalk"], 3, f"{where}: crosswalk") if top["crosswalk"] else np.zeros((0, 2))
    return Scenario(
        number=number,
        name=str(top["name"]),
        location=str(top["location"]),
        description=str(top["description"]),
        vehicle=vehicle,
        pedestrian=pedestrian,
        crosswalk=polygon,
        parked=_parked(top["parked"], pedestrian, where),
        document=document,
    )


def _vehicle(values: dict[str, Any], where: str) -> VehicleScenario:
    path = resample(_points(values["centreline"], 2, f"{where}: centreline"))
    sharpest, limit = float(np.abs(path.curvature()).max()), math.tan(MAX_STEERING_ANGLE) / WHEELBASE
    if sharpest > 0.9 * limit:
        raise InvalidInput(
            f"{where}: centreline has a bend of radius {1 / sharpest:.1f} m; "
            f"the vehicle needs {1 / (0.9 * limit):.1f} m"
        )
    spawn = _interval(values["spawn"], 0.0, path.length, f"{where}: spawn", "m along the centreline")
    return VehicleScenario(
        path=path,
        lane_width=_number(values["lane_width"], 1.0, 10.0, f"{where}: lane_width", "m"),
        spawn=spawn,
        goal=_number(values["goal"], spawn[1], path.length, f"{where}: goal", "m along the centreline, after spawn"),
        throttle=_interval(values["throttle"], 0.0, 1.0, f"{where}: throttle", ""),
        full_throttle_speed=_number(values["full_throttle_speed"], 0.5, 40.0, f"{where}: full_throttle_speed", "m/s"),
        initial_speed=_interval(values["initial_speed"], 0.0, 1.0, f"{where}: initial_speed", ""),
    )


def _pedestrian(values: dict[str, Any], lane: Path, where: str) -> PedestrianScenario:
    path = resample(_points(values["route"], 2, f"{where}: route"))
    conflict = _crossing(path, lane)
    if conflict is None:
        raise InvalidInput(f"{where}: route does not cross the vehicle's centreline; nothing critical can happen")
    room = _number(
        values["standing_room"], 0.0, conflict, f"{where}: standing_room", "m, up to where the lane is crossed"
    )
    offset = _interval(values["offset"], -5.0, 5.0, f"{where}: offset", "m")
    return PedestrianScenario(
        path=path,
        goal=_number(values["goal"], conflict, path.length, f"{where}: goal", "m along the route, after the lane"),
        speed=_interval(values["speed"], 0.1, 8.0, f"{where}: speed", "m/s"),
        arrival=_interval(values["arrival"], 0.0, 60.0, f"{where}: arrival", "s"),
        offset=offset,
        standing_room=room,
        waiting=_number(values["waiting"], 0.0, 1.0, f"{where}: waiting", "of the walkers"),
        conflict=conflict,
    )


def _parked(values: Any, pedestrian: PedestrianScenario, where: str) -> Points:
    """Return the vehicles that stand, float64[K, 5]; the walking route has to lead around them."""
    if not isinstance(values, list) or len(values) > MOST_PARKED:
        raise InvalidInput(f"{where}: parked must be a list of at most {MOST_PARKED} vehicles, got {values!r}")
    boxes = np.zeros((len(values), 5))
    walk = pedestrian.path.points[: int(pedestrian.goal / pedestrian.path.step) + 1]
    for box, value, here in zip(boxes, values, (f"{where}, parked[{k}]" for k in range(len(values))), strict=True):
        given = _section(value, _PARKED, here)
        box[:2] = [_number(given[name], -1e7, 1e7, f"{here}: {name}", "m") for name in ("x", "y")]
        box[2] = _number(given["heading"], -10.0, 10.0, f"{here}: heading", "rad")
        box[3:] = [_number(given[name], 0.1, 30.0, f"{here}: {name}", "m") for name in ("length", "width")]
        free = clearance(*box[:3], *walk.T, length=box[3], width=box[4])
        if free.min() <= 0.0:
            x, y = walk[int(free.argmin())]
            raise InvalidInput(
                f"{here}: stands in the way of the pedestrian, whose route passes ({x:.1f}, {y:.1f}); move one of them"
            )
    return boxes


def _crossing(route: Path, lane: Path) -> float | None:
    """Return the arc length [m] of `route` at which it first crosses `lane`, or None."""
    p, r = route.points[:-1, None], np.diff(route.points, axis=0)[:, None]
    q, s = lane.points[None, :-1], np.diff(lane.points, axis=0)[None]
    cross = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((q - p)[..., 0] * s[..., 1] - (q - p)[..., 1] * s[..., 0]) / cross
        u = ((q - p)[..., 0] * r[..., 1] - (q - p)[..., 1] * r[..., 0]) / cross
    hits = np.argwhere((t >= 0) & (t <= 1) & (u >= 0) & (u <= 1))
    return None if len(hits) == 0 else float((hits[0, 0] + t[tuple(hits[0])]) * route.step)


def _section(values: Any, defaults: dict[str, Any], where: str) -> dict[str, Any]:
    """Return a section of the file with its defaults, `_NEEDED` where a key has to be there."""
    required = [key for key, default in defaults.items() if default is _NEEDED]
    if not isinstance(values, dict):
        raise InvalidInput(f"{where}: expected a mapping with {', '.join(required)}, got {shown(values)}")
    refuse_unknown(values, defaults, where)
    if missing := [key for key in required if key not in values]:
        raise InvalidInput(f"{where}: missing {', '.join(missing)}; see params/scenarios/LocationA_PedCross_S-N.yaml")
    return defaults | values


def _number(value: Any, low: float, high: float, where: str, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise InvalidInput(
            f"{where} must be a number from {low:g} to {high:g} {unit}, got {shown(value)}".replace(" ,", ",")
        )
    return float(value)


def _interval(value: Any, low: float, high: float, where: str, unit: str) -> Interval:
    if not isinstance(value, list) or len(value) != 2:
        raise InvalidInput(f"{where} must be [least, greatest], got {shown(value)}")
    least, greatest = (_number(v, low, high, where, unit) for v in value)
    if least > greatest:
        raise InvalidInput(f"{where} must be [least, greatest], got {shown(value)}")
    return least, greatest


def _points(value: Any, fewest: int, where: str) -> Points:
    try:
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput(f"{where} must be a list of [x, y] in metres, got {shown(value)}") from None
    if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < fewest or not np.isfinite(points).all():
        raise InvalidInput(f"{where} must be at least {fewest} finite points [x, y] in metres, got {shown(value)}")
    if (np.hypot(*np.diff(points, axis=0).T) < 1e-3).any():
        raise InvalidInput(f"{where} has two points in a row at the same place; remove one")
    return points
