"""Recorded onsets, the first steps with `curvttc_causal` below 5 s, with up to 1 s before and 3 s after each."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.interactions import Interactions, from_rows
from vpsci_ros.data.recorded import size_of
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.statistics import Units, units_of
from vpsci_ros.safety import CRITICAL_TTC, who_goes_first
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]


STEPS = 30  # after the onset, 3 s
HISTORY = 10  # before it, where there are so many


class Other(NamedTuple):
    """What one agent does from the onset on, in place of what a simulator has it do.

    :ivar agent: "vehicle" or "pedestrian".
    :ivar acceleration: [m/s2] along its way, the vehicle's with the curvature of the onset, until it stands; -infinity:
        it stands at once; None: its recorded accelerations.
    """

    agent: str
    acceleration: float | None = None


@dataclass(frozen=True)
class Onsets:
    """N onsets, each with up to `HISTORY` steps before it and `STEPS` after it.

    :ivar interactions: the rows from the first step of history to the last of 3 s; `first` is the onset, `last` is 30
        steps later, and `curvttc` is causal.
    :ivar number: int64[N], the interaction in the near-miss table.
    :ivar size: float64[N, 2], length and width of the vehicle [m].
    :ivar pedestrian_first: float64[N], who goes first from the onset to the end of the whole recorded track, see
        `safety.who_goes_first`.
    :ivar late: the accelerations before the onset are known as a sensor has them, see `protocols.known_actions`.
    :ivar other: an agent that a simulator does not move, and what it does; None: the simulator moves both.
    """

    interactions: Interactions
    number: NDArray[np.int64]
    size: Floats
    pedestrian_first: Floats
    late: bool = False
    other: Other | None = None

    def __len__(self) -> int:
        return len(self.number)

    @property
    def clip(self) -> NDArray[np.object_]:
        """object[N]: the clip of each onset, as "source/clip"."""
        return self.interactions.clip

    @property
    def units(self) -> Units:
        """The clips, or the groups, that a bootstrap of the onsets draws with replacement."""
        return units_of(self.clip, self.interactions.group)

    @property
    def source(self) -> NDArray[np.object_]:
        """object[N]: the data set of each onset."""
        return np.array([clip.partition("/")[0] for clip in self.clip], object)

    @property
    def start(self) -> Floats:
        """float64[N, 9]: the step of the onset, as a row of `Interactions.motion`."""
        return self.interactions.motion[np.arange(len(self)), self.interactions.first]

    @property
    def recorded(self) -> Floats:
        """float64[N, 2, 30, 2] [m]: the positions of vehicle and pedestrian at the 30 steps after the onset."""
        steps = self.interactions.first[:, None] + 1 + np.arange(STEPS)
        after = self.interactions.motion[np.arange(len(self))[:, None], steps]
        return np.stack([after[..., 0:2], after[..., 5:7]], axis=1)

    def take(self, rows: NDArray[np.int64]) -> "Onsets":
        """Return the onsets with the indices `rows`, in this order."""
        taken = self.interactions.take(rows), self.number[rows], self.size[rows], self.pedestrian_first[rows]
        return Onsets(*taken, self.late, self.other)


def borrowable(onsets: Onsets, library: Onsets) -> NDArray[np.bool_]:
    """Return which onsets of `library` are donors of each onset, bool[n, L]: those of other clips of its source.

    Where the library has none of these, the donors are of other clips of any source; where it has no other clip, of
    other groups, if possible of the same source.

    :raises InvalidInput: the library has neither another clip nor another group for an onset.
    """
    strange = onsets.clip[:, None] != library.clip[None, :]
    other = onsets.interactions.group[:, None] != library.interactions.group[None, :]
    strange = np.where(strange.any(axis=1, keepdims=True), strange, other)
    if not strange.any(axis=1).all():
        raise InvalidInput("near misses: expected those of two vehicles or more, got one vehicle; give more recordings")
    near = strange & (onsets.source[:, None] == library.source[None, :])
    return np.where(near.any(axis=1, keepdims=True), near, strange)


def find_onsets(table: pl.DataFrame, *, history: int = 0) -> Onsets:
    """Return those onsets of a near-miss table of whole tracks after which 3 s are recorded.

    :param table: see `vpsci_ros.data.near_misses`, of which `clean` leaves out standing cars and such.
    :param history: steps that must be recorded before the onset, 0 to 10.
    :raises InvalidInput: there is no such onset.
    """
    step, below = pl.int_range(pl.len()), pl.col("curvttc_causal") < CRITICAL_TTC
    onset = pl.when(below).then(step).min()
    recorded = (onset >= history) & (onset + STEPS < pl.len())
    rows = table.filter((recorded & step.is_between(onset - HISTORY, onset + STEPS)).over("interaction"))
    if rows.is_empty():
        raise InvalidInput(
            f"near misses: expected an interaction with {STEPS * STEP:g} s of whole track after its onset, got none of "
            f"{table['interaction'].n_unique()}; import the recordings again if the table is from before November 2026"
        )
    interactions = from_rows(rows, "curvttc_causal")
    begins = (np.cumsum(interactions.length) - interactions.length).tolist()
    sizes = np.array([size_of(rows[begin : begin + 1]) for begin in begins])
    number = rows["interaction"].to_numpy()[begins]
    after = from_rows(table.filter((recorded & (step >= onset)).over("interaction")), "curvttc_causal")
    first = who_goes_first(*np.moveaxis(after.motion[..., [0, 1, 2, 5, 6]], 2, 0), lengths=after.length)
    return Onsets(replace(interactions, last=interactions.first + STEPS), number, sizes, first)
