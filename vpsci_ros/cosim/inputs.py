"""The inputs of one step: checked states of all road users, completed from the previous step.

Positions are metres in a right-handed frame, x east and y north; angles are radians, counter-clockwise from x (REP
103). docs/pedestrian.md has the conversions from other engines' frames.
"""

import math
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.documents import require_form, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, curvature_from_yaw_rate
from vpsci_ros.safety.inputs import as_floats
from vpsci_ros.safety.line_of_sight import BOX, as_boxes
from vpsci_ros.world import Scenario, WorldConfig
from vpsci_ros.world.kinematics import SHARPEST_TURN, drive, steer_to

LONGEST_PERIOD = 2.0  # [s]
LEAST_PERIOD = 1e-3  # [s]
GREATEST = 2e7  # [m, m/s, ...] of any number: no place on earth has greater metric coordinates
_KINDS: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("seed", "episode", "number"), (int, np.integer)),
    "scenario": (int, str, Path, Scenario, type(None)),
    "speed": (float, int, np.number, type(None)),
    "config": (WorldConfig, type(None)),
    "policy": (PolicyConfig, type(None)),
}  # of an agent's constructor


def require_kinds(who: str, given: Mapping[str, Any]) -> None:
    """Refuse an argument of a wrong type to the constructor of `Pedestrian` or `Driver`.

    :raises InvalidInput: an argument of a wrong type; the message names the first one.
    """
    require_form(given, {name: kinds for name, kinds in _KINDS.items() if name in given}, who)


class Vehicle(NamedTuple):
    """A vehicle at an instant: place, heading, speed, curvature of its path, acceleration and size.

    :ivar x, y: centre of its rectangle [m].
    :ivar heading: [rad] of its front.
    :ivar speed: [m/s] along the heading; below 0: it reverses.
    :ivar curvature: of its path [1/m], positive to the left: yaw rate over speed. None: from the change of heading
        since the last step, 0 at the first step; for the own vehicle of `Driver.step`: its last curvature.
    :ivar acceleration: along the heading [m/s2]. None: from the change of speed, likewise.
    :ivar length, width: of its rectangle [m].
    """

    x: float
    y: float
    heading: float
    speed: float
    curvature: float | None = None
    acceleration: float | None = None
    length: float = VEHICLE_LENGTH
    width: float = VEHICLE_WIDTH


