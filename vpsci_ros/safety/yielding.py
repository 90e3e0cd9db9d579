"""Who yielded: a rule for the classification that the paper made by eye (sections 4.2 and 4.6).

To yield is to slow down and let the other go first.

* The vehicle yielded if it lost a substantial part of its approach speed before the pedestrian had finished crossing
  ahead of it, and did not go first.
* The pedestrian yielded if, on its way across, it stopped or lost a substantial part of its walking speed before the
  vehicle was through, and did not go first.

Who went first is read off the paths: where the pedestrian's crosses the vehicle's (carried on straight, since a
vehicle that waits may never arrive), the one who was there first; where they do not cross, the vehicle if it has left
the pedestrian behind, and else it is open, so that both may have yielded. An agent that stood all along did not yield.
"""

import math
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import kernel
from vpsci_ros.safety.curvttc import CRITICAL_TTC
from vpsci_ros.safety.encroachment import first_crossing
from vpsci_ros.safety.footprint import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.safety.inputs import FloatLike, Floats
from vpsci_ros.safety.series import trajectories


class Yielded(IntFlag):
    """The agents that yielded in an episode; BOTH is VEHICLE | PEDESTRIAN."""

    NONE = 0
    VEHICLE = 1
    PEDESTRIAN = 2
    BOTH = 3


LOOKBACK = 3.0  # [s] before the onset, from when on approach speeds are sought
VEHICLE_DROP = 0.3  # part of its approach speed that a yielding vehicle loses
VEHICLE_MOVING = 0.5  # [m/s] an approach below this is a standing vehicle
PEDESTRIAN_DROP = 0.4  # part of its walking speed that a yielding pedestrian loses
PEDESTRIAN_MOVING = 0.3  # [m/s] an approach below this is a standing pedestrian
CROSSING_ANGLE = 0.5  # [rad] a pedestrian walking within this angle of the vehicle's path is not crossing
SETTLE = 1.0  # [s] after the pedestrian is clear, for which a vehicle still counts as slowing
AHEAD = 15.0  # [m] for which the vehicle's path is carried on straight


@kernel
def _approach(speed: Floats, look: int, start: int, stop: int) -> tuple[int, float]:
    """Return the step of the approach speed, and the part of it lost at the slowest step in [start, stop]."""
    slowest = start
    for k in range(start, stop + 1):
        if speed[k] < speed[slowest]:
            slowest = k
    fastest = look
    for k in range(look, slowest + 1):
        if speed[k] > speed[fastest]:
            fastest = k
    return fastest, 1.0 - speed[slowest] / speed[fastest] if speed[fastest] > 0.0 else 0.0


@kernel
def _behind(rows: tuple[Floats, ...], k: int, px: float, py: float) -> float:
    """Return how far the point (px, py) lies behind the vehicle's centre at step k [m], along its heading."""
    return (rows[0][k] - px) * math.cos(rows[2][k]) + (rows[1][k] - py) * math.sin(rows[2][k])


@kernel
def _first(
    rows: tuple[Floats, ...], look: int, begin: int, half_length: float
) -> tuple[float, int, tuple[float, float, float, float]]:
    """Return who goes first, the step at which the vehicle is through, and `first_crossing` from step `look` on.

    1 the pedestrian, 0 the vehicle (its rear is past the crossing point, or past the pedestrian, at a step from `begin`
    on), NaN open. Unless the vehicle goes first, its step is the last one.
    """
    x, y, heading, ped_x, ped_y = rows
    last = x.size - 1
    crossing = first_crossing(x[look:], y[look:], AHEAD, heading[last], ped_x[look:], ped_y[look:])
    driven, walked, cx, cy = crossing
    if walked < driven:  # false, too, where the paths do not cross
        return 1.0, last, crossing
    for k in range(begin, last + 1):
        px, py = (ped_x[k], ped_y[k]) if math.isnan(walked) else (cx, cy)
        if _behind(rows, k, px, py) > half_length:
            return 0.0, k, crossing
    return math.nan, last, crossing


@kernel
def _classify(rows: tuple[Floats, ...], dt: float, half_length: float, corridor: float) -> int:
    """Return `Yielded` of one episode; `corridor` is half the vehicle's width plus the pedestrian's radius [m]."""
    x, y, heading, speed, ped_x, ped_y, ped_vx, ped_vy, ttc = rows
    last = x.size - 1
    begin = 0
    while ttc[begin] > CRITICAL_TTC:
        begin += 1
        if begin > last:
            return 0
    look = max(0, begin - round(LOOKBACK / dt))
    paths = x, y, heading, ped_x, ped_y
    first, passed, (driven, walked, cx, cy) = _first(paths, look, begin, half_length)
    pedestrian_first, vehicle_first = first == 1.0, first == 0.0
    clear = last  # the last step at which slowing is for this pedestrian
    if pedestrian_first:
        clear = max(begin, min(last, look + math.ceil(walked)))
        while clear < last and math.hypot(ped_x[clear] - cx, ped_y[clear] - cy) < corridor:
            clear += 1
        clear = min(last, clear + round(SETTLE / dt))
        if driven < math.inf:
            clear = max(begin, min(clear, look + math.ceil(driven)))
    fast, lost = _approach(speed, look, begin, clear)
    vehicle_yields = not vehicle_first and speed[fast] > VEHICLE_MOVING and lost >= VEHICLE_DROP
    pace = np.hypot(ped_vx, ped_vy)
    fast, lost = _approach(pace, look, begin, passed)
    across = abs(math.cos(heading[passed]) * ped_vy[fast] - math.sin(heading[passed]) * ped_vx[fast])
    crossing = across >= pace[fast] * math.sin(CROSSING_ANGLE) and pace[fast] > PEDESTRIAN_MOVING
    confronted = speed[look : passed + 1].max() > VEHICLE_MOVING
    pedestrian_yields = not pedestrian_first and crossing and confronted and lost >= PEDESTRIAN_DROP
    return (1 if vehicle_yields else 0) + (2 if pedestrian_yields else 0)


