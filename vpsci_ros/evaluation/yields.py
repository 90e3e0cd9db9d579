"""Who yielded in the episodes of a dataset: Table 7's columns in the form that `vpsci_ros.safety` judges."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import EpisodeArrays
from vpsci_ros.safety.yielding import Yielded, YieldRule, who_yielded

YIELD_NAMES = {
    Yielded.VEHICLE: "Vehicle-yield",
    Yielded.PEDESTRIAN: "Pedestrian-yield",
    Yielded.BOTH: "Both yield",
    Yielded.NONE: "Nobody yields",
}
_STANDING = 1e-3  # [m/s] below it a velocity has no direction


def yields(episodes: EpisodeArrays, period: float, rule: YieldRule | None = None) -> NDArray[np.uint8]:
    """Return uint8[n], `Yielded` codes; episodes with a frame that nobody saw are judged on the last one seen.

    :param period: time from one frame to the next [s].
    """
    names = ("position_x_av", "position_y_av", "position_x_ped", "position_y_ped", "velocity_x_ped", "velocity_y_ped")
    x, y, px, py, pvx, pvy = (seen(episodes[name], episodes.lengths) for name in names)
    vx, vy = (seen(episodes[name], episodes.lengths) for name in ("velocity_x_av", "velocity_y_av"))
    ttc = np.nan_to_num(episodes["CurvTTC"], nan=np.inf, posinf=np.inf)
    speed = np.hypot(vx, vy)
    return who_yielded(
        *(x, y, headings(vx, vy), speed, px, py, pvx, pvy, ttc), dt=period, lengths=episodes.lengths, rule=rule
    )


def headings(vx: NDArray[np.float64], vy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return float64[n, F] [rad]: direction of motion, and where it stands the one before (at first, the next)."""
    moving = np.hypot(vx, vy) > _STANDING
    heading = _filled(np.where(moving, np.arctan2(vy, vx), np.nan))
    return np.nan_to_num(heading)


def seen(values: NDArray[np.float32], lengths: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return values[n, F] of one quantity with the last one seen where nobody saw it, and 0 beyond an episode's end."""
    counted = np.arange(values.shape[1]) < lengths[:, None]
    return np.where(counted, np.nan_to_num(_filled(values.astype(np.float64))), 0.0)


def _filled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values[n, F] with each NaN replaced by the value before it, at the beginning by the first one there is."""
    known = ~np.isnan(values)
    step = np.arange(values.shape[1])
    before = np.maximum.accumulate(np.where(known, step, -1), axis=1)
    first = np.where(known.any(axis=1), known.argmax(axis=1), 0)[:, None]
    filled: NDArray[np.float64] = np.take_along_axis(values, np.where(before < 0, first, before), axis=1)
    return filled
