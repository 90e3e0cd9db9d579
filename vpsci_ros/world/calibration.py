"""Recorded distributions at onsets: speeds, accelerations and lines of drivers and walkers.

The onset is the first step of 0.1 s with CurvTTC below 5 s. There are two calibrations.

`spawn: human`, of a campus where cars drive straight on: quantile tables of 158 near misses of 31 clips of VCI-DUT and
VCI-CITR (Yang et al., IV 2019, arXiv 1902.00487) whose car moves and which do not begin critical. They are inverted at
a uniform number, so that a draw has the recorded distribution without a formula for it.

`spawn: right_turns`: `right_turns()`, the joint states of near misses of the training part of CQUT-PVI (Zhang et al.,
T-ITS 2024, doi 10.1109/TITS.2024.3398648) up to their onset, drawn one at a time, for they depend on each other.

`python benchmarks/onsets.py` fits both again and compares; docs/world.md has n, intervals and sources.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.resources import recorded_onsets_path
from vpsci_ros.world.compiled import kernel

SHARES = np.array([0.0, 0.05, 0.10, 0.25, 0.50, 0.75, 0.90, 0.95, 1.0])  # of the people, for the tables below
CAR_SPEED = np.array([0.42, 0.69, 0.87, 1.39, 1.92, 2.68, 4.41, 5.16, 5.60])  # [m/s]
CAR_ACCELERATION = np.array([-0.82, -0.42, -0.28, -0.05, 0.01, 0.12, 0.28, 0.49, 0.92])  # [m/s2] of the second before
WALKING_SPEED = np.array([0.60, 0.89, 0.96, 1.10, 1.23, 1.34, 1.43, 1.54, 1.80])  # [m/s]
WALKING_ACCELERATION = np.array([-0.69, -0.44, -0.24, -0.09, -0.02, 0.05, 0.21, 0.46, 0.80])  # [m/s2] likewise
# [rad] of a walker's line, from straight across and along with the car
OBLIQUE = np.radians([-30.0, -16.0, -12.0, -5.0, 2.0, 11.0, 27.0, 30.0, 30.0])
BESIDE = np.array([0.0, 0.12, 0.20, 0.50, 0.82, 0.98, 1.10, 1.20, 1.40])  # their miss: 1, they graze

# the columns of `right_turns`
BEFORE, TTC, AHEAD, LEFT, TURNS, WAY, TRACK = range(7)
CAR, CURVATURE, WALK_ALONG, WALK_LEFT, COLUMNS = range(5)
HISTORY = 10
SLOPE, SLOPE_SPREAD = 0.40, 0.25  # [m/m] mean and standard deviation of the line of a walker who joins, with the car

CAR_PERIOD, WALK_PERIOD = 8.0, 4.0  # [s] in which a car's and a walker's speed goes up and down
LEAST_CAR, GREATEST_CAR = 0.4, 5.6  # [m/s]
LEAST_WALK, GREATEST_WALK = 0.4, 1.9  # [m/s]
OBLIQUE_FROM, STRAIGHTENS = 12.0, 3.0  # [m] before and beyond the crossing, between which a line is oblique
START_ACCELERATION = 0.9  # [m/s2] of somebody who sets off from the kerb
LATERAL_COMFORT, LATERAL_SPREAD = 1.9, 0.35  # [m/s2] mean and standard deviation sideways in the bend
TURNING_DECELERATION = 0.6  # into the bend, as a share of what a driver accepts sideways
# [m/s2] the strongest acceleration over half a second, of the same recordings: 219 drivers who gain 0.5 m/s after the
# last critical step, and 67 walkers who set off again
DRIVES_ON = np.array([0.43, 0.65, 0.74, 0.99, 1.33, 1.75, 2.29, 2.53, 3.69])
STRIDES = np.array([0.54, 0.64, 0.75, 0.82, 1.12, 1.48, 1.70, 2.08, 3.18])
DRIVE_ON = 2.0  # [m/s] faster than at the onset
CAR_WAVE, CAR_WANDER = 20.0, 0.09  # [m] wavelength and size (each of sine and cosine) of a car's sway in its lane
WALK_WAVE, WALK_WANDER = 8.0, 0.20  # [m] likewise of a walker's
WAITING = 0.06  # share of walkers who wait at the kerb and set off before it becomes critical
JERK = 10.0  # [m/s3] with which an agent's acceleration can change


@cache
def right_turns() -> NDArray[np.float64]:
    """Return the recorded onsets of right turns, float64[N, 50], one a row.

    First: steps recorded before it, 5 to 10; CurvTTC [s]; where the walker is, ahead of the car's centre and to its
    left [m]; by how much the car turns to the left [rad] and how far it drives [m] in the 3 s after. Then for each of
    `HISTORY` steps of 0.1 s before, and of the onset: the car's speed [m/s], its curvature to the left [1/m], and the
    walker's velocity along the car's heading at the onset and to its left [m/s].
    """
    onsets = np.loadtxt(recorded_onsets_path(), delimiter=",")
    onsets.flags.writeable = False
    return onsets


def mirrored(onsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows of `right_turns` seen in a mirror, as left turns."""
    sign = np.ones(onsets.shape[1])
    sign[[LEFT, TURNS]] = -1.0
    sign[TRACK + CURVATURE :: COLUMNS] = sign[TRACK + WALK_LEFT :: COLUMNS] = -1.0
    return onsets * sign


@kernel
def quantile(values, share: float) -> float:  # type: ignore[no-untyped-def]
    """Return the quantile at `share` (0 to 1) of a table that holds the quantiles at `SHARES`, by interpolation."""
    i = 0
    while i < SHARES.size - 2 and share >= SHARES[i + 1]:
        i += 1
    return values[i] + (share - SHARES[i]) / (SHARES[i + 1] - SHARES[i]) * (values[i + 1] - values[i])


@kernel
def wavering(speed: float, acceleration: float, phase: float, period: float, time: float) -> float:
    """Return the speed [m/s] at `time` [s] of an agent that varies around `speed`, by up to `acceleration` [m/s2]."""
    return speed + acceleration * period / (2.0 * math.pi) * math.sin(2.0 * math.pi * (time / period + phase))


@kernel
def car_speed(speed: float, acceleration: float, phase: float, time: float) -> float:
    """Return the speed [m/s] at which a driver approaches, `time` [s] after the spawn."""
    return min(GREATEST_CAR, max(LEAST_CAR, wavering(speed, acceleration, phase, CAR_PERIOD, time)))


@kernel
def walking_pace(speed: float, acceleration: float, phase: float, time: float, moving: float, set_off: float) -> float:
    """Return the speed [m/s] of a walker, `time` [s] after the spawn and `moving` [s] after it set off from the kerb.

    :param set_off: acceleration [m/s2] with which it sets off.
    """
    fastest = max(GREATEST_WALK, speed)
    pace = min(fastest, max(LEAST_WALK, wavering(speed, acceleration, phase, WALK_PERIOD, time)))
    return min(pace, set_off * max(0.0, moving))


@kernel
def sway(sine: float, cosine: float, wave: float, s: float) -> float:
    """Return how far an agent sways to the left of its line [m] at arc length `s` [m]."""
    angle = 2.0 * math.pi * s / wave
    return sine * math.sin(angle) + cosine * math.cos(angle)


@kernel
def limited(wanted: float, before: float, period: float) -> float:
    """Return the acceleration [m/s2] nearest to the wanted one that the limit `JERK` allows after the one `before`."""
    return min(before + JERK * period, max(before - JERK * period, wanted))