@kernel
def _first_all(rows, lengths, half_length, out):  # type: ignore[no-untyped-def]
    for i in range(lengths.size):
        n = lengths[i]
        own = (rows[0][i, :n], rows[1][i, :n], rows[2][i, :n], rows[3][i, :n], rows[4][i, :n])
        out[i] = _first(own, 0, 0, half_length)[0]


def who_goes_first(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    *,
    lengths: ArrayLike | None = None,
) -> Floats:
    """Return who goes first, float64[...]: 1 the pedestrian, 0 the vehicle, NaN where it is open.

    The paths decide, see the text above. Parameters are those of `who_yielded`; give the steps from the onset on.

    :raises InvalidInput: values that are not finite, shapes that differ, or lengths that do not fit.
    """
    names = ("x", "y", "heading", "ped_x", "ped_y")
    rows, counts, shape = trajectories(names, (x, y, heading, ped_x, ped_y), lengths)
    out = np.empty(counts.size)
    _first_all(rows, counts, 0.5 * VEHICLE_LENGTH, out)
    return np.asarray(out.reshape(shape))


@kernel
def _classify_all(rows, lengths, dt, half_length, corridor, out):  # type: ignore[no-untyped-def]
    for i in range(lengths.size):
        n = lengths[i]
        x, y, heading, speed = rows[0][i, :n], rows[1][i, :n], rows[2][i, :n], rows[3][i, :n]
        ped_x, ped_y, ped_vx, ped_vy = rows[4][i, :n], rows[5][i, :n], rows[6][i, :n], rows[7][i, :n]
        own = (x, y, heading, speed, ped_x, ped_y, ped_vx, ped_vy, rows[8][i, :n])
        out[i] = _classify(own, dt, half_length, corridor)


def who_yielded(
    x: FloatLike,
    y: FloatLike,
    heading: FloatLike,
    speed: FloatLike,
    ped_x: FloatLike,
    ped_y: FloatLike,
    ped_vx: FloatLike,
    ped_vy: FloatLike,
    curvttc: FloatLike,
    *,
    dt: float,
    lengths: ArrayLike | None = None,
    length: float = VEHICLE_LENGTH,
    width: float = VEHICLE_WIDTH,
    radius: float = PEDESTRIAN_RADIUS,
) -> NDArray[np.uint8]:
    """Return who yielded in each episode, uint8[...] of `Yielded`; as by eye in 87 of 89 recorded near misses.

    :param x, y, heading, speed: the vehicle, float[..., T] [m], [m], [rad], [m/s]; one episode, or a padded batch. Give
        what is recorded before the onset too: approach speeds are read there.
    :param ped_x, ped_y, ped_vx, ped_vy: the pedestrian, float[..., T] [m] and [m/s].
    :param curvttc: float[..., T] [s], infinity where no contact is predicted.
    :param dt: time between steps [s].
    :param lengths: int[...], steps of each row that count; None: all T.
    :param length, width, radius: sizes [m], the same for all rows.
    :returns: uint8[...]: 0 nobody (or CurvTTC never critical), 1 the vehicle, 2 the pedestrian, 3 both.
    :raises InvalidInput: values that are not finite (CurvTTC: NaN), a speed or CurvTTC below 0, shapes that differ,
        lengths that do not fit, sizes or `dt` that are not positive.
    """
    for name, value in (("dt", dt), ("length", length), ("width", width), ("radius", radius)):
        if not 0.0 < value < math.inf:
            raise InvalidInput(f"{name} = {value}: expected a number above 0")
    names = ("x", "y", "heading", "speed", "ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc")
    given = (x, y, heading, speed, ped_x, ped_y, ped_vx, ped_vy, curvttc)
    rows, counts, shape = trajectories(
        names, given, lengths, not_negative=("speed", "curvttc"), may_be_infinite=("curvttc",)
    )
    out = np.zeros(counts.size, np.uint8)
    _classify_all(rows, counts, float(dt), 0.5 * length, 0.5 * width + radius, out)
    return out.reshape(shape)[()]
