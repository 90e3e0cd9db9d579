"""The world: eight right turns at two intersections, simulated in batches of parallel episodes.

A scenario (`scenario`, YAML in `params/scenarios/`) says where vehicle and pedestrian go and what is drawn at a spawn
(`spawn`, with the counter-based numbers of `counter_rng`). `world.World` advances a batch of records (`state`) tick by
tick: `handover` decides who drives, `drivers` and `autopilot` what they do, `kinematics` what comes of it, `engine`
runs that over the slots. `observation` is what the agents see of it, `monitor` how near a collision is. `loop` has
monitor and agents answer each tick, by the values of `tick`; where the answers come as messages, `lockstep` gathers
them, and `safe_stop` those of an external driving system.
"""

from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.observation import observe, observe_arrays
from vpsci_ros.world.recording import Recorded
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
