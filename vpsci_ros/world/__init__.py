"""The world: right turns and straight crossings, simulated in batches of parallel episodes.

A `World` advances a batch of records (`EPISODE`) tick by tick, from `Scenario`s and a `WorldConfig`. `loop.Loop` asks
monitor and agents at each tick; `observe` returns the observations of the agents.
"""

from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.observation import observe, observe_arrays
from vpsci_ros.world.recordings import Recorded
from vpsci_ros.world.scenario import Scenario, load_scenario, load_scenarios
from vpsci_ros.world.state import (
    COLLISION,
    ENDED,
    EPISODE,
    EVENT,
    GOAL,
    IDLE,
    NONE,
    OUTCOME_NAMES,
    PARKED_COLLISION,
    RUNNING,
    TIMEOUT,
)
from vpsci_ros.world.world import World

__all__ = [
    "COLLISION",
    "ENDED",
    "EPISODE",
    "EVENT",
    "GOAL",
    "IDLE",
    "NONE",
    "OUTCOME_NAMES",
    "PARKED_COLLISION",
    "RUNNING",
    "TIMEOUT",
    "Recorded",
    "Scenario",
    "World",
    "WorldConfig",
    "load_scenario",
    "load_scenarios",
    "observe",
    "observe_arrays",
]
