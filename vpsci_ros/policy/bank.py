"""A bank of recorded reactions: the actions of both agents after many recorded situations.

A *situation* is a recorded step of a pair; its *reaction* is what both did from then to the end of the track. Two
situations are alike by speed of the vehicle, pace of the pedestrian, its place and velocity in the vehicle's heading
frame, and acceleration and yaw rate of the vehicle. On which side the pedestrian is makes no difference: left and right
are exchanged where the sides differ. A vehicle's sideways motion is a curvature, so that a slow one does not swerve as
a fast one.

`vpsci people` makes a bank of a near-miss table (`vpsci_ros.policy.make_bank`); its file is safetensors. With
`--forecast` it also holds a forecast of what both agents do on average. `vpsci_ros.policy.choice` chooses a reaction
for an agent.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.forecast import ACTIONS, SITUATION, Networks, forecasts, shapes
from vpsci_ros.policy.onset_range import LEVELS, QUANTITIES
from vpsci_ros.policy.tensor_file import read_tensors, tensors_to_bytes
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import to_heading_frame

FAMILY = "vpsci-people"
FORMAT = f"{FAMILY} 4"  # 3: no forecast
FEATURES = 8  # numbers of what makes a situation like another one
SLOWEST = 1.0  # [m/s] a slower vehicle steers as at this speed

Floats = NDArray[np.float64]


class Reactions(NamedTuple):
    """M recorded situations and S recorded steps of 0.1 s, for one source.

    :ivar features: float64[8, M], see `features_of`, each divided by `scale`.
    :ivar scale: float64[8], standard deviation of each feature over the onsets.
    :ivar side: float64[M], 1 where the pedestrian was to the left of the vehicle, else -1.
    :ivar begin, end: int64[M], the steps of a reaction: the situation, and one past the end of its track.
    :ivar steps: float64[S, 4], see `ACTIONS`.
    :ivar before: float64[M, 4], what both did in the step before the situation, see `ACTIONS`.
    :ivar reach: float64[4, 5], quantiles of the onsets, see `vpsci_ros.policy.onset_range`.
    :ivar far: float64[M], added to the squared distance of each situation: 0, or more for a situation of another
        source, which serves where the own source has nothing like it.
    :ivar unseen_by: int64[M], the network of the forecast that has not seen the reaction's clip.
    :ivar networks: of the forecast.
    :ivar means: float64[M, 30, 4], the forecast after each situation by that network, see `ACTIONS`; float64[M, 0, 4]
        without a forecast. A bank's file does not hold it.
    """

    features: Floats
    scale: Floats
    side: Floats
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    steps: Floats
    before: Floats
    reach: Floats
    far: Floats
    unseen_by: NDArray[np.int64]
    networks: Networks
    means: Floats


@dataclass(frozen=True)
class Bank:
    """Reactions by source, of which the first is the default; `facts` describes the bank's recordings."""

    reactions: Mapping[str, Reactions]
    facts: Mapping[str, Any] = field(default_factory=dict)

    def of(self, people: str = "") -> Reactions:
        """Return the reactions of one source; without a name, of the first.

        :raises InvalidInput: the bank does not have this source.
        """
        if people and people not in self.reactions:
            raise InvalidInput(
                f"people: expected one of {', '.join(self.reactions)}, the sources of this bank, got {people!r}"
            )
        return self.reactions[people or next(iter(self.reactions))]

    def digest(self) -> str:
        """Return the SHA-256 of the bank's file, as hexadecimal digits."""
        return hashlib.sha256(bank_to_bytes(self)).hexdigest()


def source_of(name: str) -> str:
    """Return the bank's source for near misses of "source" or "source/clip": the name up to a hyphen.

    Recordings of one kind of place share it, as vci-dut and vci-citr do, and each other's reactions.
    """
    return name.partition("/")[0].partition("-")[0]


def situations_of(observed: NDArray[Any], vehicle: NDArray[Any], pedestrian: NDArray[Any]) -> Floats:
    """Return situations, float64[..., 9], from the vehicle's observations and both agents' last accelerations.

    Speed, acceleration and yaw rate of the vehicle [m/s, m/s2, rad/s], then place [m], velocity [m/s] and acceleration
    [m/s2] of the pedestrian in the vehicle's heading frame, forward and left each.

    :param observed: float[..., 6], what the vehicle observes, equation (6).
    :param vehicle, pedestrian: float[..., 2], accelerations forward and left [m/s2]; NaN where they are not known.
    """
    seen = np.asarray(observed, np.float64)
    turn = vehicle[..., 1:] / np.maximum(seen[..., :1], SLOWEST)
    parts = seen[..., :1], vehicle[..., :1], turn, -seen[..., 2:4], seen[..., 0:2] - seen[..., 4:6], pedestrian
    return np.concatenate(parts, axis=-1, dtype=np.float64)


@kernel
def situations_in(state, rows, walked, out):  # type: ignore[no-untyped-def]
    """Write the situations of EPISODE[B] where `rows`, bool[B], to `out`, float64[B, 9]; see `situations_of`.

    :param walked: float64[B, 2], acceleration of the pedestrian, east and north [m/s2]; NaN where it is not known.
    """
    for i in range(state.size):
        if rows[i]:
            slot, m = state[i], out[i]
            east, north = slot.pedestrian_x - slot.vehicle_x, slot.pedestrian_y - slot.vehicle_y
            m[0], m[1] = slot.vehicle_speed, slot.vehicle_acceleration
            m[2] = slot.vehicle_curvature * slot.vehicle_speed
            m[3], m[4] = to_heading_frame(slot.vehicle_heading, east, north)
            m[5], m[6] = to_heading_frame(slot.vehicle_heading, slot.pedestrian_vx, slot.pedestrian_vy)
            m[7], m[8] = to_heading_frame(slot.vehicle_heading, walked[i, 0], walked[i, 1])


