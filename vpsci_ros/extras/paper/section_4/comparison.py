"""Similarity of generated and recorded interactions, in numbers with intervals (section 4.3).

The unit of sampling is the clip for recorded near misses (the group where clips are few: `statistics.units_of`), and
the episode for generated ones; intervals resample these. The paper tests the difference of the two distributions by
Kolmogorov and Smirnov, as if all interactions were independent; recorded ones are not, so no p-value is given here.
The same distance D between two halves of the recorded clips says more: the same people differ by that much.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.evaluation.statistics import interval, resamples, wilson_interval

Floats = NDArray[np.float64]


RESAMPLES = 500
QUARTILES = (0.25, 0.5, 0.75)
ONSETS = (1.5, 2.5, 3.5, 4.5)  # [s] bounds of the classes of CurvTTC at the onset
SHARES = ("conflict", "vehicle_yields", "pedestrian_yields")


def describe(encounters: pl.DataFrame, *, clustered: bool) -> dict[str, Any]:
    """Return statistics of a table of interactions; every estimate is {"value", "low", "high"}.

    Keys: interactions, groups; least_curvttc, its quartiles [s] as a list of three; and the shares `SHARES`. A share of
    0 or 1, which no resample changes, has Wilson's interval for as many trials as there are units.

    :param encounters: at least one row of `vpsci_ros.extras.paper.section_4.encounters.SCHEMA`.
    :param clustered: resample the column `group` rather than interactions.
    """
    table = encounters.sort("least_curvttc")
    least = table["least_curvttc"].to_numpy()
    draws = list(weights(table, clustered))
    found: dict[str, Any] = {"interactions": table.height, "groups": table["group"].n_unique()}
    found["least_curvttc"] = [
        _estimate(float(np.quantile(least, q)), [_quantile(least, w, q) for w in draws]) for q in QUARTILES
    ]
    for name in SHARES:
        flag = table[name].to_numpy().astype(np.float64)
        found[name] = _estimate(float(flag.mean()), [float(w @ flag) for w in draws])
        if found[name]["value"] in (0.0, 1.0):
            units = found["groups"] if clustered else table.height
            found[name]["low"], found[name]["high"] = wilson_interval(round(found[name]["value"] * units), units)
    return found


def distance_between(recorded: pl.DataFrame, generated: pl.DataFrame) -> dict[str, Any]:
    """Return distances between the distributions of recorded and generated least CurvTTC.

    Keys: ks, the greatest difference D of the two distribution functions, and wasserstein [s], each with its interval;
    ks_onset and wasserstein_onset: the same with recorded ones weighted by `onset_weights`.
    """
    grid = _Grid(recorded["least_curvttc"].to_numpy(), generated["least_curvttc"].to_numpy())
    value = grid.apart()
    pairs = zip(weights(recorded, True), weights(generated, False, seed=1), strict=True)
    drawn = [grid.apart(first, second) for first, second in pairs]
    onset = grid.apart(onset_weights(recorded, generated))
    found: dict[str, Any] = {}
    for i, name in enumerate(("ks", "wasserstein")):
        found |= {name: _estimate(value[i], [d[i] for d in drawn]), f"{name}_onset": onset[i]}
    return found


def between_halves(recorded: pl.DataFrame) -> dict[str, dict[str, float]]:
    """Return `ks` and `wasserstein` [s] between random halves of the recorded clips: median and 95% interval.

    Clips are the values of column `group` (groups, where clips are few); NaN where there is a single value.
    """
    owner, least = _owners(recorded), recorded["least_curvttc"].to_numpy()
    count, rng = int(owner.max()) + 1, np.random.default_rng(0)
    found = [(np.nan, np.nan)]
    if count > 1:
        chosen = [np.isin(owner, rng.permutation(count)[: count // 2]) for _ in range(RESAMPLES)]
        found = [_Grid(least[half], least[~half]).apart() for half in chosen]
    draws = np.array(found)
    return {name: _estimate(float(np.median(draws[:, i])), draws[:, i]) for i, name in enumerate(("ks", "wasserstein"))}


def onset_weights(recorded: pl.DataFrame, generated: pl.DataFrame) -> Floats:
    """Return weights of recorded near misses, float64[N] of sum 1, that give them the generated CurvTTC at the onset.

    What begins at 2 s cannot be kept at 3 s, so a difference in onset is one in the least CurvTTC, too. A class of
    `ONSETS` in which nothing was recorded cannot be weighted, and is left out.
    """
    mine, theirs = (np.digitize(table["onset_curvttc"].to_numpy(), ONSETS) for table in (recorded, generated))
    wanted, there = (np.bincount(place, minlength=len(ONSETS) + 1) for place in (theirs, mine))
    weight = wanted[mine] / there[mine]
    return np.asarray(weight / weight.sum())


class _Grid:
    """Two samples on one axis, so that the distance of their distributions under many weights is two running sums."""

    def __init__(self, first: Floats, second: Floats) -> None:
        values = np.concatenate([first, second])
        self._order, self._split = np.argsort(values, kind="stable"), len(first)
        sorted_values = values[self._order]
        self._gap = np.diff(sorted_values)
        self._even = (np.full(len(first), 1.0 / len(first)), np.full(len(second), 1.0 / len(second)))

    def apart(self, first: Floats | None = None, second: Floats | None = None) -> tuple[float, float]:
        """Return D and the Wasserstein distance under weights of sum 1 of either sample; None: even ones."""
        mine, theirs = (self._even[i] if w is None else w for i, w in enumerate((first, second)))
        difference = np.cumsum(np.concatenate([mine, -theirs])[self._order])[:-1]
        apart = self._gap > 0.0  # between equal values a distribution function has no value of its own
        return float(np.abs(difference * apart).max(initial=0.0)), float(np.abs(difference) @ self._gap)


def weights(table: pl.DataFrame, clustered: bool, seed: int = 0) -> Iterator[Floats]:
    """Yield the rows' weights in each of `RESAMPLES` bootstrap samples of rows or groups, float64[N] of sum 1."""
    owner = _owners(table) if clustered else np.arange(table.height)
    count = int(owner.max()) + 1
    for drawn in resamples(count, seed, RESAMPLES):
        weight = np.bincount(drawn, minlength=count)[owner]
        yield weight / weight.sum()


def _owners(table: pl.DataFrame) -> NDArray[np.int64]:
    return table["group"].rank("dense").cast(pl.Int64).to_numpy() - 1


def _quantile(ordered: Floats, weight: Floats, q: float) -> float:
    return float(ordered[min(int(np.searchsorted(np.cumsum(weight), q)), len(ordered) - 1)])


def _estimate(value: float, draws: ArrayLike) -> dict[str, float]:
    low, high = interval(draws)
    return {"value": float(value), "low": low, "high": high}
