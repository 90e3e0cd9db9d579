"""Observation, action and reward of the right-turn environment.

Observation, float32[21], in SI units and the vehicle's heading frame (forward, left):

| entries | content                                                                 |
|---------|-------------------------------------------------------------------------|
| 0-2     | speed, acceleration, path curvature                                     |
| 3, 4    | distance to the left of the lane's centre, heading relative to the lane |
| 5       | distance to the goal along the lane                                     |
| 6-15    | lane centre 2, 4, 7, 11 and 16 m ahead, (forward, left) each            |
| 16-19   | pedestrian's position and velocity, (forward, left) each                |
| 20      | CurvTTC, at most 10 s                                                   |

A pedestrian more than 50 m away is observed 50 m away in its direction. On an exam's empty road it is 1000 m
away, which no training shows.

Action, float32[2] in -1..1: steer (positive to the left), and throttle where positive, brake where negative.

Reward of a step: 0.1 for each metre of progress along the lane, less 0.02 for each square metre of the squared lateral
distance; 10 at the goal; -10 at a collision, or more than 3.5 m beside the lane's centre.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import COLLISION, PARKED_COLLISION, TIMEOUT
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import point_at, project
from vpsci_ros.world.tables import Tables

PREVIEW = (2.0, 4.0, 7.0, 11.0, 16.0)  # [m]
SIZE = 21
HORIZON = 10.0  # [s] stands for an infinite CurvTTC
BOUND = 500.0  # no entry of an observation is larger
SIGHT = 50.0  # [m] at most, at which a pedestrian is observed
OFF_LANE = 3.5  # [m]
PROGRESS, LATERAL, AT_GOAL, AT_FAILURE = 0.1, 0.02, 10.0, -10.0


def observe(state: NDArray[np.void], curvttc: NDArray[np.float64], tables: Tables) -> NDArray[np.float32]:
    """Return the observations float32[B, 21] of EPISODE[B] records and their CurvTTC float64[B] [s]."""
    out = np.zeros((len(state), SIZE), np.float32)
    _observe(state, curvttc, tables.rows, tables.lane, out)
    return np.clip(out, -BOUND, BOUND)


def controls(action: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return (steer, throttle, brake), float64[B, 3], for actions float[B, 2] in -1..1.

    :raises InvalidInput: another number of values.
    """
    values = np.asarray(action, np.float64)
    if values.shape[1:] != (2,):
        raise InvalidInput(f"an action is (steer, pedal), two numbers of -1 to 1; got {shown(values[0].tolist())}")
    steer, pedal = values.T
    return np.stack([steer, np.maximum(pedal, 0.0), np.maximum(-pedal, 0.0)], axis=1)


def outcome(
    before: NDArray[np.void], after: NDArray[np.void], observation: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return reward float64[B], terminated and truncated bool[B] of a step from `before` to `after`, EPISODE[B]."""
    lateral = observation[:, 3].astype(np.float64)
    collision = (after["outcome"] == COLLISION) | (after["outcome"] == PARKED_COLLISION)
    off = np.abs(lateral) > OFF_LANE
    goal = (after["vehicle_goal"] != 0) & ~collision
    reward = PROGRESS * (after["route_s"] - before["route_s"]) - LATERAL * np.minimum(np.abs(lateral), OFF_LANE) ** 2
    reward += AT_GOAL * goal + AT_FAILURE * (collision | off)
    terminated = collision | off | goal
    return reward, terminated, (after["outcome"] == TIMEOUT) & ~terminated


@kernel
def _observe(state, curvttc, rows, lane, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        episode = state[i]
        table = episode.table
        count, step = rows[table].lane_count, rows[table].lane_step
        x, y, heading = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
        s, left = project(lane, table, count, step, x, y, episode.route_s)
        x0, y0 = point_at(lane, table, count, step, s - 0.5 * step)
        x1, y1 = point_at(lane, table, count, step, s + 0.5 * step)
        turn = heading - math.atan2(y1 - y0, x1 - x0)
        out[i, 0], out[i, 1] = episode.vehicle_speed, episode.vehicle_acceleration
        out[i, 2], out[i, 3] = episode.vehicle_curvature, left
        out[i, 4] = math.atan2(math.sin(turn), math.cos(turn))
        out[i, 5] = rows[table].vehicle_goal - s
        for k in range(len(PREVIEW)):
            ahead_x, ahead_y = point_at(lane, table, count, step, s + PREVIEW[k])
            out[i, 6 + 2 * k], out[i, 7 + 2 * k] = to_heading_frame(heading, ahead_x - x, ahead_y - y)
        away_x, away_y = episode.pedestrian_x - x, episode.pedestrian_y - y
        seen = SIGHT / max(math.hypot(away_x, away_y), SIGHT)
        out[i, 16], out[i, 17] = to_heading_frame(heading, seen * away_x, seen * away_y)
        out[i, 18], out[i, 19] = to_heading_frame(heading, episode.pedestrian_vx, episode.pedestrian_vy)
        out[i, 20] = min(curvttc[i], HORIZON)
