"""Observations of the two agents, equations (6) and (7), in the vehicle's heading frame.

Both agents' observations and actions are given in the vehicle's heading frame at the instant, (forward, left) for the
paper's (longitudinal y, lateral x), longitudinal first:

    O_veh = (v_veh^f, v_veh^l, d_vp^f, d_vp^l, dv_vp^f, dv_vp^l),  d_vp = p_veh - p_ped,  dv_vp = v_veh - v_ped
    O_ped = (v_ped^f, v_ped^l, d_pv^f, d_pv^l, dv_pv^f, dv_pv^l),  d_pv = -d_vp,          dv_pv = -dv_vp

so that (10)-(13) hold between the velocities and the relative velocities. Rows are computed one by one in scalar
code: a row's bits depend neither on the other rows nor on its place, and arithmetic is float64 up to the last
rounding.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.compiled import kernel

Observations: TypeAlias = NDArray[np.float32]
Floats: TypeAlias = NDArray[np.float64]
AGENTS = ("vehicle", "pedestrian")
OBSERVATION_SIZE = 6
ACTION_SIZE = 2
STEP = 0.1  # [s] of the policies, and of recordings


@kernel
def to_heading_frame(heading: float, east: float, north: float) -> tuple[float, float]:
    """Return the (forward, left) components of an (east, north) vector for a `heading` [rad]."""
    c, s = math.cos(heading), math.sin(heading)
    return c * east + s * north, c * north - s * east


def arrays_to_heading_frame(heading: Floats, vectors: Floats) -> Floats:
    """Return the (forward, left) components float64[..., 2] of (east, north) vectors for headings float64[...] [rad].

    `to_heading_frame` for arrays. Numpy's sine and cosine may differ from those of compiled code in the last bit.
    """
    c, s = np.cos(heading), np.sin(heading)
    east, north = vectors[..., 0], vectors[..., 1]
    return np.stack([c * east + s * north, c * north - s * east], axis=-1)


@kernel
def from_heading_frame(heading: float, forward: float, left: float) -> tuple[float, float]:
    """Return the (east, north) components of a (forward, left) vector for a `heading` [rad]."""
    c, s = math.cos(heading), math.sin(heading)
    return c * forward - s * left, s * forward + c * left


@kernel
def _observe_pair(x, y, heading, vf, vl, ped_x, ped_y, ped_vx, ped_vy, vehicle, pedestrian):  # type: ignore[no-untyped-def]
    """Fill in what two agents observe, float32[6] each; the vehicle's velocity is (forward, left)."""
    df, dl = to_heading_frame(heading, x - ped_x, y - ped_y)
    pf, pl = to_heading_frame(heading, ped_vx, ped_vy)
    vehicle[0], vehicle[1] = vf, vl
    vehicle[2], vehicle[3] = df, dl
    vehicle[4], vehicle[5] = vf - pf, vl - pl
    pedestrian[0], pedestrian[1] = pf, pl
    pedestrian[2], pedestrian[3] = -df, -dl
    pedestrian[4], pedestrian[5] = pf - vf, pl - vl


@kernel
def _observe_arrays(x, y, heading, forward, left, ped_x, ped_y, ped_vx, ped_vy, vehicle, pedestrian):  # type: ignore[no-untyped-def]
    for i in range(x.size):
        car, walker = (x[i], y[i], heading[i], forward[i], left[i]), (ped_x[i], ped_y[i], ped_vx[i], ped_vy[i])
        _observe_pair(*car, *walker, vehicle[i], pedestrian[i])


@kernel
def _observe(state, rows, vehicle, pedestrian):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        if not rows[i]:
            continue
        slot = state[i]
        car = slot.vehicle_x, slot.vehicle_y, slot.vehicle_heading, slot.vehicle_speed, 0.0
        walker = slot.pedestrian_x, slot.pedestrian_y, slot.pedestrian_vx, slot.pedestrian_vy
        _observe_pair(*car, *walker, vehicle[i], pedestrian[i])


def observe(state: NDArray[np.void], rows: NDArray[np.bool_] | None = None) -> tuple[Observations, Observations]:
    """Return the observations of vehicle and pedestrian, float32[B, 6] each, of EPISODE[B] records.

    The simulated vehicle moves along its heading, so its lateral speed is 0 (equations 6 and 7).

    :param rows: bool[B], rows to compute, zeros elsewhere; None: all.
    """
    vehicle, pedestrian = (np.zeros((len(state), OBSERVATION_SIZE), np.float32) for _ in range(2))
    _observe(state, np.ones(len(state), np.bool_) if rows is None else rows, vehicle, pedestrian)
    return vehicle, pedestrian


def observe_arrays(
    vehicle_x: ArrayLike,
    vehicle_y: ArrayLike,
    vehicle_heading: ArrayLike,
    vehicle_vx: ArrayLike,
    vehicle_vy: ArrayLike,
    pedestrian_x: ArrayLike,
    pedestrian_y: ArrayLike,
    pedestrian_vx: ArrayLike,
    pedestrian_vy: ArrayLike,
) -> tuple[Observations, Observations]:
    """Return the observations of both agents, float32[..., 6] each, from recorded positions and velocities.

    All arguments are float[...] of one shape: positions [m] and velocities [m/s] east and north, heading [rad]. A
    recorded vehicle may move sideways a little, so its whole velocity is taken (equations 6 and 7).

    :raises InvalidInput: the shapes differ.
    """
    arguments = [vehicle_x, vehicle_y, vehicle_heading, vehicle_vx, vehicle_vy]
    arguments += [pedestrian_x, pedestrian_y, pedestrian_vx, pedestrian_vy]
    arrays = [np.asarray(a, dtype=np.float64) for a in arguments]
    shape = arrays[0].shape
    if any(a.shape != shape for a in arrays):
        raise InvalidInput(f"observe_arrays: expected one shape for all nine arrays, got {[a.shape for a in arrays]}")
    x, y, heading, vx, vy, *pedestrian = (np.ascontiguousarray(a).reshape(-1) for a in arrays)
    forward, left = np.empty_like(x), np.empty_like(x)
    _rotate(heading, vx, vy, forward, left)
    vehicle_out = np.empty((x.size, OBSERVATION_SIZE), np.float32)
    pedestrian_out = np.empty_like(vehicle_out)
    _observe_arrays(x, y, heading, forward, left, *pedestrian, vehicle_out, pedestrian_out)
    return vehicle_out.reshape(*shape, OBSERVATION_SIZE), pedestrian_out.reshape(*shape, OBSERVATION_SIZE)


@kernel
def _rotate(heading, east, north, forward, left):  # type: ignore[no-untyped-def]
    for i in range(heading.size):
        forward[i], left[i] = to_heading_frame(heading[i], east[i], north[i])