@kernel
def features_of(situation, out):  # type: ignore[no-untyped-def]
    """Write the features of a situation, float64[9], to float64[8]; return the pedestrian's side, 1 or -1.

    An acceleration that is not known counts as 0.
    """
    walk_forward, walk_left = situation[5], situation[6]
    side = -1.0 if situation[4] < 0.0 else 1.0
    out[0], out[1] = situation[0], np.sqrt(walk_forward * walk_forward + walk_left * walk_left)
    out[2], out[3] = situation[3], situation[4] * side
    out[4], out[5] = walk_forward, walk_left * side
    known = not np.isnan(situation[1])
    out[6], out[7] = (situation[1], situation[2] * side) if known else (0.0, 0.0)
    return side


def describe(situations: Floats) -> tuple[Floats, Floats]:
    """Return the features of situations, float64[n, 8], and the pedestrians' sides, float64[n]."""
    features, side = np.empty((len(situations), FEATURES)), np.empty(len(situations))
    _describe(np.ascontiguousarray(situations), features, side)
    return features, side


@kernel
def _describe(situations, features, side):  # type: ignore[no-untyped-def]
    for i in range(side.size):
        side[i] = features_of(situations[i], features[i])


def with_means(own: Reactions) -> Reactions:
    """Return reactions with their `means`, the forecasts after their situations."""
    features, situations = own.features.T * own.scale, np.empty((len(own.side), SITUATION))
    situations[:, [0, 3, 5]], situations[:, [4, 6]] = features[:, [0, 2, 4]], features[:, [3, 5]] * own.side[:, None]
    situations[:, [1, 2, 7, 8]] = own.before
    situations[:, 2] *= np.maximum(situations[:, 0], SLOWEST)
    return own._replace(means=forecasts(own.networks, own.unseen_by, situations))


def bank_to_bytes(bank: Bank) -> bytes:
    """Return the bytes of a bank's file; equal banks give equal bytes."""
    tensors = {
        f"{people}.{name}": np.ascontiguousarray(value, np.float32)
        for people, reactions in bank.reactions.items()
        for name, value in (reactions._asdict() | reactions.networks._asdict()).items()
        if name not in ("networks", "means")
    }
    return tensors_to_bytes(tensors, FORMAT, {"people": list(bank.reactions), **bank.facts})


def save_bank(path: str | Path, bank: Bank) -> None:
    """Write a bank's file, whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(bank_to_bytes(bank))


def bank_from_bytes(data: bytes, where: str = "bank") -> Bank:
    """Return the bank in the bytes of its file; `where` opens the error messages.

    :raises InvalidInput: not a bank, a damaged file, or parts that do not fit together.
    """
    tensors, facts = read_tensors(data, FORMAT, where, "make the bank again of its near misses (`vpsci people`)")
    names = facts.pop("people", None)
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise InvalidInput(f"{where}: expected the names of its people in the metadata, got {names!r}")
    return Bank({name: _reactions(tensors, name, where) for name in names}, facts)


def _reactions(tensors: Mapping[str, NDArray[np.float32]], people: str, where: str) -> Reactions:
    parts: dict[str, Any] = {}
    for name in (*Reactions._fields[:-2], *Networks._fields):
        if f"{people}.{name}" not in tensors:
            raise InvalidInput(f"{where}: tensor {people}.{name} is missing; make the bank again (`vpsci people`)")
        whole = name in ("begin", "end", "unseen_by")
        parts[name] = tensors[f"{people}.{name}"].astype(np.int64 if whole else np.float64)
    count, steps = len(parts["side"]), len(parts["steps"])
    wanted = [
        (FEATURES, count), (FEATURES,), (count,), (count,), (count,), (steps, ACTIONS), (count, ACTIONS),
        (len(QUANTITIES), len(LEVELS)), (count,), (count,),
    ]  # fmt: skip
    number, width = (*parts["entry_bias"].shape, 0, 0)[:2]
    wanted += [(number, *shape) for shape in shapes(width)]
    for (name, value), shape in zip(parts.items(), wanted, strict=True):
        if value.shape != shape:
            raise InvalidInput(f"{where}: tensor {people}.{name}: expected shape {shape}, got {value.shape}")
    networks = Networks(*(parts.pop(name) for name in Networks._fields))
    own = Reactions(**parts, networks=networks, means=np.zeros((count, 0, ACTIONS)))
    right = (own.begin >= 0) & (own.begin < own.end) & (own.end <= steps) & (np.abs(own.side) == 1.0) & (own.far >= 0.0)
    right &= (own.unseen_by >= 0) & (own.unseen_by < max(number, 1))
    if count == 0 or not right.all() or not (own.scale > 0.0).all() or (np.diff(own.reach, axis=1) < 0.0).any():
        raise InvalidInput(f"{where}: the reactions of {people!r} do not fit together; make the bank again")
    return with_means(own)
