"""The inputs of one step: checked states of all road users, completed from the previous step.

Positions are metres in a right-handed frame, x east and y north; angles are radians, counter-clockwise from x (REP
103). docs/pedestrian.md has the conversions from other engines' frames.
"""

import math
from collections.abc import Hashable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, curvature_from_yaw_rate
from vpsci_ros.safety.inputs import as_floats
from vpsci_ros.safety.line_of_sight import BOX, as_boxes
from vpsci_ros.world.kinematics import SHARPEST_TURN, drive, steer_to

LONGEST_PERIOD = 2.0  # [s]
LEAST_PERIOD = 1e-3  # [s]
GREATEST = 2e7  # [m, m/s, ...] of any number: no place on earth has greater metric coordinates


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


State = TypeVar("State", Vehicle, Walker)


def checked(who: str, given: Any, kind: type[State]) -> State:
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


def checked_all(what: str, given: Any, kind: type[State]) -> dict[Hashable, State]:
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


def as_points(given: Any) -> NDArray[np.float64]:
    """Return numbers [m] as an array; an empty one for what are no numbers, not finite or beyond `GREATEST`."""
    try:
        points = np.array(given, np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
    return points if (np.abs(points) <= GREATEST).all() else np.empty(0)


def completed(now: Vehicle, last: Vehicle | None, since: float) -> Vehicle:
    """Return a vehicle with curvature and acceleration; one that reverses as one that drives forward the other way.

    :param last: what was returned `since` [s] ago; None: the vehicle is new.
    """
    if now.speed < 0.0:  # its rectangle is the same
        signed = {name: getattr(now, name) for name in ("speed", "curvature", "acceleration")}
        signed = {name: -value for name, value in signed.items() if value is not None}
        now = now._replace(heading=now.heading + math.pi, **signed)
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


def driven_on(vehicle: Vehicle, time: float) -> Vehicle:
    """Return a vehicle predicted `time` [s] ahead, at the same speed on the same arc."""
    if time == 0.0:
        return vehicle
    assert vehicle.curvature is not None
    x, y, heading, _, _ = drive(*vehicle[:4], steer_to(vehicle.curvature), 0.0, 0.0, time)
    return vehicle._replace(x=x, y=y, heading=heading)


def walked_on(walkers: Iterable[Walker], time: float) -> list[Walker]:
    """Return pedestrians predicted `time` [s] ahead at the same velocity."""
    return [w._replace(x=w.x + w.vx * time, y=w.y + w.vy * time) for w in walkers]
