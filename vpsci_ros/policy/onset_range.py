"""The range of recorded onsets of a source: speeds, distances, walking speeds and angles.

An onset lies *beyond* the range where one of the four is below the first or above the last quantile of `LEVELS`; there
reactions are extrapolated. Of a source's own onsets, 5 to 20% lie beyond.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.data.episode_block import RANGES
from vpsci_ros.safety import CRITICAL_TTC

LEVELS = (0.025, 0.1, 0.5, 0.9, 0.975)
QUANTITIES = {
    "speed of the vehicle": "m/s",
    "distance": "m",
    "walking speed": "m/s",
    "angle of walking and driving": "degrees",
}
_WALKS, _DRIVES = 0.3, 0.1  # [m/s] of a slower agent no direction is known, so that no angle lies beyond

Floats = NDArray[np.float64]


def onsets_of(situations: Floats) -> Floats:
    """Return speed, distance, walking speed and angle (`QUANTITIES`), float64[n, 4], of situations, float64[n, 7].

    See `vpsci_ros.policy.bank.situations_of`.
    """
    ahead = np.ones((len(situations), 1)) * (1.0, 0.0)
    return _quantities(situations[:, 0], situations[:, 3:5], ahead, situations[:, 5:7])


def onsets_in(vehicle: NDArray[Any], velocity: NDArray[Any], place: NDArray[Any], walk: NDArray[Any]) -> Floats:
    """Return speed, distance, walking speed and angle (`QUANTITIES`), float64[n, 4], of motion in the map frame.

    :param vehicle, velocity: of the vehicle, float[n, 2] each, position [m] and velocity [m/s].
    :param place, walk: likewise of the pedestrian.
    """
    velocity, walk = np.asarray(velocity, np.float64), np.asarray(walk, np.float64)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    return _quantities(speed, np.asarray(place, np.float64) - vehicle, velocity, walk)


def _quantities(speed: Floats, apart: Floats, heading: Floats, walk: Floats) -> Floats:
    """Return `QUANTITIES`, float64[n, 4]; the angle is NaN where an agent hardly moves."""
    pace = np.hypot(walk[:, 0], walk[:, 1])
    across = heading[:, 0] * walk[:, 1] - heading[:, 1] * walk[:, 0]
    angle = np.degrees(np.arctan2(np.abs(across), (heading * walk).sum(axis=1)))
    known = (pace >= _WALKS) & (np.hypot(heading[:, 0], heading[:, 1]) >= _DRIVES)
    return np.stack([speed, np.hypot(apart[:, 0], apart[:, 1]), pace, np.where(known, angle, np.nan)], axis=1)


def range_of(onsets: Floats) -> Floats:
    """Return the quantiles of onsets, float64[n, 4] -> float64[4, len(LEVELS)].

    Where no onset has an angle, since all pedestrians stand, the range is that of all angles, 0 to 180 degrees.
    """
    out = np.empty((len(QUANTITIES), len(LEVELS)))
    for row, values in zip(out, onsets.T, strict=True):
        known = values[np.isfinite(values)]
        row[:] = np.quantile(known, LEVELS) if known.size else np.linspace(0.0, 180.0, len(LEVELS))
    return out


def ranges(onsets: Floats, reaches: Sequence[Floats]) -> NDArray[np.uint8]:
    """Return indices in `RANGES`, uint8[n], of onsets, float64[n, 4]: "beyond" if beyond one of the `reaches`.

    :param reaches: the range of each agent that acts by a bank; without any, all are "".
    """
    if not reaches:
        return np.zeros(len(onsets), np.uint8)
    outside = np.any([beyond(onsets, reach) for reach in reaches], axis=0)
    return np.where(outside, RANGES.index("beyond"), RANGES.index("within")).astype(np.uint8)


def range_of_episode(episode: Episode, reach: Floats | None) -> str:
    """Return one of `RANGES` for an episode: "beyond" if a pedestrian's onset was beyond `reach`; "" without onset."""
    critical = episode.known_curvttc < CRITICAL_TTC
    who = np.flatnonzero(critical.any(axis=1))
    if reach is None or not who.size:
        return RANGES[0]
    at, seen = critical[who].argmax(axis=1), episode.filled()
    vehicle = np.stack([seen.x[at], seen.y[at]], axis=1), np.stack([seen.vx[at], seen.vy[at]], axis=1)
    place, walk = ((seen.ped_x, seen.ped_y), (seen.ped_vx, seen.ped_vy))
    pairs = (np.stack([each[who, at] for each in both], axis=1) for both in (place, walk))
    return RANGES[int(ranges(onsets_in(*vehicle, *pairs), [reach]).max())]


def beyond(onsets: Floats, reach: Floats) -> NDArray[np.bool_]:
    """Return, as bool[n], which onsets, float64[n, 4], lie beyond a range, float64[4, len(LEVELS)]."""
    with np.errstate(invalid="ignore"):
        outside = (onsets < reach[:, 0]) | (onsets > reach[:, -1])
    return np.asarray(outside.any(axis=1), np.bool_)
