"""Several pedestrians around one vehicle: their number, their relations to the first one, and their spawns.

The first pedestrian starts bit-identical to the one of an episode without others. Each further pedestrian walks in a
group with the first, comes from the other side, follows the first off the kerb, or crosses independently. The draws of
a pedestrian depend on its own number alone, so they do not change with the number of pedestrians.

Groups keep the first one's pace and line, side by side and behind, as small groups do: see 'The Walking Behaviour of
Pedestrian Social Groups and Its Impact on Crowd Dynamics' by Moussaid, Perozo, Garnier, Helbing and Theraulaz, PLoS ONE
5, 2010 (https://doi.org/10.1371/journal.pone.0010047).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import constant, parameter
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_CROWD, draw, normal_pair, unit
from vpsci_ros.world.kinds import TOP_SPEED

MOST = 8  # pedestrians of an episode
ROLES = ("alone", "group", "opposite", "follower")
ALONE, GROUP, OPPOSITE, FOLLOWER = range(4)
NEAREST, FURTHEST = 0.7, 1.6  # [m] from one member of a group to the next, centre to centre
PACE_SPREAD = 0.03  # standard deviation of the walking speeds within a group, as a share
STEP_OFF, STEP_OFF_SPREAD = 0.8, 0.5  # [s] median of a follower's delay, and the standard deviation of its logarithm
ROOM, CAR_ROOM = 0.7, 3.0  # [m] between two who begin an episode, and from the car to a further one, at least
_ASIDE = np.array([0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0])  # places of a group to the left of the first one
_BEHIND = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0])  # and behind it


@dataclass(frozen=True)
class CrowdConfig:
    """The number of pedestrians of an episode, and the relations of further ones to the first.

    :raises InvalidInput: shares of roles above 1 together, or `sizes` that are all 0.
    """

    sizes: list[float] = parameter(
        [], "relative frequencies of 1, 2, ... pedestrians; empty: always `pedestrians`", low=0.0, high=1e6
    )
    group: float = constant(0.7, "share of the further ones who walk with the first one", low=0.0, high=1.0)
    opposite: float = constant(0.14, "share who come from the other side", low=0.0, high=1.0)
    follower: float = constant(
        0.06, "share who wait at the kerb and step off because the first one did", low=0.0, high=1.0
    )

    def __post_init__(self) -> None:
        shares = {name: getattr(self, name) for name in ("group", "opposite", "follower")}
        if sum(shares.values()) > 1.0 + 1e-9:
            said = " + ".join(f"{name} = {share:g}" for name, share in shares.items())
            raise InvalidInput(f"crowd: expected shares that come to 1 at most, got {said}")
        if self.sizes and not sum(self.sizes) > 0.0:
            raise InvalidInput(f"crowd.sizes: expected a part above 0 for some number of pedestrians, got {self.sizes}")

    def size_limits(self, pedestrians: int) -> NDArray[np.float64]:
        """Return the cumulative shares of episodes with 1, 2, ... pedestrians, float64[pedestrians]."""
        parts = np.array(self.sizes or [0.0] * (pedestrians - 1) + [1.0])
        parts = np.concatenate([parts, np.zeros(pedestrians - len(parts))])
        return np.asarray(np.cumsum(parts) / parts.sum())

    def role_limits(self) -> NDArray[np.float64]:
        """Return the cumulative shares of the roles group, opposite and follower, float64[3]."""
        return np.cumsum([self.group, self.opposite, self.follower])


class Crowd(NamedTuple):
    """`CrowdConfig` and `KindMixture` as cumulative shares, for compiled code."""

    sizes: NDArray[np.float64]  # `CrowdConfig.size_limits`
    roles: NDArray[np.float64]  # `CrowdConfig.role_limits`
    kinds: NDArray[np.float64]  # `KindMixture.limits`


@kernel
def how_many(leader, seed, crowd):  # type: ignore[no-untyped-def]
    """Draw the number of pedestrians of the episode whose first EPISODE record is `leader`."""
    if crowd.sizes.size == 1:
        return 1
    share, count = unit(draw(leader, seed, STREAM_CROWD, 0)[0]), 1
    while count < crowd.sizes.size and share >= crowd.sizes[count - 1]:
        count += 1
    return count


@kernel
def role_of(episode, seed, crowd):  # type: ignore[no-untyped-def]
    """Draw the role of a further pedestrian, by its EPISODE record; return an index in `ROLES`."""
    share = unit(draw(episode, seed, STREAM_CROWD, 0)[0])
    if share < crowd.roles[0]:
        return GROUP
    if share < crowd.roles[1]:
        return OPPOSITE
    return FOLLOWER if share < crowd.roles[2] else ALONE


@kernel
def walk_along(episode, leader, seed):  # type: ignore[no-untyped-def]
    """Give a group member the first pedestrian's pace and line; return its spawn along the route [m]."""
    drawn = draw(episode, seed, STREAM_CROWD, 0)
    gap = NEAREST + unit(drawn[1]) * (FURTHEST - NEAREST)
    place = int(episode.pedestrian)
    deviation, _ = normal_pair(unit(drawn[2]), unit(drawn[3]))
    pace = leader.walking_speed * (1.0 + PACE_SPREAD * min(2.0, max(-2.0, deviation)))
    episode.walking_speed = min(pace, TOP_SPEED[episode.kind])
    episode.walking_acceleration, episode.walking_phase = leader.walking_acceleration, leader.walking_phase
    episode.walk_slope, episode.start_delay = leader.walk_slope, leader.start_delay
    episode.pedestrian_offset = leader.pedestrian_offset + _ASIDE[place] * gap
    ragged = 0.4 * (unit(drawn[3]) - 0.5)
    return leader.pedestrian_s - _BEHIND[place] * gap + ragged


