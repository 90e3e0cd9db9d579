"""The scenario of a `Pedestrian` or `Driver` that is made from a route in your map."""

import numpy as np
from numpy.typing import ArrayLike

from vpsci_ros.cosim.inputs import as_points
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.paths import resample
from vpsci_ros.world.scenario import Scenario, scenario_from

NUMBER = 255  # of a scenario made of a route, by which its agents draw
_ACROSS = 30.0  # [m] of the other agent's way, to either side of the middle of the route
SHORTEST = 1.0  # [m]


def scenario_along(given: ArrayLike, what: str) -> Scenario:
    """Return a scenario in which a pedestrian walks a "route", or a driver follows a "lane", to its end.

    :param given: the route, or the lane's centreline, float[N, 2] [m].
    :raises InvalidInput: fewer than two finite points, equal consecutive points, a way below a metre or above 20 km, or
        a bend of a lane that the vehicle cannot take.
    """
    points = as_points(given)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise InvalidInput(f"{what}: expected at least two finite points [x, y] in metres, got {shown(given)}")
    if (np.hypot(*np.diff(points, axis=0).T) < 1e-3).any():
        raise InvalidInput(f"{what}: has two points in a row at the same place; remove one")
    way = resample(points)
    if way.length < SHORTEST:
        raise InvalidInput(f"{what}: expected {SHORTEST:g} m or more, got {way.length:.2f} m")
    half = (len(way.points) // 2 - 0.5) * way.step  # between two samples
    across = [list(map(float, way.beside(half, side * _ACROSS))) for side in (1.0, -1.0)]
    end = min(2.0 * _ACROSS, resample(np.array(across)).length)  # rounding may have shortened it a little
    if what == "route":
        walk = {"route": points.tolist(), "goal": way.length, "offset": [0.0, 0.0], "waiting": 0.0}
        lane = {"centreline": across, "spawn": [0.0, 1.0], "goal": end}
    else:
        walk = {"route": across, "goal": end}
        lane = {"centreline": points.tolist(), "spawn": [0.0, 0.0], "goal": way.length}
    agents = {"vehicle": lane, "pedestrian": {**walk, "arrival": [1.0, 1.0]}}
    return scenario_from({"number": NUMBER, "name": what, "location": what, **agents}, what)
