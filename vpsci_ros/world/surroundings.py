"""The roads around the shipped scenarios: kerbs and markings of the map that they were taken from, for pictures."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import read_json
from vpsci_ros.resources import params_dir
from vpsci_ros.world.scenario import Scenario

Lines = list[NDArray[np.float64]]


def surroundings_of(scenario: Scenario) -> dict[str, Lines]:
    """Return "kerbs" and "marks" around a scenario, lines float64[N, 2] [m]; empty for one that is not the package's.

    Kerbs are closed: the outer one of all roads, then those of blocks and islands in it. Marks are between lanes.
    """
    names, lines = _town()
    return lines if scenario.name in names else {name: [] for name in lines}


@lru_cache
def _town() -> tuple[list[str], dict[str, Lines]]:
    found = read_json(params_dir() / "scenarios" / "roads.json")
    return found["scenarios"], {name: [np.array(line) for line in found[name]] for name in ("kerbs", "marks")}