@kernel
def step_off_after(episode, leader, seed, standing_room):  # type: ignore[no-untyped-def]
    """Let a follower step off some time after the first pedestrian passes it; return its spawn along the route [m].

    It waits at the kerb until then. If the first one passed it before the spawn, it may walk already.
    """
    drawn = draw(episode, seed, STREAM_CROWD, 0)
    deviation, _ = normal_pair(unit(drawn[2]), unit(drawn[3]))
    episode.follow_delay = STEP_OFF * math.exp(STEP_OFF_SPREAD * deviation)
    kerb = unit(drawn[1]) * standing_room
    if leader.pedestrian_s < kerb:
        episode.start_delay = math.inf
        return kerb
    begins = episode.follow_delay - (leader.pedestrian_s - kerb) / leader.walking_speed
    episode.start_delay = max(0.0, begins)
    return kerb + max(0.0, -begins) * episode.walking_speed


@kernel
def step_off(state, first, count, period):  # type: ignore[no-untyped-def]
    """Let followers in the `count` rows of EPISODE[B] from `first` on set off after the first pedestrian has passed."""
    leader = state[first]
    for i in range(first + 1, first + count):
        follower = state[i]
        if follower.start_delay == math.inf and leader.pedestrian_s >= follower.pedestrian_s:
            follower.start_delay = follower.frame * period + follower.clock + follower.follow_delay


@kernel
def crowded(state, first, row):  # type: ignore[no-untyped-def]
    """Whether the pedestrian of this row of EPISODE[B] spawns too near to its car or to an earlier row's pedestrian."""
    car, walker = state[first], state[row]
    x, y = walker.pedestrian_x, walker.pedestrian_y
    place = car.vehicle_x, car.vehicle_y, car.vehicle_heading
    if clearance_pair(*place, x, y, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS) < CAR_ROOM:
        return True
    for other in range(first, row):
        dx, dy = x - state[other].pedestrian_x, y - state[other].pedestrian_y
        if dx * dx + dy * dy < ROOM * ROOM:
            return True
    return False


@kernel
def share_vehicle(leader, episode):  # type: ignore[no-untyped-def]
    """Copy vehicle and driver of the episode's first EPISODE record, `leader`, into another record of the episode."""
    episode.cruise_throttle, episode.meeting_s = leader.cruise_throttle, leader.meeting_s
    episode.driver_onset, episode.approach_pace = leader.driver_onset, leader.approach_pace
    episode.approach_acceleration, episode.approach_phase = leader.approach_acceleration, leader.approach_phase
    episode.lateral_comfort, episode.drive_on = leader.lateral_comfort, leader.drive_on
    episode.lane_sine, episode.lane_cosine = leader.lane_sine, leader.lane_cosine
    episode.action_heading = leader.action_heading
    share_motion(leader, episode)


@kernel
def share_motion(leader, episode):  # type: ignore[no-untyped-def]
    """Copy the vehicle's position and motion of the episode's first EPISODE record, `leader`, into another record."""
    episode.vehicle_x, episode.vehicle_y = leader.vehicle_x, leader.vehicle_y
    episode.vehicle_heading, episode.vehicle_speed = leader.vehicle_heading, leader.vehicle_speed
    episode.vehicle_curvature, episode.vehicle_acceleration = leader.vehicle_curvature, leader.vehicle_acceleration
    episode.steer, episode.throttle, episode.brake = leader.steer, leader.throttle, leader.brake
    episode.route_s, episode.vehicle_path = leader.route_s, leader.vehicle_path
    episode.vehicle_goal = leader.vehicle_goal


@kernel
def share_action(state, first, count, answers):  # type: ignore[no-untyped-def]
    """Let the vehicle react to the most critical pedestrian of the `count` rows of EPISODE[B] from `first` on.

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
    """Return, for each row of EPISODE[B], its episode's leading row by the rule of `share_action`, int64[B].

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
