"""The ground of an episode: lane, walking route and crosswalk of its scenario."""

from functools import lru_cache
from typing import Any

import numpy as np

from vpsci_ros.world import Scenario, load_scenarios
from vpsci_ros.world.scenario import scenario_files


@lru_cache
def _shipped() -> dict[int, Scenario]:
    return {scenario.number: scenario for scenario in load_scenarios(scenario_files())}


def scenario_name(number: int) -> str:
    """Return the name of a scenario (Table 6), or its number where it is not the package's own."""
    return _shipped()[number].name if number in _shipped() else f"scenario {number}"


def ground(number: int) -> dict[str, Any] | None:
    """Return lane, lane_width, route and crosswalk of one of the package's scenarios [m]; None for another one."""
    scenario = _shipped().get(number)
    if scenario is None:
        return None
    lines = {"lane": scenario.vehicle.path.points[::2], "route": scenario.pedestrian.path.points[::2],
             "crosswalk": scenario.crosswalk}  # fmt: skip
    return {"lane_width": scenario.vehicle.lane_width} | {
        name: np.asarray(points).round(2).tolist() for name, points in lines.items()
    }
