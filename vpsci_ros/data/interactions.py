"""Recorded near misses as padded arrays: observations, actions and next velocities of each agent and step."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import around_critical
from vpsci_ros.data.near_misses import MOTION
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import AGENTS, STEP, arrays_to_heading_frame, observe_arrays

_ByAgent = dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Interactions:
    """N interactions of up to T steps of 0.1 s; at and past `length` entries are zero, CurvTTC infinity.

    length int64[N]; first, last int64[N]: first and last step with CurvTTC < 5 s; clip object[N]: "source/clip"; group
    int64[N]: one number for all interactions of one vehicle at one time.
    motion float64[N, T, 9]: vehicle x, y, heading, vx, vy, pedestrian x, y, vx, vy [m, rad, m/s], map frame.
    curvttc float64[N, T] [s]. Per agent, computed from `motion` on first use: observation float32[N, T, 6] (6)-(7);
    action float32[N, T, 2], the recorded acceleration (v(t+1) - v(t)) / 0.1 s [m/s2]; next_velocity float32[N, T, 2]
    [m/s]; both in the vehicle's heading frame of step t, and zero at the last step, which has no next.
    """

    length: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    clip: NDArray[np.object_]
    group: NDArray[np.int64]
    motion: NDArray[np.float64]
    curvttc: NDArray[np.float64]

    @cached_property
    def _seen_and_done(self) -> tuple[_ByAgent, _ByAgent, _ByAgent]:
        observations = dict(zip(AGENTS, observe_arrays(*np.moveaxis(self.motion, 2, 0)), strict=True))
        velocities = {"vehicle": self.motion[..., 3:5], "pedestrian": self.motion[..., 7:9]}
        actions, next_velocities = {}, {}
        for agent in AGENTS:
            observations[agent][~self.present] = 0.0
            change = np.zeros_like(velocities[agent])
            change[:, :-1] = np.diff(velocities[agent], axis=1)
            change[~self.acted] = 0.0
            change = arrays_to_heading_frame(self.motion[..., 2], change)
            actions[agent] = (change / STEP).astype(np.float32)
            next_velocities[agent] = (change + observations[agent][..., :2]).astype(np.float32)
        return observations, actions, next_velocities

    @property
    def observation(self) -> _ByAgent:
        """Observations of each agent, float32[N, T, 6]."""
        return self._seen_and_done[0]

    @property
    def action(self) -> _ByAgent:
        """Recorded accelerations of each agent, float32[N, T, 2] [m/s2]."""
        return self._seen_and_done[1]

    @property
    def next_velocity(self) -> _ByAgent:
        """Recorded velocities of each agent at the next step, float32[N, T, 2] [m/s]."""
        return self._seen_and_done[2]

    def came_to(self, row: NDArray[np.int64], at: NDArray[np.int64]) -> _ByAgent:
        """Return the accelerations [m/s2] with which agents come to steps `at` of the rows, float32[M, 2]; 0 at 0."""
        known = (at > 0)[:, None].astype(np.float32)
        return {agent: self.action[agent][row, np.maximum(at - 1, 0)] * known for agent in AGENTS}

    def __len__(self) -> int:
        return len(self.length)

    @property
    def present(self) -> NDArray[np.bool_]:
        """bool[N, T]: the step exists."""
        return np.arange(self.motion.shape[1]) < self.length[:, None]

    @property
    def acted(self) -> NDArray[np.bool_]:
        """bool[N, T]: the step has a next one, so its action is known."""
        return np.arange(self.motion.shape[1]) < self.length[:, None] - 1

    def samples(self) -> tuple[dict[str, NDArray[np.float32]], dict[str, NDArray[np.float32]]]:
        """Return each agent's observations, float32[n, 6], and next velocities [m/s], float32[m, 2], of all steps.

        The last step of an interaction has no next velocity, so m is less than n. Of these the networks take their
        normalisation and their reward statistics (`Networks.set_statistics`).
        """
        seen = {agent: self.observation[agent][self.present] for agent in AGENTS}
        return seen, {agent: self.next_velocity[agent][self.acted] for agent in AGENTS}

    def take(self, rows: NDArray[np.int64]) -> "Interactions":
        """Return the interactions with the indices `rows`, in this order."""
        return Interactions(*(getattr(self, field.name)[rows] for field in fields(self)))


def from_table(table: pl.DataFrame) -> Interactions:
    """Build `Interactions` from a near-miss table's rows around critical steps, see `corpus.around_critical`.

    :raises InvalidInput: no interaction of at least two steps.
    """
    rows = around_critical(table).filter(pl.len().over("interaction") >= 2)
    if rows.is_empty():
        raise InvalidInput("near misses: expected an interaction of at least two steps, got none; import recordings")
    return from_rows(rows)


def from_rows(rows: pl.DataFrame, curvttc_column: str = "curvttc") -> Interactions:
    """Build `Interactions` from rows of a near-miss table, in which the rows of an interaction are adjacent.

    :param curvttc_column: which CurvTTC they are to hold, and to be critical by at some step.
    """
    length = rows["interaction"].rle().struct.field("len").to_numpy().astype(np.int64)
    begin = np.cumsum(length) - length
    at = np.repeat(np.arange(len(length)), length), np.arange(rows.height) - np.repeat(begin, length)
    motion, curvttc = np.zeros((len(length), length.max(), len(MOTION))), np.full((len(length), length.max()), np.inf)
    motion[at], curvttc[at] = rows.select(MOTION).to_numpy(), rows[curvttc_column].to_numpy()
    critical = curvttc < CRITICAL_TTC
    last = critical.shape[1] - 1 - critical[:, ::-1].argmax(axis=1)
    firsts = rows[begin.tolist()]
    clip = firsts.select(pl.concat_str("source", "clip", separator="/")).to_series().to_numpy().astype(object)
    group = firsts["group"].to_numpy().astype(np.int64)
    return Interactions(length, critical.argmax(axis=1), last, clip, group, motion, curvttc)
