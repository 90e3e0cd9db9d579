"""Make a bank of recorded reactions from near misses.

A *motion* here is that of vehicle and pedestrian in a near miss, float64[T, 9]: a row for each step of 0.1 s, with the
columns `MOTION` of the near-miss table.

Recorded accelerations are those of a motion with little jerk, fitted to the recorded positions: differences of
published speeds are noisy, and do not lead along these positions.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.near_misses import MOTION, clips_of, concat_near_misses, read_near_misses, split_by_name, table_hash
from vpsci_ros.data.reference import trailing_slope
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.bank import (
    ACTIONS,
    FEATURES,
    SECOND,
    SECONDS,
    SLOWEST,
    Bank,
    Reactions,
    describe,
    situations_of,
    source_of,
)
from vpsci_ros.policy.onset_range import onsets_of, range_of
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.world.observation import STEP, arrays_to_heading_frame, observe_arrays

EVERY = 10  # steps from one situation of a track to the next, 1 s
SETTLED = 5  # steps at the beginning of a track that say little of accelerations: no situations
LEAST = SECONDS * SECOND  # steps of a reaction, at least
FOREIGN = 6.0  # standard deviations by which a situation of another place counts as further away
FEW = 60  # onsets of one's own that weigh as much as all onsets together, in standard deviations and slopes
RIDGE = 0.1  # penalty of slopes, per onset
JERK_WEIGHT = 1e-4  # [s6] of squared jerk against squared distance to the recorded positions: noise of 1 to 3 cm
_MOVING = 0.5  # [m/s] below it the direction of motion says nothing of a vehicle's heading

Floats = NDArray[np.float64]


def bank_of_tables(names: Sequence[str | Path], without: Sequence[str] = (), others: Sequence[str | Path] = ()) -> Bank:
    """Return the bank of near-miss tables of whole tracks, see `vpsci_ros.data.near_misses.read_near_misses`.

    :param without: beginnings of the names, "source/clip", of clips whose reactions are left out.
    :param others: tables of other places. Their reactions serve each source where it has none like them (`FOREIGN`).
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
    foreign = {source_of(source) for other in elsewhere for source in other["source"].unique()}
    own = [name for name in dict.fromkeys(sources.tolist()) if name not in foreign]
    if foreign and not own:
        raise InvalidInput(f"--with {', '.join(map(str, others))}: expected another source than {', '.join(foreign)}")
    borrowed = np.isin(sources, sorted(foreign))
    people = {}
    for name in own:
        rows = np.flatnonzero((sources == name) | borrowed)
        reactions = reactions_of([motions[row] for row in rows], first[rows], borrowed[rows])
        if reactions is not None:
            people[name] = reactions
    if not people:
        raise InvalidInput(
            f"near misses: expected one with {LEAST * STEP:g} s recorded after its onset, got none in "
            f"{', '.join(map(str, names))}; import the recordings again, for whole tracks"
        )
    facts: dict[str, Any] = {
        "interactions": len(parts),
        "clips": len({(part["source"][0], part["clip"][0]) for part in parts}),
        "sha256": table_hash(table),
        "held_out_clips": clips_of(held_out),
    }
    return Bank(people, {"data": facts})


def reactions_of(
    motions: Sequence[Floats], first: NDArray[np.int64], foreign: NDArray[np.bool_] | None = None
) -> Reactions | None:
    """Return the reactions of N motions of one source; None if no onset has 3 s after it.

    :param motions: float64[T, 9] each, of two steps or more.
    :param first: int64[N], the step of the onset.
    :param foreign: bool[N], the motion is of another place: each of its situations counts as `FOREIGN` further away.
        Standard deviations and slopes are means of those of all onsets and of the source's own onsets, see `FEW`.
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
    begun = features[:count]
    relative = _relative(steps[begin[:count, None] + np.arange(LEAST)], begun[:, 0])
    scale, slope = _fit_onsets(begun, relative, side[:count])
    own = np.zeros(0, np.int64) if foreign is None else np.flatnonzero(~foreign[onsets])
    if len(own):
        parts = _fit_onsets(begun[own], relative[own], side[own])
        share = len(own) / (len(own) + FEW)
        raw = share * parts[1] / parts[0][:, None, None] + (1.0 - share) * slope / scale[:, None, None]
        scale = np.sqrt(share * parts[0] ** 2 + (1.0 - share) * scale**2)
        slope = raw * scale[:, None, None]
    return Reactions(
        features=np.ascontiguousarray((features / scale).T),
        scale=scale,
        side=side,
        begin=begin,
        end=ends[rows],
        steps=steps,
        slope=slope,
        reach=range_of(onsets_of(situations[:count])),
        far=np.zeros(len(rows)) if foreign is None else np.where(foreign[rows], FOREIGN**2, 0.0),
    )


def recorded_situations(motion: Floats) -> Floats:
    """Return the situation at each step of a motion, float64[T, 9] -> float64[T, 7]; see `bank.situations_of`.

    Acceleration and yaw rate of the vehicle are slopes over the 0.4 s before.
    """
    seen, _ = observe_arrays(*motion.T)
    return situations_of(seen, trailing_slope(np.hypot(motion[:, 3], motion[:, 4])), trailing_slope(motion[:, 2]))


def actions_of(motion: Floats) -> Floats:
    """Return both agents' actions at each step of a motion but the last, float64[T - 1, 4].

    The vehicle's acceleration [m/s2] and curvature [1/m], the pedestrian's accelerations [m/s2] along the vehicle's
    heading and to its left.
    """
    heading, velocities = motion[:-1, 2], (motion[:, 3:5], motion[:, 7:9])
    changes = [arrays_to_heading_frame(heading, np.diff(velocity, axis=0)) for velocity in velocities]
    done = (np.concatenate(changes, axis=1) / STEP).astype(np.float32).astype(np.float64)  # as a training reads them
    speed = np.maximum(np.hypot(motion[:-1, 3], motion[:-1, 4]), SLOWEST)
    done[:, 1] /= speed * speed
    return done


def _relative(done: Floats, speed: Floats) -> Floats:
    """Return actions, float64[n, T, 4], the vehicle's relative to its `speed` [m/s] in the situation."""
    fast, out = np.maximum(speed, SLOWEST)[:, None], done.copy()
    out[..., 0] /= fast
    out[..., 1] *= fast * fast
    return out


def _fit_onsets(begun: Floats, relative: Floats, side: Floats) -> tuple[Floats, Floats]:
    """Return standard deviations of the features of n onsets, float64[8], and `_slopes` by features divided by these.

    :param begun: float64[n, 8]; the others as in `_slopes`.
    """
    scale = np.maximum(begun.std(axis=0), 1e-3)
    return scale, _slopes(begun / scale, relative, side)


def _slopes(features: Floats, done: Floats, side: Floats) -> Floats:
    """Return `Reactions.slope`, float64[8, 3, 4]: ridge regressions of what was done in each second after n onsets.

    :param done: float64[n, 30, 4], the actions from the onset on.
    """
    out = np.zeros((FEATURES, SECONDS, ACTIONS))
    for second in range(SECONDS):
        action = done[:, second * SECOND : (second + 1) * SECOND].mean(axis=1)
        action[:, 1::2] *= side[:, None]
        x, y = features - features.mean(axis=0), action - action.mean(axis=0)
        normal = np.einsum("ni,nj->ij", x, x) + RIDGE * len(x) * np.eye(FEATURES)
        out[:, second] = _solve(normal, np.einsum("ni,nj->ij", x, y))
    return out


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
