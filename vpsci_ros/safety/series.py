"""Checks of series over time, float[..., T]: one episode, or a padded batch with the length of each row."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.inputs import FloatLike, Floats, as_floats, place


def checked_lengths(lengths: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the `lengths` of rows of an array of `shape` [..., T] as int64[...]; all T where None is given.

    :raises InvalidInput: a shape without steps, or lengths that are not whole numbers of 1 to T, one for each row.
    """
    if not shape or shape[-1] == 0:
        raise InvalidInput(f"expected arrays [..., T] with at least one step, got shape {shape}")
    if lengths is None:
        return np.full(shape[:-1], shape[-1], np.int64)
    given = np.asarray(lengths)
    if given.shape != shape[:-1] or given.dtype.kind not in "iu":
        raise InvalidInput(f"lengths: expected whole numbers of shape {shape[:-1]}, got {given.dtype} {given.shape}")
    bad = (given < 1) | (given > shape[-1])
    if bad.any():
        raise InvalidInput(f"lengths{place(bad)} = {given[bad][0]}: expected 1 to {shape[-1]} steps")
    return given.astype(np.int64)


def trajectories(
    names: Sequence[str],
    values: Sequence[FloatLike],
    lengths: ArrayLike | None,
    *,
    not_negative: Iterable[str] = (),
    may_be_infinite: Iterable[str] = (),
) -> tuple[tuple[Floats, ...], NDArray[np.int64], tuple[int, ...]]:
    """Return series of one shape [..., T] as float64[R, T] each, their lengths int64[R], and the shape [...].

    :raises InvalidInput: shapes that differ, lengths that do not fit, and within a row's length a value that is NaN,
        or infinite unless its series may be, or below 0 where it must not be.
    """
    arrays = [as_floats(name, value) for name, value in zip(names, values, strict=True)]
    shape = arrays[0].shape
    if any(array.shape != shape for array in arrays):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True))
        raise InvalidInput(f"expected series of one shape [..., T], got {shapes}")
    counts = checked_lengths(lengths, shape)
    counted = np.arange(shape[-1]) < counts[..., None]
    for name, array in zip(names, arrays, strict=True):
        bad = np.isnan(array) if name in may_be_infinite else ~np.isfinite(array)
        wanted = "a finite number"
        if name in not_negative:
            bad, wanted = bad | (array < 0.0), "a number not below 0"
        bad &= counted
        if bad.any():
            raise InvalidInput(f"{name}{place(bad)} = {array[bad][0]}: expected {wanted}")
    rows = tuple(np.ascontiguousarray(array).reshape(-1, shape[-1]) for array in arrays)
    return rows, counts.reshape(-1), shape[:-1]
