"""What recorded people did beside the mean of their policies, and whom a policy borrows that from.

A policy of two parts acts by its network, a mean that reacts to what happens, plus a residual: what one recorded person
did less the mean along that person's own track. Both agents borrow one undivided sequence of one recorded interaction,
drawn evenly from the `NEAREST` most similar onsets when the policies take over, so what the two do together stays
together. When the sequence ends, or control is taken over again, another is drawn.

Two moments are similar by speed of the vehicle, pace of the pedestrian, its place and its velocity in the vehicle's
heading frame, and the vehicle's acceleration and yaw rate. On which side the pedestrian is makes no difference: what
points left is mirrored. A steering residual is a curvature, so that a slow vehicle does not swerve as a fast one.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import float64, uint64
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_RESIDUAL, philox, unit
from vpsci_ros.world.observation import AGENTS

NEAREST = 32  # onsets of which one is drawn
FEATURES = 8
COLUMNS = 2 * len(AGENTS)  # of a step: the vehicle's [m/s2] and [1/m], then the pedestrian's forward and left [m/s2]
SECONDS = 3  # after the onset in which what is borrowed is adjusted
FURTHEST = 2.0  # standard deviations: the largest difference of a feature that is adjusted for
SECOND = 10  # steps
SLOWEST = 1.0  # [m/s] below it, a steering residual is of a vehicle at this speed
PREFIX = "residuals"


class Residuals(NamedTuple):
    """M sequences of S steps altogether, one after the other.

    :ivar features: float32[M, 8], see `features_of`, each divided by the scale of its people.
    :ivar scale: float32[P, 8], of each kind of people.
    :ivar side: float32[M], 1 where the pedestrian was to the left of the vehicle, else -1.
    :ivar source: float32[M], number of the people (`people_of`) that it comes from, whole.
    :ivar length: float32[M], steps of 0.1 s, whole.
    :ivar steps: float32[S, 4], see `COLUMNS`.
    :ivar slope: float32[P, 8, 3, 4], by how much an action of each second is more, where a feature is more by 1; of
        onsets with the pedestrian to the left.
    """

    features: NDArray[np.float32]
    scale: NDArray[np.float32]
    side: NDArray[np.float32]
    source: NDArray[np.float32]
    length: NDArray[np.float32]
    steps: NDArray[np.float32]
    slope: NDArray[np.float32]

    def tensors(self) -> dict[str, NDArray[np.float32]]:
        """Return the tensors of a weights file, by name."""
        return {f"{PREFIX}.{name}": value for name, value in self._asdict().items()}


def residuals_of(tensors: Mapping[str, NDArray[Any]], where: str) -> Residuals:
    """Return the residuals among the tensors of a weights file; `where` opens the error messages.

    :raises InvalidInput: one is missing, or they do not fit together.
    """
    missing = [name for name in Residuals._fields if f"{PREFIX}.{name}" not in tensors]
    if missing:
        raise InvalidInput(f"{where}: tensor {PREFIX}.{missing[0]} is missing; the network has residuals")
    own = Residuals(*(tensors[f"{PREFIX}.{name}"] for name in Residuals._fields))
    count, total = len(own.length), int(own.length.sum()) if own.length.ndim == 1 else -1
    sources = own.scale.shape[:1]
    whole = (count,)
    shapes = (count, FEATURES), (*sources, FEATURES), whole, whole, whole, (total, COLUMNS), slopes(*sources)
    for name, value, shape in zip(Residuals._fields, own, shapes, strict=True):
        if value.dtype != np.float32 or value.shape != shape:
            raise InvalidInput(
                f"{where}: tensor {PREFIX}.{name}: expected float32{list(shape)}, got {value.dtype}{list(value.shape)}"
            )
        if not np.isfinite(value).all():
            raise InvalidInput(f"{where}: tensor {PREFIX}.{name} holds values that are not finite; train again")
    if (own.length < 1).any() or (own.scale <= 0).any() or set(own.source) != set(range(*sources)):
        raise InvalidInput(
            f"{where}: tensors {PREFIX}: expected sequences of a step or more, scales above 0, and sequences of each "
            f"of {sources[0]} sources"
        )
    return own


def slopes(sources: int) -> tuple[int, ...]:
    """Return the shape of `Residuals.slope` for so many kinds of people."""
    return sources, FEATURES, SECONDS, COLUMNS


def same(first: Residuals | None, second: Residuals | None) -> bool:
    """Return whether both are the same residuals, or none."""
    if first is None or second is None:
        return first is second
    return all(map(np.array_equal, first, second))


def people_of(source: str) -> str:
    """Return whose residuals those of a source are, of near misses or "source/clip": the name up to a hyphen.

    Recordings of one kind of place share it, as vci-dut and vci-citr do, and borrow from each other.
    """
    return source.partition("/")[0].partition("-")[0]


@kernel
def features_of(speed, acceleration, yaw_rate, forward, left, walk_forward, walk_left, out):  # type: ignore[no-untyped-def]
    """Write what makes a moment similar to another one to float64[8]; return the pedestrian's side, 1 or -1.

    :param speed, acceleration, yaw_rate: of the vehicle [m/s, m/s2, rad/s].
    :param forward, left, walk_forward, walk_left: place [m] and velocity [m/s] of the pedestrian, in the heading frame.
    """
    side = -1.0 if left < 0.0 else 1.0
    out[0], out[1] = speed, np.sqrt(walk_forward * walk_forward + walk_left * walk_left)
    out[2], out[3] = forward, left * side
    out[4], out[5] = walk_forward, walk_left * side
    out[6], out[7] = acceleration, yaw_rate * side
    return side


def moments_of(observed: NDArray[Any], acceleration: NDArray[Any], yaw_rate: NDArray[Any]) -> NDArray[np.float64]:
    """Return the arguments of `features_of`, float64[..., 7].

    :param observed: float[..., 6], what the vehicle observes, equation (6).
    :param acceleration, yaw_rate: float[...], of the vehicle [m/s2, rad/s].
    """
    parts = observed[..., :1], acceleration[..., None], yaw_rate[..., None]
    seen = np.asarray(observed, np.float64)
    return np.concatenate([*parts, -seen[..., 2:4], seen[..., 0:2] - seen[..., 4:6]], axis=-1, dtype=np.float64)


def moments_in(state: NDArray[np.void], observed: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return `moments_of` EPISODE[B] records, float64[B, 7]; `observed` float32[B, 6] is what the vehicle observes."""
    out = np.empty((len(state), 7))
    _moments(state, observed, out)
    return out


