"""The vehicle of an episode with several pedestrians: moved in its first row, and the same in all of them."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.state import IDLE


@kernel
def share_vehicle(leader, episode):  # type: ignore[no-untyped-def]
    """Make the vehicle of an EPISODE record that of the episode's first, `leader`, its driver included."""
    episode.cruise_throttle, episode.meeting_s = leader.cruise_throttle, leader.meeting_s
    episode.driver_onset, episode.approach_pace = leader.driver_onset, leader.approach_pace
    episode.approach_acceleration, episode.approach_phase = leader.approach_acceleration, leader.approach_phase
    episode.lateral_comfort, episode.drive_on = leader.lateral_comfort, leader.drive_on
    episode.lane_sine, episode.lane_cosine = leader.lane_sine, leader.lane_cosine
    episode.action_heading = leader.action_heading
    share_motion(leader, episode)


@kernel
def share_motion(leader, episode):  # type: ignore[no-untyped-def]
    """Give an EPISODE record the place and motion of the vehicle of the episode's first, `leader`."""
    episode.vehicle_x, episode.vehicle_y = leader.vehicle_x, leader.vehicle_y
    episode.vehicle_heading, episode.vehicle_speed = leader.vehicle_heading, leader.vehicle_speed
    episode.vehicle_curvature, episode.vehicle_acceleration = leader.vehicle_curvature, leader.vehicle_acceleration
    episode.steer, episode.throttle, episode.brake = leader.steer, leader.throttle, leader.brake
    episode.route_s, episode.vehicle_path = leader.route_s, leader.vehicle_path
    episode.vehicle_goal = leader.vehicle_goal


@kernel
def share_action(state, first, count, answers):  # type: ignore[no-untyped-def]
    """Have the vehicle face the most critical pedestrian of those in rows `first` to `first + count` of EPISODE[B].

    Where the policies act, the row with the least CurvTTC leads, the first of equal ones, and its action is the
    vehicle's.
    """
    leader = -1
    for i in range(first, first + count):
        if answers.acts[i] and (leader < 0 or (len(answers.curvttc) and answers.curvttc[i] < answers.curvttc[leader])):
            leader = i
    if leader < 0:
        return
    for i in range(first, first + count):
        state[i].vehicle_held = state[leader].vehicle_held
        state[i].vehicle_long, state[i].vehicle_lat = state[leader].vehicle_long, state[leader].vehicle_lat


def leading_rows(state: NDArray[np.void], acting: NDArray[np.bool_], curvttc: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return for each row of EPISODE[B] the one that leads in its episode, int64[B], by the rule of `share_action`.

    :param acting: bool[B]; where no row of an episode acts, each of its rows leads itself.
    :param curvttc: float64[B] [s].
    """
    rows = np.arange(len(state))
    if not state["pedestrian"].any():
        return rows
    first = rows - state["pedestrian"]
    least = np.full(len(state), np.inf)
    np.minimum.at(least, first[acting], curvttc[acting])
    leads = acting & (curvttc == least[first])
    leader = np.full(len(state), len(state))
    np.minimum.at(leader, first[leads], rows[leads])
    return np.where(leader[first] < len(state), leader[first], rows)


def episode_rows(state: NDArray[np.void]) -> list[NDArray[np.int64]]:
    """Return the rows of each episode in EPISODE[B], those of its first pedestrian first; idle rows belong to none."""
    rows = np.flatnonzero(state["status"] != IDLE)
    return np.split(rows, np.flatnonzero(state["pedestrian"][rows] == 0)[1:]) if len(rows) else []
