"""The scenario of a `Pedestrian` or `Driver`: one of this package, or one made from a route in your map."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vpsci_ros.cosim.inputs import GREATEST
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.paths import Path as Way
from vpsci_ros.world.paths import resample
from vpsci_ros.world.scenario import Scenario, load_scenario, scenario_from

NUMBER = 255  # of a scenario made of a route, by which its agents draw
_ACROSS = 30.0  # [m] of the other agent's way, to either side of the middle of the route
SHORTEST = 1.0  # [m]


def named_scenario(scenario: int | str | Path | Scenario) -> Scenario:
    """Return the scenario given by its number, its name, a YAML file, or as a `Scenario`.

    :raises InvalidInput: no such scenario.
    """
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario)


def scenario_of_walk(route: ArrayLike) -> Scenario:
    """Return a scenario whose pedestrian walks a route, float[N, 2] [m], to its end.

    :raises InvalidInput: fewer than two finite points, equal consecutive points, or a way below a metre or above 20 km.
    """
    points, way, across = _middle(route, "route")
    walk = {"route": points, "goal": way.length, "arrival": [1.0, 1.0], "offset": [0.0, 0.0], "waiting": 0.0}
    lane = {"centreline": across, "spawn": [0.0, 1.0], "goal": _end(across)}
    return _made(lane, walk, "route")


def scenario_of_lane(lane: ArrayLike) -> Scenario:
    """Return a scenario whose driver follows a lane's centreline, float[N, 2] [m].

    :raises InvalidInput: as `scenario_of_walk`, or a bend that the vehicle cannot take.
    """
    points, way, across = _middle(lane, "lane")
    walk = {"route": across, "goal": _end(across), "arrival": [1.0, 1.0]}
    return _made({"centreline": points, "spawn": [0.0, 0.0], "goal": way.length}, walk, "lane")


def _middle(points: ArrayLike, what: str) -> tuple[list[list[float]], Way, list[list[float]]]:
    """Return points as a list, the `Path` along them, and the two ends of a straight line across its middle."""
    try:
        array = np.array(points, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.ndim != 2 or array.shape[1] != 2 or len(array) < 2 or not (np.abs(array) <= GREATEST).all():
        raise InvalidInput(f"{what}: expected at least two finite points [x, y] in metres, got {shown(points)}")
    if (np.hypot(*np.diff(array, axis=0).T) < 1e-3).any():
        raise InvalidInput(f"{what}: has two points in a row at the same place; remove one")
    way = resample(array)
    if way.length < SHORTEST:
        raise InvalidInput(f"{what}: expected {SHORTEST:g} m or more, got {way.length:.2f} m")
    half = (len(way.points) // 2 - 0.5) * way.step  # between two samples
    aside = [way.beside(half, side * _ACROSS) for side in (1.0, -1.0)]
    return array.tolist(), way, [list(map(float, point)) for point in aside]


def _end(across: list[list[float]]) -> float:
    """Return the arc length [m] at the end of the other agent's way, which rounding may have shortened a little."""
    return min(2.0 * _ACROSS, resample(np.array(across)).length)


def _made(vehicle: dict[str, Any], pedestrian: dict[str, Any], where: str) -> Scenario:
    document = {"number": NUMBER, "name": where, "location": where, "vehicle": vehicle, "pedestrian": pedestrian}
    return scenario_from(document, where)