class Walker(NamedTuple):
    """A pedestrian at an instant: centre of its disc [m] and velocity [m/s]."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0


Agent = TypeVar("Agent", Vehicle, Walker)


def checked(who: str, given: Any, kind: type[Agent]) -> Agent:
    """Check a `Vehicle` or `Walker`, and return it with its numbers as floats; `who` opens messages.

    :raises InvalidInput: another type, a number that is not finite or beyond `GREATEST`, or a size that is not above 0.
    """
    if not isinstance(given, kind):
        raise InvalidInput(f"{who}: expected a vpsci_ros.{kind.__name__}, got {type(given).__name__}")
    values: list[Any] = []
    for name, value in given._asdict().items():
        if value is None and kind is Vehicle and name in ("curvature", "acceleration"):
            values.append(None)
            continue
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not abs(number) <= GREATEST:
            raise InvalidInput(f"{who}: {name} = {shown(value)}: expected a finite number, {GREATEST:g} at most")
        if name in ("length", "width") and number <= 0.0:
            raise InvalidInput(f"{who}: {name} = {number:g} m: expected a size above 0")
        values.append(number)
    return kind(*values)


def checked_all(what: str, given: Any, kind: type[Agent]) -> dict[Hashable, Agent]:
    """Check vehicles or pedestrians by key, and return them with their numbers as floats.

    :raises InvalidInput: not a mapping, or as `checked`.
    """
    if not isinstance(given, Mapping):
        raise InvalidInput(
            f"{what}s: expected a mapping from who it is to a vpsci_ros.{kind.__name__}, such as {{'a': ...}}, got "
            f"{type(given).__name__}"
        )
    return {key: checked(f"{what} {key!r}", value, kind) for key, value in given.items()}


def checked_parked(given: ArrayLike | None) -> NDArray[np.float64] | None:
    """Check parked vehicles and return float64[K, 5]: x, y [m], heading [rad], length, width [m]; None for None.

    :raises InvalidInput: another shape, numbers not finite or beyond `GREATEST`, or sizes that are not above 0.
    """
    if given is None:
        return None
    boxes = as_floats("parked", given)
    if (np.abs(boxes) > GREATEST).any():
        raise InvalidInput(f"parked: expected numbers from {-GREATEST:g} to {GREATEST:g}, got {shown(boxes.tolist())}")
    return np.zeros((0, BOX)) if boxes.size == 0 else as_boxes(boxes)


def checked_period(period: Any) -> int:
    """Check a time step [s] and return it in nanoseconds.

    :raises InvalidInput: not a number of seconds from 0.001 to 2.
    """
    if isinstance(period, bool) or not isinstance(period, (int, float)) or not LEAST_PERIOD <= period <= LONGEST_PERIOD:
        raise InvalidInput(
            f"period = {shown(period)}: expected the time to the next step [s], "
            f"from {LEAST_PERIOD:g} to {LONGEST_PERIOD:g}"
        )
    return round(period * 1e9)


class Tracks:
    """The vehicles of the previous step, from which missing curvatures and accelerations are computed."""

    def __init__(self) -> None:
        self._last: dict[Hashable, Vehicle] = {}

    def completed(self, vehicles: dict[Hashable, Vehicle], since: float) -> dict[Hashable, Vehicle]:
        """Return vehicles with curvature and acceleration filled in; a reversing one as driving forward the other way.

        :param since: time since the previous step [s]; 0 at the first step.
        """
        self._last = {key: self._complete(_forward(each), key, since) for key, each in vehicles.items()}
        return self._last

    def _complete(self, now: Vehicle, key: Hashable, since: float) -> Vehicle:
        last = self._last.get(key)
        curvature, acceleration = 0.0, 0.0
        if last is not None and since > 0.0:
            turned = math.remainder(now.heading - last.heading, 2.0 * math.pi)
            pace = 0.5 * (now.speed + last.speed)
            curvature = float(np.clip(curvature_from_yaw_rate(turned / since, pace), -SHARPEST_TURN, SHARPEST_TURN))
            acceleration = (now.speed - last.speed) / since
        return now._replace(
            curvature=curvature if now.curvature is None else now.curvature,
            acceleration=acceleration if now.acceleration is None else now.acceleration,
        )


def _forward(vehicle: Vehicle) -> Vehicle:
    """Return a vehicle that reverses as one that drives the other way; its rectangle is the same."""
    if vehicle.speed >= 0.0:
        return vehicle
    return vehicle._replace(
        heading=vehicle.heading + math.pi,
        speed=-vehicle.speed,
        curvature=None if vehicle.curvature is None else -vehicle.curvature,
        acceleration=None if vehicle.acceleration is None else -vehicle.acceleration,
    )


def driven_on(vehicle: Vehicle, time: float) -> Vehicle:
    """Return a vehicle predicted `time` [s] ahead, at the same speed on the same arc."""
    if time == 0.0:
        return vehicle
    assert vehicle.curvature is not None
    place = vehicle.x, vehicle.y, vehicle.heading, vehicle.speed
    x, y, heading, _, _ = drive(*place, steer_to(vehicle.curvature), 0.0, 0.0, time)
    return vehicle._replace(x=x, y=y, heading=heading)


def walked_on(walkers: Iterable[Walker], time: float) -> list[Walker]:
    """Return pedestrians predicted `time` [s] ahead at the same velocity."""
    return [w._replace(x=w.x + w.vx * time, y=w.y + w.vy * time) for w in walkers]
