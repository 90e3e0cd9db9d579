"""The ground of an episode: lane, walking route and crosswalk of its scenario."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from vpsci_ros.world import Scenario, load_scenarios
from vpsci_ros.world.scenario import scenario_files


@lru_cache
def shipped() -> dict[int, Scenario]:
    """Return the scenarios of Table 6 by their numbers."""
    return {scenario.number: scenario for scenario in load_scenarios(scenario_files())}


def scenario_names(own: Iterable[Scenario] = ()) -> dict[int, str]:
    """Return the names of the scenarios of Table 6, and of one's own, by their numbers."""
    return {scenario.number: scenario.name for scenario in (*shipped().values(), *own)}


def ground(scenario: Scenario) -> dict[str, Any]:
    """Return lane, lane_width, route, crosswalk and parked vehicles of a scenario [m, rad] as JSON values."""
    lines = {"lane": scenario.vehicle.path.points[::2], "route": scenario.pedestrian.path.points[::2],
             "crosswalk": scenario.crosswalk, "parked": scenario.parked}  # fmt: skip
    return {"lane_width": scenario.vehicle.lane_width} | {
        name: np.asarray(points).round(3).tolist() for name, points in lines.items()
    }
