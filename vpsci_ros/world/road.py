"""The lane ahead of a vehicle, and the rules by which an episode turns actions into motion, for learners."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.calibration import CAR_WAVE, sway
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import line_at, project
from vpsci_ros.world.spawns import as_recorded, gain_of, keeps_lane, release_of
from vpsci_ros.world.state import IDLE
from vpsci_ros.world.tables import Settings, Tables

LANE_POINTS, LANE_STEP = 16, 2.5  # points of the lane that a learner gets, and [m] from one to the next


class Road(NamedTuple):
    """What a learner needs to know of EPISODE[B] records to continue them by itself.

    :ivar lane: float32[B, 2 LANE_POINTS], points of the lane from the vehicle on, [m] ahead and to the left of it in
        turn; where a recorded driver sways in the lane, so do the points.
    :ivar way: float32[B, 2], unit vector along the pedestrian's route, ahead and to the left of the vehicle.
    :ivar wanted: float32[B, 2] [m/s], speeds at which the rule-based pair goes on after the hand-back.
    :ivar release: float32[B] [s], time without danger to the hand-back.
    :ivar gain: float32[B], share of its acceleration that the pedestrian executes.
    :ivar keeps_lane: uint8[B], 1: the acceleration that keeps the lane is added to the vehicle's.
    :ivar limited: uint8[B], 1: the jerk of both agents is limited, as in scenes of recorded people.
    """

    lane: NDArray[np.float32]
    way: NDArray[np.float32]
    wanted: NDArray[np.float32]
    release: NDArray[np.float32]
    gain: NDArray[np.float32]
    keeps_lane: NDArray[np.uint8]
    limited: NDArray[np.uint8]


def road_of(state: NDArray[np.void], tables: Tables, settings: Settings) -> Road:
    """Return the `Road` of EPISODE[B] records."""
    count = len(state)
    road = Road(
        np.zeros((count, 2 * LANE_POINTS), np.float32),
        np.zeros((count, 2), np.float32),
        np.zeros((count, 2), np.float32),
        np.zeros(count, np.float32),
        np.zeros(count, np.float32),
        np.zeros(count, np.uint8),
        np.zeros(count, np.uint8),
    )
    _fill(state, tables, settings, *road)
    return road


def lane_offsets(state: NDArray[np.void], tables: Tables) -> NDArray[np.float64]:
    """Return how far vehicles are to the left of the middle of their lanes, float64[B] [m]; 0 where no episode is."""
    out = np.zeros(len(state))
    _beside(state, tables, out)
    return out


@kernel
def _beside(state, tables, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        episode = state[i]
        if episode.status != IDLE:
            row, place = tables.rows[episode.table], (episode.vehicle_x, episode.vehicle_y, episode.route_s)
            _, out[i] = project(tables.lane, episode.table, row.lane_count, row.lane_step, *place)


@kernel
def _fill(state, tables, settings, lanes, way, wanted, release, gain, keeping, limited):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        episode = state[i]
        row = tables.rows[episode.table]
        lane = tables.lane, episode.table, row.lane_count, row.lane_step
        swaying = as_recorded(settings.spawn, episode)
        gain[i], keeping[i], limited[i] = gain_of(settings, episode), keeps_lane(settings, episode), swaying
        _, _, ux, uy = line_at(tables.walk, episode.table, row.walk_count, row.walk_step, episode.pedestrian_s)
        way[i, 0], way[i, 1] = to_heading_frame(episode.vehicle_heading, ux, uy)
        wanted[i, 0] = episode.cruise_throttle * row.full_throttle_speed
        wanted[i, 1] = episode.walking_speed
        release[i] = release_of(settings, episode) * settings.period
        for k in range(LANE_POINTS):
            s = episode.route_s + k * LANE_STEP
            x, y, ux, uy = line_at(*lane, s)
            aside = sway(episode.lane_sine, episode.lane_cosine, CAR_WAVE, s) if swaying else 0.0
            x, y = x - aside * uy - episode.vehicle_x, y + aside * ux - episode.vehicle_y
            lanes[i, 2 * k], lanes[i, 2 * k + 1] = to_heading_frame(episode.vehicle_heading, x, y)
