"""The state of the world: one record for each pair of a vehicle and a pedestrian ("slot"), and event records.

An episode of P pedestrians takes P records in a row, one for each pair of its vehicle, which is the same in all of
them, and a pedestrian. With fewer pedestrians than P the last records stay idle.

Records rather than one array per quantity, because every tick reads and writes most fields of a slot: a record lies
in a few cache lines, and `state["vehicle_x"]` still is a view of one quantity over all slots. Fields that are also in
`vpsci_msgs/WorldState` or `vpsci_msgs/EpisodeEvent` have the same names, units and codes there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel

IDLE, RUNNING, ENDED = 0, 1, 2  # status of a slot
NONE, COLLISION, GOAL, TIMEOUT = 0, 1, 2, 3  # outcome of an episode
PARKED_COLLISION = 4  # the vehicle has run into a parked one
OUTCOME_NAMES = ("none", "collision", "goal", "timeout", "parked_collision")

# kinds of event, as in vpsci_msgs/EpisodeEvent
STARTED, HANDED_OVER, HANDED_BACK, FINISHED = 1, 2, 3, 4
VEHICLE_ACTION_MISSING, PEDESTRIAN_ACTION_MISSING, SAFETY_MISSING = 5, 6, 7
SAFE_STOP = 8  # of an external driver in real time; the node that waits for its commands publishes it

_QUANTITIES = (
    # the vehicle: centre of its rectangle, which moves along its heading
    "vehicle_x",  # [m]
    "vehicle_y",  # [m]
    "vehicle_heading",  # [rad] counter-clockwise from x, not wrapped
    "vehicle_speed",  # [m/s] along the heading, never negative
    "vehicle_curvature",  # [1/m] of the path driven in the last tick with motion, positive to the left
    "vehicle_acceleration",  # [m/s2] along the heading, of the last tick
    "steer",  # -1 (full right) to 1 (full left), of the last tick
    "throttle",  # 0 to 1
    "brake",  # 0 to 1
    "route_s",  # [m] along the lane's centreline
    "cruise_throttle",  # the autopilot's drawn speed as a share of `full_throttle_speed`; `paper`: 0.6 to 0.9
    # the pedestrian: centre of its disc
    "pedestrian_x",  # [m]
    "pedestrian_y",  # [m]
    "pedestrian_vx",  # [m/s]
    "pedestrian_vy",  # [m/s]
    "pedestrian_s",  # [m] along the walking route
    "pedestrian_offset",  # [m] to the left of the walking route, drawn at the spawn: where the walker wants to walk
    "walking_speed",  # [m/s] drawn at the spawn
    "start_delay",  # [s] after the spawn before the walker sets off; infinity: a follower whose leader has not yet
    "clock",  # [s] of the pedestrian, less the time since the spawn: 0 unless its head start was set
    "follow_delay",  # [s] after the leader before a follower sets off; 0: no follower
    "reaction_delay",  # [s] after the hand-over before the policy moves the walker; infinity: never
    "pedestrian_ax",  # [m/s2] of the last tick
    "pedestrian_ay",  # [m/s2]
    # how the two approach each other, drawn by the spawns `right_turns` and `human`; see `calibration`
    "meeting_s",  # [m] along the lane's centreline: where the walker's line crosses it
    "approach_acceleration",  # [m/s2] within which the driver keeps its speed, to the meeting
    "approach_phase",  # 0 to 1
    "drive_on",  # [m/s2] with which the driver speeds up
    "stride",  # [m/s2] with which the walker changes its velocity
    "approach_pace",  # of a recorded approach: this car's speed as a share of the recorded one
    "walk_cosine_then",  # of a recorded approach: turns the recorded walk into the world's frame
    "walk_sine_then",
    "lateral_comfort",  # [m/s2] sideways, as much as this driver accepts in the bend
    "lane_sine",  # [m] sway in the lane
    "lane_cosine",  # [m]
    "walking_acceleration",  # [m/s2] within which the walker keeps its speed
    "walking_phase",  # 0 to 1
    "walk_slope",  # [m/m] of the walker's line against the route, to the left
    "walk_sine",  # [m] sway about that line
    "walk_cosine",  # [m]
    # the policies' last actions, in force until the next policy frame, in the heading frame at `action_heading`
    "vehicle_long",  # [m/s2]
    "vehicle_lat",  # [m/s2] to the left
    "pedestrian_long",  # [m/s2]
    "pedestrian_lat",  # [m/s2] to the left
    "action_heading",  # [rad]
    # measures of the episode so far
    "least_curvttc",  # [s]
    "vehicle_path",  # [m] driven since the spawn
    "pedestrian_path",  # [m] walked since the spawn
)
_COUNTS = (
    "episode",  # number of the episode within its scenario
    "frame",  # ticks since the spawn
    "hold",  # ticks for which control is kept without a further critical tick
    "step",  # policy steps taken since the hand-over
    "table",  # row of the world's scenario tables
    "driver_onset",  # 1 + row of `Tables.onsets` whose approach the driver follows; 0: none
    "walker_onset",  # likewise of the walker
    "recording",  # row of the world's recordings, for the replay drivers
    "pedestrians",  # how many the episode has
)
_CODES = (
    "scenario",  # number, 1 to 255; 1 to 8 are the paper's
    "status",  # IDLE, RUNNING, ENDED
    "outcome",  # NONE until the status is ENDED
    "controlled",  # 1: the policies control the agents
    "vehicle_held",  # 1: vehicle_long and vehicle_lat are an answer of the policy
    "pedestrian_held",  # 1: likewise
    "vehicle_goal",  # 1: the vehicle has reached its goal
    "pedestrian_goal",  # 1: the pedestrian has reached its goal
    "pedestrian",  # number within the episode, from 0
    "kind",  # index in `kinds.KINDS`
    "role",  # index in `crowd.ROLES`
    "struck",  # 1: the vehicle has struck this pedestrian
)

EPISODE = np.dtype(
    [(name, "f8") for name in _QUANTITIES] + [(name, "u4") for name in _COUNTS] + [(name, "u1") for name in _CODES],
    align=True,
)

EVENT = np.dtype(
    [
        ("least_curvttc", "f8"),  # [s] up to this frame
        ("vehicle_path", "f8"),  # [m]
        ("pedestrian_path", "f8"),  # [m]
        ("slot", "u4"),
        ("episode", "u4"),
        ("frame", "u4"),
        ("kind", "u1"),
        ("scenario", "u1"),
        ("outcome", "u1"),
    ],
    align=True,
)


NO_EVENTS = np.zeros(0, EVENT)
NO_EVENTS.flags.writeable = False


def list_events(state: NDArray[np.void], bits: NDArray[np.uint16]) -> NDArray[np.void]:
    """Return EVENT[n], in the order of the slots, for EPISODE[B] and uint16[B] of bits 1 << kind."""
    slots = bits.nonzero()[0]
    if not len(slots):
        return NO_EVENTS
    out = np.zeros(_count(bits, slots), EVENT)
    _fill(state, bits, slots, out)
    return out


def concat_events(parts: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Return several EVENT arrays as one, EVENT[n]; as bytes, since numpy copies records field by field."""
    if len(parts) < 2:
        return parts[0] if parts else NO_EVENTS
    return np.concatenate([part.view(np.uint8) for part in parts]).view(EVENT)


@kernel
def _count(bits, slots):  # type: ignore[no-untyped-def]
    count = 0
    for slot in slots:
        for kind in range(1, SAFETY_MISSING + 1):
            count += (bits[slot] >> kind) & 1
    return count


@kernel
def _fill(state, bits, slots, out):  # type: ignore[no-untyped-def]
    n = 0
    for slot in slots:
        for kind in range(1, SAFETY_MISSING + 1):
            if (bits[slot] >> kind) & 1:
                event, episode = out[n], state[slot]
                event.kind, event.slot = kind, slot
                event.scenario, event.episode, event.frame = episode.scenario, episode.episode, episode.frame
                event.outcome = episode.outcome
                event.least_curvttc = episode.least_curvttc
                event.vehicle_path, event.pedestrian_path = episode.vehicle_path, episode.pedestrian_path
                n += 1
