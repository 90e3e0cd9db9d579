"""The world: right turns and straight crossings, simulated in batches of parallel episodes.

A `World` advances a batch of records (`EPISODE`) tick by tick, from `Scenario`s and a `WorldConfig`. `loop.Loop` asks
monitor and agents at each tick; `observe` returns the observations of the agents.

In reading order:

* `world`: the world: a batch of parallel episodes, advanced tick by tick, refilled from a queue as episodes end
* `loop`: the loop over ticks: the world yields a tick, monitor and agents answer, and the world advances
* `tick`: the values of one tick: the world's `Tick`, the monitor's `Assessment` of it, the agents' `Actions`
* `state`: the state of the world: one record for each pair of a vehicle and a pedestrian ("slot"), and event records
* `engine`: one tick of one episode after another: the compiled part of `World.advance`
* `kinematics`: motion from accelerations: equations (8), (9) and (18)-(24), and the kinematic bicycle of the Model 3
* `handover`: hand-over and hand-back: the rule-based pair acts until CurvTTC is critical, then the policies
* `monitor`: the safety monitor's core: CurvTTC of every parallel episode, and which of them are critical
* `observation`: observations of the two agents, equations (6) and (7), in the vehicle's heading frame
* `transition`: the record of one policy step, which the world publishes and the learner learns from
* `scenario`: a scenario: the vehicle's lane, the pedestrian's route, and the ranges of the spawn
* `paths`: lines to follow: the lane's centreline for the vehicle, the walking route for the pedestrian
* `road`: the lane ahead of a vehicle, and the rules by which an episode turns actions into motion, for learners
* `surroundings`: the roads around the shipped scenarios: kerbs and markings of the map that they were taken from
* `opendrive`: routes and crosswalks of an OpenDRIVE map, for scenarios at your own intersection
* `parked`: parked and waiting vehicles: they hide pedestrians, and a vehicle can hit them
* `world_config`: parameters of the world: periods, hand-over, drivers, and how accelerations become motion
* `tables`: scenarios as arrays for compiled code, with padded paths: one row each, and one for the opposite route
* `spawn`: how an episode begins: a pure function of (seed, scenario, episode number) and the pedestrian's number
* `spawns`: the spawns: where vehicle and pedestrians are as an episode begins, a file for each name in `SPAWNS`
* `crowd`: several pedestrians around one vehicle: their number, their relations to the first one, and their spawns
* `kinds`: kinds of pedestrian: walking speed, acceleration when it sets off, and reaction
* `calibration`: recorded distributions at onsets: speeds, accelerations and lines of drivers and walkers
* `counter_rng`: counter-based random numbers: a draw is a function of its key, not of earlier draws
* `drivers`: the drivers, which compute controls from records
* `lane_driving`: driving along a lane: steering, and comfortable speeds
* `recordings`: recorded motion that the replay drivers follow: from a data set, a bag or an earlier run
* `perception`: the pedestrians as a driving system perceives them: a sensor with a view, and a tracker with its errors
* `compiled`: compilation of the world's scalar code, as in `safety.compiled`, for calls at every tick
"""

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
from vpsci_ros.world.world_config import WorldConfig

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
