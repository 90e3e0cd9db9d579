"""Make a bank of recorded reactions from near misses.

A *motion* here is that of vehicle and pedestrian in a near miss, float64[T, 9]: a row for each step of 0.1 s, with the
columns `MOTION` of the near-miss table.

Recorded accelerations are those of a motion with little jerk, fitted to the recorded positions: differences of
published speeds are noisy, and do not lead along these positions.
"""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import split_by_name, table_hash
from vpsci_ros.data.near_misses import MOTION, clips_of, concat_near_misses, read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.bank import SLOWEST, Bank, Reactions, describe, situations_of, source_of, with_means
from vpsci_ros.policy.forecast import ACTIONS, CrossFitted, no_networks
from vpsci_ros.policy.onset_range import onsets_of, range_of
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.world.observation import STEP, arrays_to_heading_frame, observe_arrays

EVERY = 10  # steps from one situation of a track to the next, 1 s
SETTLED = 5  # steps at the beginning of a track that say little of accelerations: no situations
LEAST = 30  # steps of a reaction, at least
FOREIGN = 6.0  # standard deviations by which a situation of another place counts as further away
JERK_WEIGHT = 1e-4  # [s6] of squared jerk against squared distance to the recorded positions: noise of 1 to 3 cm
_MOVING = 0.5  # [m/s] below it the direction of motion says nothing of a vehicle's heading

Floats = NDArray[np.float64]


def bank_of_tables(
    names: Sequence[str | Path],
    without: Sequence[str] = (),
    others: Sequence[str | Path] = (),
    forecast_of: Callable[[str, pl.DataFrame], CrossFitted | None] | None = None,
) -> Bank:
    """Return the bank of near-miss tables of whole tracks, see `vpsci_ros.data.near_misses.read_near_misses`.

    :param without: beginnings of the names, "source/clip", of clips whose reactions are left out.
    :param others: tables of other places. Their reactions serve each source where it has none like them (`FOREIGN`).
    :param forecast_of: from a source's name and near misses to its forecast, or None for a source without one; see
        `vpsci_ros.learning.forecast`.
    :raises InvalidInput: a table is refused, a clip is in two tables, no clip has a name of `without`, nothing is left,
        no onset has 3 s recorded after it, or every source is also in `others`.
    """
    elsewhere = [read_near_misses(name) for name in others]
    table = concat_near_misses([*map(read_near_misses, names), *elsewhere])
    table, held_out = split_by_name(table, without, "--without") if without else (table, table.head(0))
    parts = [part for part in table.partition_by("interaction", maintain_order=True) if part.height > 1]
    motions = [part.select(MOTION).to_numpy() for part in parts]
    first = np.array([(part["curvttc"] < CRITICAL_TTC).arg_max() for part in parts], np.int64)
    sources = np.array([source_of(part["source"][0]) for part in parts])
    clips = [f"{part['source'][0]}/{part['clip'][0]}" for part in parts]
    foreign = {source_of(source) for other in elsewhere for source in other["source"].unique()}
    own = [name for name in dict.fromkeys(sources.tolist()) if name not in foreign]
    if foreign and not own:
        raise InvalidInput(f"--with {', '.join(map(str, others))}: expected another source than {', '.join(foreign)}")
    borrowed = np.isin(sources, sorted(foreign))
    people = {}
    for name in own:
        rows = np.flatnonzero((sources == name) | borrowed)
        forecast = None
        if forecast_of is not None:
            forecast = forecast_of(name, pl.concat([parts[row] for row in rows]))
        chosen = [motions[row] for row in rows], first[rows], borrowed[rows], [clips[row] for row in rows]
        reactions = reactions_of(*chosen, forecast)
        if reactions is not None:
            people[name] = reactions
    if not people:
        raise InvalidInput(
            f"near misses: expected one with {LEAST * STEP:g} s recorded after its onset, got none in "
            f"{', '.join(map(str, names))}; import the recordings again, for whole tracks"
        )
    facts: dict[str, Any] = {
        "interactions": len(parts),
        "clips": len(set(clips)),
        "sha256": table_hash(table),
        "held_out_clips": clips_of(held_out),
    }
    return Bank(people, {"data": facts})


def reactions_of(
    motions: Sequence[Floats],
    first: NDArray[np.int64],
    foreign: NDArray[np.bool_] | None = None,
    clips: Sequence[str] = (),
    forecast: CrossFitted | None = None,
) -> Reactions | None:
    """Return the reactions of N motions of one source; None if no onset has 3 s after it.

    :param motions: float64[T, 9] each, of two steps or more.
    :param first: int64[N], the step of the onset.
    :param foreign: bool[N], the motion is of another place: each of its situations counts as `FOREIGN` further away.
    :param clips: "source/clip" of each motion; read with a forecast.
    """
    known = np.array([len(motion) - 1 for motion in motions])  # steps whose actions are known
    onsets = np.flatnonzero(first <= known - LEAST)
    if len(onsets) == 0:
        return None
    count, regular = len(onsets), [np.arange(SETTLED, end - LEAST + 1, EVERY) for end in known]
    rows = np.concatenate([onsets, np.repeat(np.arange(len(motions)), [len(each) for each in regular])])
    at = np.concatenate([first[onsets], *regular])
    steps, ends = np.concatenate([actions_of(fitted(motion)) for motion in motions]), np.cumsum(known)
    begin = (ends - known)[rows] + at
    situations = np.concatenate([recorded_situations(motion)[:-1] for motion in motions])[begin]
    features, side = describe(situations)
    scale = np.maximum(features[:count].std(axis=0), 1e-3)
    before = situations[:, [1, 2, 7, 8]]
    before[:, 1] /= np.maximum(situations[:, 0], SLOWEST)
    unseen_by = np.array([forecast.unseen_by[clip] for clip in clips] if forecast else [0] * len(motions))[rows]
    made = Reactions(
        features=np.ascontiguousarray((features / scale).T),
        scale=scale,
        side=side,
        begin=begin,
        end=ends[rows],
        steps=steps,
        before=before,
        reach=range_of(onsets_of(situations[:count])),
        far=np.zeros(len(rows)) if foreign is None else np.where(foreign[rows], FOREIGN**2, 0.0),
        unseen_by=unseen_by,
        networks=forecast.networks if forecast else no_networks(),
        means=np.zeros((len(rows), 0, ACTIONS)),
    )
    return with_means(made)


