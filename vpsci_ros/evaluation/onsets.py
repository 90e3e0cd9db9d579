"""Recorded onsets (first step whose causal CurvTTC is below 5 s) with 1 s before and 3 s after each."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.interactions import Interactions, from_rows
from vpsci_ros.data.recorded import vehicle_size
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]


STEPS = 30  # after the onset, 3 s
HISTORY = 10  # before it, where there are so many


@dataclass(frozen=True)
class Onsets:
    """N onsets, each with up to `HISTORY` steps before it and `STEPS` after it.

    :ivar interactions: the rows from the first step of history to the last of 3 s; `first` is the onset, `last` is 30
        steps later, and `curvttc` is causal.
    :ivar number: int64[N], the interaction in the near-miss table.
    :ivar size: float64[N, 2], length and width of the vehicle [m].
    """

    interactions: Interactions
    number: NDArray[np.int64]
    size: Floats

    def __len__(self) -> int:
        return len(self.number)

    @property
    def clip(self) -> NDArray[np.object_]:
        """object[N]: "source/clip" of each."""
        return self.interactions.clip

    @property
    def source(self) -> NDArray[np.object_]:
        """object[N]: the data set that each comes from."""
        return np.array([clip.partition("/")[0] for clip in self.clip], object)

    @property
    def start(self) -> Floats:
        """float64[N, 9]: the step of the onset, as a row of `Interactions.motion`."""
        return self.interactions.motion[np.arange(len(self)), self.interactions.first]

    @property
    def recorded(self) -> Floats:
        """float64[N, 2, 30, 2] [m]: where vehicle and pedestrian went in the 3 s after the onset."""
        steps = self.interactions.first[:, None] + 1 + np.arange(STEPS)
        after = self.interactions.motion[np.arange(len(self))[:, None], steps]
        return np.stack([after[..., 0:2], after[..., 5:7]], axis=1)

    def take(self, rows: NDArray[np.int64]) -> "Onsets":
        """Return the onsets `rows`, in that order."""
        return Onsets(self.interactions.take(rows), self.number[rows], self.size[rows])


def borrowable(onsets: Onsets, library: Onsets) -> NDArray[np.bool_]:
    """Return the candidate donors of each onset, bool[n, L]: other clips, of the same source if it has any."""
    strange = onsets.clip[:, None] != library.clip[None, :]
    near = strange & (onsets.source[:, None] == library.source[None, :])
    return np.where(near.any(axis=1, keepdims=True), near, strange)


def find_onsets(table: pl.DataFrame, *, history: int = 0) -> Onsets:
    """Return the onsets of a near-miss table of whole tracks that have 3 s recorded after them.

    :param table: see `vpsci_ros.data.near_misses`; `reference.clean` leaves out standing cars and the like.
    :param history: steps that must be recorded before the onset, 0 to 10.
    :raises InvalidInput: there is none.
    """
    groups, sizes = [], []
    for group in table.partition_by("interaction", maintain_order=True):
        ttc = group["curvttc_causal"].to_numpy()
        below = ttc < CRITICAL_TTC
        at = int(below.argmax())
        if not below.any() or at < history or len(ttc) - 1 - at < STEPS:
            continue
        begin = max(0, at - HISTORY)
        groups.append(group[begin : at + STEPS + 1])
        sizes.append(vehicle_size(group["source"][0]))
    if not groups:
        raise InvalidInput(
            f"near misses: expected an interaction with {STEPS * STEP:g} s of whole track after its onset, got none of "
            f"{table['interaction'].n_unique()}; import the recordings again if the table is from before November 2026"
        )
    interactions = from_rows(groups, "curvttc_causal")
    number = np.array([group["interaction"][0] for group in groups])
    return Onsets(replace(interactions, last=interactions.first + STEPS), number, np.array(sizes))


# ---- Scores of roll-outs against what happened: energy score, ADE, minADE; batched, each an array over interactions.
#
# The energy score is proper: its expectation is least for the distribution that the recordings come from, so neither
# a mean trajectory nor spread for its own sake wins. See 'Strictly proper scoring rules, prediction, and estimation'
# by Gneiting and Raftery, JASA 102, 2007. Here the distance of two joint trajectories is the mean over both agents
# and all steps of the distance between positions, so that for one roll-out the score is the ADE.


BEST_OF = 6  # roll-outs of minADE


def errors(positions: Floats, recorded: Floats) -> Floats:
    """Return each roll-out's mean distance to the recording, float64[n, K] [m] (the ADE of each).

    :param positions: float64[n, K, 2, T, 2] [m]; recorded: float64[n, 2, T, 2] [m].
    """
    apart = positions - recorded[:, None]
    distance: Floats = np.hypot(apart[..., 0], apart[..., 1]).mean(axis=(2, 3))
    return distance


def energy_score(positions: Floats, recorded: Floats) -> Floats:
    """Return the energy score, float64[n] [m]: mean error less half the mean distance of two different roll-outs.

    Distances of a roll-out to itself do not count, so that the expectation does not depend on K.

    :param positions: float64[n, K, 2, T, 2] [m]; recorded: float64[n, 2, T, 2] [m].
    """
    count = positions.shape[1]
    score: Floats = errors(positions, recorded).mean(axis=1)
    if count == 1:
        return score
    total = np.zeros(len(positions))
    for k in range(count - 1):
        apart = positions[:, k + 1 :] - positions[:, k : k + 1]
        total += np.hypot(apart[..., 0], apart[..., 1]).mean(axis=(2, 3)).sum(axis=1)
    return score - total / (count * (count - 1))


def min_ade(positions: Floats, recorded: Floats, best_of: int = BEST_OF) -> Floats:
    """Return the expected least error of `best_of` of the K roll-outs (or of all K, if fewer), float64[n] [m].

    The expectation is over all choices of `best_of` roll-outs, so it does not depend on their order.
    """
    each = np.sort(errors(positions, recorded), axis=1)
    count = each.shape[1]
    if count <= best_of:
        return each[:, 0]
    rank = np.arange(count)
    # the k-th smallest is the least of a choice if all others come from the count - 1 - k larger ones
    weight = np.zeros(count)
    left = 1.0
    for k in rank[: count - best_of + 1]:
        weight[k] = left * best_of / (count - k)
        left -= weight[k]
    result: Floats = each @ weight
    return result
