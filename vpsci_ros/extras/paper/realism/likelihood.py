"""The likelihood of the recorded motion under a simulator's roll-outs (Waymo Open Sim Agents Challenge).

For each agent and quantity the steps of all roll-outs make a histogram, each bin with `PSEUDO` more; the likelihood of
an interaction is exp of the mean log probability of the recorded steps' bins; the whole is their weighted mean. See
'The Waymo Open Sim Agents Challenge' by Montali et al., NeurIPS 2023 (https://arxiv.org/abs/2305.12032), section 4.
Positions of roll-outs and recordings are smoothed over 0.9 s first.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets
from vpsci_ros.extras.paper.realism.motion import Motion, motion, smoothed, with_onset

Floats = NDArray[np.float64]
PSEUDO = 0.1  # counts that every bin has from the start


class Quantity(NamedTuple):
    """The bins of one quantity's histogram, and its weight in the whole."""

    width: float  # of a bin, in the quantity's unit
    low: float  # what is less falls into the first bin
    high: float  # what is more falls into the last
    weight: float  # in the whole, before they are made to add up to 1


QUANTITIES = {
    "vehicle_speed": Quantity(0.5, 0.0, 12.0, 0.05),  # [m/s]
    "vehicle_acceleration": Quantity(0.5, -8.0, 8.0, 0.05),  # [m/s2]
    "vehicle_yaw_rate": Quantity(0.1, -1.5, 1.5, 0.05),  # [rad/s]
    "pedestrian_speed": Quantity(0.25, 0.0, 4.0, 0.05),
    "pedestrian_acceleration": Quantity(0.5, -6.0, 6.0, 0.05),
    "pedestrian_turn_rate": Quantity(0.2, -3.0, 3.0, 0.05),
    "pedestrian_aside": Quantity(0.25, -4.0, 4.0, 0.05),  # [m]
    "clearance": Quantity(0.5, 0.0, 20.0, 0.10),  # [m]
    "curvttc": Quantity(0.5, 0.0, 10.5, 0.10),  # [s]; no contact within 10 s has the last bin to itself
    "collision": Quantity(1.0, 0.0, 2.0, 0.25),  # whether the footprints touched
}


def values(of: Motion) -> dict[str, Floats]:
    """Return name -> values, float64[..., steps], of each of `QUANTITIES` along the trajectories [...] of a motion."""
    return {
        "vehicle_speed": of.speed[..., 0, :],
        "vehicle_acceleration": of.acceleration[..., 0, :],
        "vehicle_yaw_rate": of.turn_rate[..., 0, :],
        "pedestrian_speed": of.speed[..., 1, :],
        "pedestrian_acceleration": of.acceleration[..., 1, :],
        "pedestrian_turn_rate": of.turn_rate[..., 1, :],
        "pedestrian_aside": of.aside,
        "clearance": of.clearance,
        "curvttc": of.curvttc,
        "collision": np.asarray((of.clearance <= 0.0).any(axis=-1, keepdims=True), np.float64),
    }


def likelihoods(positions: Floats, onsets: Onsets) -> dict[str, Floats]:
    """Return the likelihood of each quantity and the weighted mean `all`, float64[n] each, from 0 to 1.

    :param positions: roll-outs, float64[n, K, 2, 30, 2] [m], that follow the onsets.
    """
    of_simulated, of_recorded = (
        values(motion(smoothed(with_onset(given, onsets.start)), onsets.start, onsets.size))
        for given in (positions, onsets.recorded[:, None])
    )
    parts = {name: _likelihood(of_simulated[name], of_recorded[name], own) for name, own in QUANTITIES.items()}
    total = sum(own.weight for own in QUANTITIES.values())
    whole: Floats = np.sum([own.weight / total * parts[name] for name, own in QUANTITIES.items()], axis=0)
    return {"all": whole, **parts}


def _likelihood(simulated: Floats, recorded: Floats, own: Quantity) -> Floats:
    rows, count = len(simulated), round((own.high - own.low) / own.width)
    places = []
    for given in (simulated, recorded):
        # CurvTTC may be infinite, which has the last bin
        inside = np.minimum(np.nan_to_num(given.reshape(rows, -1), posinf=own.high), own.high)
        places.append(np.clip(((inside - own.low) / own.width).astype(np.int64), 0, count - 1))
    flat = (places[0] + count * np.arange(rows)[:, None]).ravel()
    histogram = np.bincount(flat, minlength=rows * count).reshape(rows, count) + PSEUDO
    probability = histogram / histogram.sum(axis=1, keepdims=True)
    result: Floats = np.exp(np.log(np.take_along_axis(probability, places[1], axis=1)).mean(axis=1))
    return result
