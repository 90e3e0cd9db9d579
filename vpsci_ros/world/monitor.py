"""The safety monitor's core: CurvTTC of every parallel episode, and which of them are critical."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.parameters import constant, parameter
from vpsci_ros.safety import (
    CRITICAL_TTC,
    HORIZON,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    curvttc,
    curvttc_pair,
)
from vpsci_ros.safety.compiled import in_threads
from vpsci_ros.world.compiled import PER_THREAD, kernel
from vpsci_ros.world.state import EPISODE, IDLE, RUNNING

_PAIR = (
    "vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature",
    "pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy",
)  # fmt: skip


@dataclass(frozen=True)
class MonitorConfig:
    """The threshold of critical, between the simulated Model 3 and a pedestrian's disc."""

    critical_threshold: float = constant(
        CRITICAL_TTC, "an episode is critical below this CurvTTC", unit="s", low=0.0, high=60.0
    )
    horizon: float = constant(HORIZON, "time of prediction", unit="s", low=0.1, high=60.0)
    method: str = parameter("footprint", "definition of CurvTTC", choices=("footprint", "center"))


def assess(
    state: NDArray[np.void], config: MonitorConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return CurvTTC [s], distance of the centres [m] (float64[B]) and critical (bool[B]) of EPISODE[B] records.

    CurvTTC is infinite in idle slots; an episode is critical only while it runs. The records are read in place by
    compiled code, in threads for large batches; `curvttc` gives the same bits.
    """
    ttc, distance, critical = np.empty(len(state)), np.empty(len(state)), np.empty(len(state), np.bool_)

    def run(part: slice) -> None:
        _assess(state[part], config.horizon, config.critical_threshold, ttc[part], distance[part], critical[part])

    in_threads(run, len(state), PER_THREAD)
    if config.method == "center":
        present = state["status"] != IDLE
        pair = (state[name][present] for name in _PAIR)
        ttc[present] = curvttc(*pair, horizon=config.horizon, method="center")
        critical = (ttc < config.critical_threshold) & (state["status"] == RUNNING)
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


def warm_up(config: MonitorConfig) -> None:
    """Compile `assess`, or load it, so that no tick waits for it."""
    state = np.zeros(1, EPISODE)
    state["status"] = RUNNING
    assess(state, config)
