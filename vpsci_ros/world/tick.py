"""The values of one tick: the world's `Tick`, the monitor's `Assessment` of it, the agents' `Actions`.

Answers are checked once: an `Assessment` in `Tick.assessed`, `Actions` in their constructor.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import handover
from vpsci_ros.world.compiled import kernel

Floats = NDArray[np.float64]


class Assessment(NamedTuple):
    """The safety monitor's values of a tick and the rows in which policies act; made by a `Tick`."""

    curvttc: Floats  # [B] [s], infinity where there is none
    distance: Floats  # [B] [m] between the two centres, NaN where it is not known
    critical: NDArray[np.bool_]  # [B]
    acting: NDArray[np.bool_]  # [B] the policies act now, see `handover.acting`
    answered: bool  # false: the monitor did not answer, so nothing counts as critical


class Tick(NamedTuple):
    """The world at one tick, as it is published."""

    number: int  # counted from the beginning of the run
    state: NDArray[np.void]  # EPISODE[B]
    policy_frame: NDArray[np.bool_]  # [B] policies would act, see `handover.policy_frame`
    by_policies: bool = True  # policies drive an agent, or both

    def assessed(self, curvttc: ArrayLike, distance: ArrayLike, critical: ArrayLike) -> Assessment:
        """Return the assessment of this tick, made from the monitor's answer.

        :param curvttc: float[B] [s]; distance: float[B] [m]; critical: bool[B] or uint8[B].
        :raises InvalidInput: another shape, or a CurvTTC that is not a number.
        """
        batch = len(self.state)
        ttc = _floats("curvttc", curvttc, (batch,))
        if has_nan(ttc):
            raise InvalidInput(f"curvttc of slot {int(np.argmax(np.isnan(ttc)))} is not a number")
        alarms = np.asarray(critical)
        if alarms.shape != (batch,):
            raise InvalidInput(f"critical: expected shape ({batch},), got {alarms.shape}")
        alarms = np.ascontiguousarray(alarms, np.bool_)
        return Assessment(
            curvttc=ttc,
            distance=_floats("distance", distance, (batch,)),
            critical=alarms,
            acting=self._acting(alarms),
            answered=True,
        )

    def unassessed(self) -> Assessment:
        """Return the assessment of this tick without an answer of the monitor: CurvTTC infinite, nothing critical."""
        batch = len(self.state)
        none = np.zeros(batch, np.bool_)
        return Assessment(
            curvttc=np.full(batch, np.inf),
            distance=np.full(batch, np.nan),
            critical=none,
            acting=self._acting(none),
            answered=False,
        )

    def _acting(self, critical: NDArray[np.bool_]) -> NDArray[np.bool_]:
        if self.by_policies:
            return handover.acting(self.state, self.policy_frame, critical)
        return np.zeros(len(self.state), np.bool_)


@dataclass(frozen=True)
class Actions:
    """The agents' actions at a tick, in the vehicle's heading frame; None for a missing answer.

    :raises InvalidInput: another shape, or numbers that are not finite.
    """

    vehicle: Floats | None = None  # [B, 2] (longitudinal, lateral) [m/s2]
    pedestrian: Floats | None = None  # [B, 2] likewise
    vehicle_control: Floats | None = None  # [B, 3] (steer -1..1 to the left, throttle 0..1, brake 0..1)

    def __post_init__(self) -> None:
        for name, columns in (("vehicle", 2), ("pedestrian", 2), ("vehicle_control", 3)):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, _finite(name, values, columns))

    def of(self, agent: str) -> Floats | None:
        """Return the accelerations of "vehicle" or "pedestrian", see `Actions`."""
        return self.vehicle if agent == "vehicle" else self.pedestrian


NO_ACTIONS = Actions()


class Step(NamedTuple):
    """One tick as a whole: the tick, its assessment, the actions and the events."""

    tick: Tick
    assessment: Assessment
    actions: Actions
    events: NDArray[np.void]  # EVENT[n] of the move to the next tick

    @property
    def state(self) -> NDArray[np.void]:
        """State of the tick, EPISODE[B]."""
        return self.tick.state

    @property
    def curvttc(self) -> Floats:
        """CurvTTC of the assessment, float64[B] [s]."""
        return self.assessment.curvttc

    @property
    def distance(self) -> Floats:
        """Distance of the centres of the assessment, float64[B] [m]."""
        return self.assessment.distance


@kernel
def has_nan(values):  # type: ignore[no-untyped-def]
    """Return whether float64[n] contains NaN."""
    found = False
    for value in values:
        found |= math.isnan(value)
    return found


@kernel
def _all_finite(rows):  # type: ignore[no-untyped-def]
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            if not math.isfinite(rows[i, j]):
                return False
    return True


def _floats(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InvalidInput(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def finite_pairs(agent: str, values: ArrayLike) -> Floats:
    """Return the accelerations of "vehicle" or "pedestrian", float64[B, 2] [m/s2].

    :raises InvalidInput: another shape, or numbers that are not finite.
    """
    return _finite(agent, values, 2)


def _finite(name: str, values: ArrayLike, columns: int) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != (len(array), columns):
        raise InvalidInput(f"actions.{name}: expected shape ({len(array)}, {columns}), got {array.shape}")
    if not _all_finite(array):
        slot = int(np.argwhere(~np.isfinite(array))[0, 0])
        raise InvalidInput(f"actions.{name} of slot {slot}: expected finite numbers, got {array[slot]}")
    return array
