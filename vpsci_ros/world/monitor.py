"""The safety monitor's core: CurvTTC of every parallel episode, and which of them are critical."""

import math

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import (
    CRITICAL_TTC,
    HORIZON,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvttc_pair,
)
from vpsci_ros.safety.compiled import in_threads
from vpsci_ros.world.compiled import PER_THREAD, kernel
from vpsci_ros.world.state import EPISODE, IDLE, RUNNING


def assess(state: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return CurvTTC [s], distance of the centres [m] (float64[B]) and critical (bool[B]) of EPISODE[B] records.

    CurvTTC is infinite in idle slots; an episode is critical below `CRITICAL_TTC`, and only while it runs. The records
    are read in place by compiled code, in threads for large batches; `curvttc` gives the same bits.
    """
    ttc, distance, critical = np.empty(len(state)), np.empty(len(state)), np.empty(len(state), np.bool_)

    def run(part: slice) -> None:
        _assess(state[part], HORIZON, CRITICAL_TTC, ttc[part], distance[part], critical[part])

    in_threads(run, len(state), PER_THREAD)
    return ttc, distance, critical


@kernel
def _assess(state, horizon, threshold, ttc, distance, critical):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot = state[i]
        dx, dy = slot.vehicle_x - slot.pedestrian_x, slot.vehicle_y - slot.pedestrian_y
        distance[i] = math.sqrt(dx * dx + dy * dy)
        ttc[i] = math.inf
        if slot.status != IDLE:
            car = slot.vehicle_x, slot.vehicle_y, slot.vehicle_heading, slot.vehicle_speed, slot.vehicle_curvature
            walker = slot.pedestrian_x, slot.pedestrian_y, slot.pedestrian_vx, slot.pedestrian_vy
            ttc[i] = curvttc_pair(*car, *walker, VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS, horizon)
        critical[i] = slot.status == RUNNING and ttc[i] < threshold


def warm_up() -> None:
    """Compile `assess`, or load it, so that no tick waits for compilation."""
    state = np.zeros(1, EPISODE)
    state["status"] = RUNNING
    assess(state)
