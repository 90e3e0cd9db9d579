"""Parked and waiting vehicles: they hide pedestrians, and a vehicle can hit them.

They stand where their scenario has them, as oriented rectangles, in every episode. Vehicle and pedestrian see each
other where enough of the pedestrian is visible (`in_sight`); only then do the policies take control of an episode, and
they keep it out of sight. A contact of the vehicle with a parked one ends the episode. Pedestrians follow their routes,
which lead around parked vehicles, and do not wait for them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import PEDESTRIAN_RADIUS, touches_box, visible_pair
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.state import ENDED, FINISHED, IDLE, PARKED_COLLISION, RUNNING

EYE_FORWARD = 0.2  # [m] from the vehicle's centre to the driver's eye and to the sensor: behind the windscreen
LEAST_VISIBLE = 0.25  # of the pedestrian's disc: they see each other where so much of it is free
MOST_SCENARIOS = 256  # numbers of scenarios are bytes


class Parked(NamedTuple):
    """The parked vehicles of S scenarios for compiled code, K at most in one."""

    boxes: NDArray[np.float64]  # [S, K, 5] x, y [m], heading [rad], length, width [m]
    counts: NDArray[np.int64]  # [S]
    row_of: NDArray[np.int64]  # [256] row of a scenario by its number


def parked_from(scenarios: Sequence[Scenario]) -> Parked | None:
    """Return the parked vehicles of scenarios; None where there are none at all."""
    counts = np.array([len(scenario.parked) for scenario in scenarios], np.int64)
    if not counts.any():
        return None
    boxes, row_of = np.zeros((len(scenarios), counts.max(), 5)), np.zeros(MOST_SCENARIOS, np.int64)
    for row, scenario in enumerate(scenarios):
        boxes[row, : counts[row]] = scenario.parked
        row_of[scenario.number] = row
    return Parked(boxes, counts, row_of)


def visible(state: NDArray[np.void], parked: Parked | None) -> NDArray[np.float64]:
    """Return the share of the pedestrian that is visible from the vehicle's eye, float64[B], 0 to 1, for EPISODE[B].

    :returns: 1 where nothing is parked, 0 in idle slots.
    """
    share = (state["status"] != IDLE).astype(np.float64)
    if parked is not None:
        _visible(state, *parked, np.empty((3 * parked.boxes.shape[1], 2)), share)
    return share


def in_sight(state: NDArray[np.void], parked: Parked | None) -> NDArray[np.bool_]:
    """Return where at least `LEAST_VISIBLE` of the pedestrian is visible, bool[B] for EPISODE[B] records."""
    return visible(state, parked) >= LEAST_VISIBLE


@kernel
def _visible(state, boxes, counts, row_of, shadows, share):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        episode, row = state[i], row_of[state[i].scenario]
        if episode.status != IDLE and counts[row] > 0:
            eye_x = episode.vehicle_x + EYE_FORWARD * np.cos(episode.vehicle_heading)
            eye_y = episode.vehicle_y + EYE_FORWARD * np.sin(episode.vehicle_heading)
            x, y = episode.pedestrian_x, episode.pedestrian_y
            share[i] = visible_pair(eye_x, eye_y, x, y, PEDESTRIAN_RADIUS, boxes[row], counts[row], shadows)


def end_crashed(state: NDArray[np.void], parked: Parked, events: NDArray[np.uint16]) -> None:
    """End the running episodes of EPISODE[B] whose vehicle touches a parked one; uint16[B] `events` get 1 << kind."""
    _end_crashed(state, *parked, events)


@kernel
def _end_crashed(state, boxes, counts, row_of, events):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        episode, row = state[i], row_of[state[i].scenario]
        for k in range(counts[row] if episode.status == RUNNING else 0):
            if touches_box(episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, boxes[row, k]):
                episode.outcome, episode.status = PARKED_COLLISION, ENDED
                events[i] |= 1 << FINISHED
                break
