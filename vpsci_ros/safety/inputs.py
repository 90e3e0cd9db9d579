"""Checks of arguments: they become float64 arrays of one shape, and an invalid value is reported.

A bad number is never turned into an infinity: every function of `vpsci_ros.safety` for arrays refuses it and says which
argument has which value at which index. Only the compiled functions of one pair (`curvttc_pair`, `clearance_pair`,
`visible_pair`, `touches_box`) check nothing.
"""

from collections.abc import Iterable, Sequence
from typing import NoReturn, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput

FloatLike: TypeAlias = ArrayLike
Floats: TypeAlias = NDArray[np.float64]


def as_floats(name: str, value: FloatLike) -> Floats:
    """Return `value` as a float64 array.

    :raises InvalidInput: text, booleans, objects, complex or ragged input.
    """
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InvalidInput(f"{name}: expected a regular array, got {type(value).__name__}: {error}") from None
    if array.dtype.kind not in "fiu":
        raise InvalidInput(f"{name}: expected real numbers, got {array.dtype} from {type(value).__name__}")
    return array.astype(np.float64)


def broadcast(names: Sequence[str], values: Sequence[FloatLike]) -> tuple[tuple[Floats, ...], tuple[int, ...]]:
    """Return the arguments as flat, contiguous float64[size] arrays, and the shape they broadcast to.

    :raises InvalidInput: shapes that do not broadcast, naming each argument's shape, or as `as_floats`.
    """
    arrays = [as_floats(name, value) for name, value in zip(names, values, strict=True)]
    shape = common_shape(names, arrays)
    return tuple(flattened(array, shape) for array in arrays), shape


def flattened(array: Floats, shape: tuple[int, ...]) -> Floats:
    """Return `array` broadcast to `shape` as contiguous, writable float64[size], copied only where needed.

    A read-only array, such as a column of a table, is copied: kernels are compiled for each kind of their arguments.
    """
    wide = array if array.shape == shape else np.broadcast_to(array, shape)
    return np.require(wide, requirements=["C", "W"]).reshape(-1)


def common_shape(names: Sequence[str], arrays: Sequence[Floats]) -> tuple[int, ...]:
    """Return the shape that `arrays` broadcast to.

    :raises InvalidInput: shapes that do not broadcast, naming each argument's shape.
    """
    shapes = {array.shape for array in arrays} - {()}
    if len(shapes) < 2:  # the usual case, and np.broadcast_shapes costs more than a small batch
        return shapes.pop() if shapes else ()
    try:
        return np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        given = ", ".join(f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True) if array.ndim)
        raise InvalidInput(f"shapes do not broadcast: {given}; give arrays of one shape, or scalars") from None


def refuse(
    names: Sequence[str], values: Sequence[FloatLike], *, positive: Iterable[str] = (), not_negative: Iterable[str] = ()
) -> NoReturn:
    """Raise `InvalidInput` for the first argument that is not finite, not above 0, or below 0.

    :param positive: names of the arguments that have to be above 0; not_negative: of those that must not be below 0.
    :raises InvalidInput: always; called once a kernel has seen that something is wrong.
    """
    for name, value in zip(names, values, strict=True):
        array = as_floats(name, value)
        for wanted, bad in (
            ("a finite number", ~np.isfinite(array)),
            ("a number above 0", (array <= 0.0) & (name in positive)),
            ("a number not below 0", (array < 0.0) & (name in not_negative)),
        ):
            if bad.any():
                raise InvalidInput(f"{name}{place(bad)} = {array[bad][0]}: expected {wanted}")
    raise InvalidInput("the sum of the arguments of one pair overflows; expected metres and seconds far below 1e300")


def place(bad: NDArray[np.bool_]) -> str:
    """Return the index of the first True as "[i]" or "[i, j]", "" for a scalar."""
    if bad.ndim == 0:
        return ""
    index = np.unravel_index(int(np.argmax(bad)), bad.shape)
    return f"[{', '.join(str(int(i)) for i in index)}]"