@kernel
def _moments(state, observed, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot, seen = state[i], observed[i]
        out[i, 0], out[i, 1] = seen[0], slot.vehicle_acceleration
        out[i, 2] = slot.vehicle_curvature * slot.vehicle_speed
        out[i, 3], out[i, 4] = -seen[2], -seen[3]
        out[i, 5], out[i, 6] = float64(seen[0]) - float64(seen[4]), float64(seen[1]) - float64(seen[5])


def describe(moments: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `features_of` moments, float64[n, 8], and the pedestrians' sides, float64[n].

    :param moments: float64[n, 7], the arguments of `features_of`.
    """
    features, side = np.empty((len(moments), FEATURES)), np.empty(len(moments))
    _describe(np.ascontiguousarray(moments, np.float64), features, side)
    return features, side


@kernel
def _describe(moments, features, side):  # type: ignore[no-untyped-def]
    for i in range(side.size):
        m = moments[i]
        side[i] = features_of(m[0], m[1], m[2], m[3], m[4], m[5], m[6], features[i])


class Borrower:
    """Whose residuals act in each of `capacity` slots, for one agent; those of both agents draw the same.

    :param people: number of those whose residuals are borrowed.
    """

    def __init__(self, residuals: Residuals, agent: int, capacity: int, people: int = 0) -> None:
        of = residuals.source == people
        ends = np.cumsum(residuals.length.astype(np.int64))
        self._length = residuals.length.astype(np.int64)[of]
        self._begin = (ends - residuals.length.astype(np.int64))[of]
        self._features = np.ascontiguousarray(residuals.features[of].T, np.float64)  # [8, M]: all rows at a time
        self._scale, self._side = residuals.scale[people].astype(np.float64), residuals.side[of].astype(np.float64)
        self._steps = np.ascontiguousarray(residuals.steps[:, 2 * agent : 2 * agent + 2])
        self._slope = residuals.slope[people, ..., 2 * agent : 2 * agent + 2].astype(np.float64)
        self._steers = agent == 0
        self._next, self._end = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
        self._mirror = np.zeros(capacity, np.float32)
        self._adjust, self._begun = np.zeros((capacity, SECONDS, 2)), np.zeros(capacity, np.int64)

    def step(
        self, moment: NDArray[np.float64], key: NDArray[np.uint64], reset: NDArray[np.bool_], active: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Return the residuals of this step [m/s2], float32[B, 2], 0 where not active.

        :param moment: float64[B, 7], the arguments of `features_of`; read where active.
        :param key: uint64[B, 5], that an active slot draws by, see `draws.keys`.
        :param reset: bool[B]: the policies take over with this step.
        """
        out = np.zeros((len(active), 2), np.float32)
        bank = self._features, self._scale, self._side, self._begin, self._length, self._steps, self._slope
        slots = self._begun, self._next, self._end, self._mirror, self._adjust
        count = min(NEAREST, len(self._side))
        own, near = np.empty(FEATURES), (np.empty(len(self._side)), np.empty(count), np.empty(count, np.int64))
        _borrow(moment, key, reset, active, bank, self._steers, own, near, slots, out)
        return out

    def sequence(self, slot: int) -> int:
        """Return the number of the sequence that acts in a slot, from 0 among those of its people; -1: none yet."""
        return int(np.searchsorted(self._begin, self._begun[slot])) if self._end[slot] else -1


@kernel
def _borrow(moment, key, reset, active, bank, steers, own, near, slots, out):  # type: ignore[no-untyped-def]
    features, scale, sides, begins, lengths, steps, slope = bank
    begun, at, ends, mirror, adjust = slots
    for i in range(out.shape[0]):
        if not active[i]:
            continue
        speed = moment[i, 0]
        if reset[i] or at[i] >= ends[i]:
            m = moment[i]
            side = features_of(m[0], m[1], m[2], m[3], m[4], m[5], m[6], own)
            for k in range(own.size):
                own[k] /= scale[k]
            k = key[i]
            own_stream = uint64(STREAM_RESIDUAL) + (k[4] << uint64(8))
            drawn = unit(philox(k[0], k[1], uint64(0), own_stream, k[2], k[3])[0])
            picked = _nearest(own, features, near, int(drawn * near[1].size))
            at[i] = begun[i] = begins[picked]
            ends[i] = begins[picked] + lengths[picked]
            mirror[i] = side * sides[picked]
            _adjust(own, features[:, picked], slope, side, adjust[i])
        along, left = float64(steps[at[i], 0]), float64(steps[at[i], 1] * mirror[i])
        second = (at[i] - begun[i]) // SECOND
        if second < SECONDS:
            along += adjust[i, second, 0]
            left += adjust[i, second, 1]
        if steers:
            fast = max(speed, SLOWEST)
            left *= float64(fast * fast)
        out[i, 0], out[i, 1] = along, left
        at[i] += 1


@kernel
def _adjust(own, donor, slope, side, out):  # type: ignore[no-untyped-def]
    """Write what people do otherwise at features `own` than at the donor's to float64[SECONDS, 2]."""
    out[:] = 0.0
    for k in range(own.size):
        gap = min(max(own[k] - donor[k], -FURTHEST), FURTHEST)
        for second in range(SECONDS):
            out[second, 0] += gap * slope[k, second, 0]
            out[second, 1] += gap * slope[k, second, 1] * side


@kernel
def _nearest(own, features, near, rank):  # type: ignore[no-untyped-def]
    """Return which column of features, float64[8, M], is the nearest but `rank`; of equally near ones the first counts.

    :param near: to work with: float64[M]; float64[n] and int64[n], n above `rank`.
    """
    gaps, least, columns = near
    for m in range(gaps.size):
        gaps[m] = 0.0
    for k in range(own.size):
        for m in range(gaps.size):
            d = own[k] - features[k, m]
            gaps[m] += d * d
    for place in range(rank + 1):
        least[place] = np.inf
    for m in range(gaps.size):
        at = rank + 1
        while at > 0 and gaps[m] < least[at - 1]:
            at -= 1
        for place in range(rank, at, -1):
            least[place], columns[place] = least[place - 1], columns[place - 1]
        if at <= rank:
            least[at], columns[at] = gaps[m], m
    return columns[rank]