def recorded_situations(motion: Floats) -> Floats:
    """Return the situation at each step of a motion, float64[T, 9] -> float64[T, 9]; see `bank.situations_of`.

    Accelerations are those of the step before; at the first step, of that step itself.
    """
    seen, _ = observe_arrays(*motion.T)
    done = _accelerations(motion)
    done = np.concatenate([done[:1], done])
    return situations_of(seen, done[:, :2], done[:, 2:])


def actions_of(motion: Floats) -> Floats:
    """Return both agents' actions at each step of a motion but the last, float64[T - 1, 4].

    The vehicle's acceleration [m/s2] and curvature [1/m], the pedestrian's accelerations [m/s2] along the vehicle's
    heading and to its left.
    """
    done = _accelerations(motion)
    speed = np.maximum(np.hypot(motion[:-1, 3], motion[:-1, 4]), SLOWEST)
    done[:, 1] /= speed * speed
    return done


def _accelerations(motion: Floats) -> Floats:
    """Return the accelerations at each step but the last, float64[T - 1, 4] [m/s2]: both agents', forward and left."""
    heading, velocities = motion[:-1, 2], (motion[:, 3:5], motion[:, 7:9])
    changes = [arrays_to_heading_frame(heading, np.diff(velocity, axis=0)) for velocity in velocities]
    return (np.concatenate(changes, axis=1) / STEP).astype(np.float32).astype(np.float64)  # as a training reads them


def fitted(motion: Floats) -> Floats:
    """Return a motion with little jerk, float64[T, 9], fitted to the recorded positions of `motion`.

    The vehicle moves along its heading and does not roll backwards.
    """
    out, (velocity, position) = motion.copy(), _fit(len(motion))
    for place, speed in ((0, 3), (5, 7)):
        recorded = motion[:, place : place + 2].copy()
        out[:, speed : speed + 2] = np.einsum("ts,sk->tk", velocity, recorded)
        out[:, place : place + 2] = np.einsum("ts,sk->tk", position, recorded)
    out[:, 2] = _headings(motion[:, 2], out[:, 3:5])
    c, s = np.cos(out[:, 2]), np.sin(out[:, 2])
    along = np.maximum(c * out[:, 3] + s * out[:, 4], 0.0)
    out[:, 3], out[:, 4] = along * c, along * s
    return out


def _headings(recorded_heading: Floats, velocity: Floats) -> Floats:
    """Return the direction of motion [T] [rad]; where a vehicle hardly moves, the recorded one, turned as nearby."""
    moving = np.flatnonzero(np.hypot(velocity[:, 0], velocity[:, 1]) > _MOVING)
    if moving.size == 0:
        return recorded_heading
    turn = np.arctan2(velocity[:, 1], velocity[:, 0]) - recorded_heading
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    nearest = moving[np.abs(np.arange(len(velocity))[:, None] - moving).argmin(axis=1)]
    result: Floats = recorded_heading + turn[nearest]
    return result


@cache
def _fit(length: int) -> tuple[Floats, Floats]:
    """Return matrices [T, T] from recorded positions to velocities and positions with little jerk, by least squares.

    A position follows from the one before with the mean of both velocities, as in the kinematics.
    """
    way = np.zeros((length, length + 1))  # from the first position and the velocities to positions
    way[:, 0] = 1.0
    for step in range(1, length):
        way[step, 1:] = way[step - 1, 1:]
        way[step, step : step + 2] += 0.5 * STEP
    jerk = np.zeros((max(length - 2, 0), length + 1))
    for step in range(len(jerk)):
        jerk[step, step + 1 : step + 4] = np.array([1.0, -2.0, 1.0]) / STEP**2
    # Sums in one order: a BLAS takes as many threads as there are cores, and other last bits with each number.
    normal = np.einsum("ti,tj->ij", way, way) + JERK_WEIGHT * np.einsum("ti,tj->ij", jerk, jerk)
    solved = _solve(normal + 1e-9 * np.eye(length + 1), way.T)
    return solved[1:], np.einsum("ti,ij->tj", way, solved)


@kernel
def _solve(matrix, right):  # type: ignore[no-untyped-def]
    """Return X of matrix X = right for a positive definite matrix, by Cholesky's decomposition."""
    n = len(matrix)
    low, out = np.zeros((n, n)), right.copy()
    for j in range(n):
        low[j, j] = np.sqrt(matrix[j, j] - (low[j, :j] ** 2).sum())
        for i in range(j + 1, n):
            low[i, j] = (matrix[i, j] - (low[i, :j] * low[j, :j]).sum()) / low[j, j]
    for i in range(n):
        for k in range(i):
            out[i] -= low[i, k] * out[k]
        out[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            out[i] -= low[k, i] * out[k]
        out[i] /= low[i, i]
    return out
