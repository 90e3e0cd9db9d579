"""Who goes first, and how near the two come: proper scores of roll-outs, each an array over onsets.

The Brier score is the squared difference between the share of roll-outs in which the pedestrian goes first and what
happened (Brier, Monthly Weather Review 78, 1950). The CRPS is the energy score of the least clearance within 3 s.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.simulators import Simulator, tracked
from vpsci_ros.evaluation.statistics import interval
from vpsci_ros.extras.paper.realism.motion import directions, with_onset
from vpsci_ros.safety import clearance, who_goes_first
from vpsci_ros.world.observation import AGENTS

ON = 60  # steps for which roll-outs continue, at the velocity of their last 0.3 s: 3 s rarely decide who goes first
_LAST = 3  # steps of that velocity
_MOVING = 0.2  # [m/s] a slower vehicle keeps its heading, by which its rear is past the pedestrian or not

Floats = NDArray[np.float64]
Scores = dict[str, Floats]
"""`energy` [m], `brier` (NaN where the recording leaves open who goes first), `crps` [m] and `contact`, float64[n]."""


def scores(positions: Floats, onsets: Onsets, agent: str = "") -> Scores:
    """Return the scores of roll-outs, float64[n, K, 2, 30, 2] [m], that follow the onsets.

    :param agent: whose positions the energy score counts; empty: both agents'.
    """
    part = slice(None) if not agent else [AGENTS.index(agent)]
    near, recorded = (least_clearance(own, onsets) for own in (positions, onsets.recorded[:, None]))
    return {
        "energy": energy_score(positions[:, :, part], onsets.recorded[:, part]),
        "brier": (pedestrian_first(positions, onsets) - onsets.pedestrian_first) ** 2,
        "crps": crps(near, recorded[:, 0]),
        "contact": (near <= 0.0).mean(axis=1),
    }


def likeness(simulate: Simulator, onsets: Onsets) -> tuple[float, float]:
    """Return the mean Brier score, and the mean energy score as a ratio to constant velocity's."""
    own, still = (scores(by(onsets), onsets) for by in (simulate, tracked))
    return float(np.nanmean(own["brier"])), float(own["energy"].mean() / still["energy"].mean())


def crps(values: Floats, recorded: Floats) -> Floats:
    """Return the continuous ranked probability score, float64[n]: the energy score of a single number.

    :param values: float64[n, K], the number in each roll-out; recorded: float64[n].
    """
    count = values.shape[1]
    score: Floats = np.abs(values - recorded[:, None]).mean(axis=1)
    pairs = np.abs(values[:, :, None] - values[:, None]).sum(axis=(1, 2))
    return score - pairs / (2.0 * count * max(count - 1, 1))


def least_clearance(positions: Floats, onsets: Onsets) -> Floats:
    """Return the least distance [m] between the footprints within 3 s, float64[n, K]; 0: they touch."""
    heading = directions(with_onset(positions, onsets.start), onsets.start)[:, :, 0]
    length, width = (np.broadcast_to(onsets.size[:, None, None, i], heading.shape) for i in (0, 1))
    places = (positions[:, :, agent, :, axis] for agent in (0, 1) for axis in (0, 1))
    x, y, ped_x, ped_y = places
    least: Floats = clearance(x, y, heading, ped_x, ped_y, length=length, width=width).min(axis=-1)
    return least


def pedestrian_first(positions: Floats, onsets: Onsets) -> Floats:
    """Return the share of roll-outs in which the pedestrian goes first, float64[n]; an open one counts half."""
    path = with_onset(positions, onsets.start)
    turned = directions(path, onsets.start, _MOVING)[:, :, 0]
    start = np.broadcast_to(onsets.start[:, None, 2:3], (*turned.shape[:2], 1))
    heading = np.concatenate([start, turned, np.repeat(turned[..., -1:], ON, axis=-1)], axis=-1)
    step = (path[..., -1:, :] - path[..., -1 - _LAST : -_LAST, :]) / _LAST
    path = np.concatenate([path, path[..., -1:, :] + np.arange(1, ON + 1)[:, None] * step], axis=-2)
    places = (path[:, :, agent, :, axis] for agent in (0, 1) for axis in (0, 1))
    x, y, ped_x, ped_y = places
    first = who_goes_first(x, y, heading, ped_x, ped_y)
    share: Floats = np.where(np.isnan(first), 0.5, first).mean(axis=1)
    return share


def beside(own: Scores, sampler: Scores, constant_velocity: Scores, draws: Floats) -> dict[str, list[float]]:
    """Return name -> [mean, low, high] of scores and of their differences to the sampler's, `NAME_minus_sampler`.

    The energy score and its difference are shares of constant velocity's. Intervals are 95%.

    :param draws: float64[count, n], how often each onset occurs in a resample, see `statistics.cluster_counts`.
    """
    out = {}
    for name, value in own.items():
        whole = constant_velocity[name] if name == "energy" else None
        out[name] = estimate(value, draws, whole)
        if name in sampler:
            out[f"{name}_minus_sampler"] = estimate(value - sampler[name], draws, whole)
    return out


def estimate(values: Floats, draws: Floats, whole: Floats | None = None) -> list[float]:
    """Return [mean, low, high] of float64[n], as a share of the mean of `whole`; NaN left out, NaN without values."""
    once = _means(values, np.ones((1, len(values))), whole)
    return [float(once[0]), *interval(_means(values, draws, whole))]


def difference(first: Floats, second: Floats, draws: Floats) -> list[float]:
    """Return [mean of first less mean of second, low, high] of float64[n] each, NaN left out."""
    once = np.ones((1, len(first)))
    value = float(_means(first, once)[0] - _means(second, once)[0])
    return [value, *interval(_means(first, draws) - _means(second, draws))]


def _means(values: Floats, draws: Floats, whole: Floats | None = None) -> Floats:
    """Return the mean in each resample, float64[count], as a share of that of `whole`."""
    known = ~np.isnan(values)
    scale = known.astype(np.float64) if whole is None else np.where(known, whole, 0.0)
    total = draws @ scale
    return np.divide(draws @ np.where(known, values, 0.0), total, out=np.full(len(total), np.nan), where=total > 0.0)
