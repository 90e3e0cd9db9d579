"""The first row in which two tables differ, to the bit or within a tolerance."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray


@dataclass(frozen=True)
class Difference:
    """A row that is not as it should be; None for a row or a value that is not there.

    :ivar row: of the file, counted from 0.
    :ivar key: what the row is: its `count`, and its `frame` where it has one.
    """

    row: int | None
    key: dict[str, Any]
    column: str
    expected: Any
    found: Any

    def __str__(self) -> str:
        where = ", ".join(f"{name} {value}" for name, value in self.key.items())
        if self.found is None:
            return f"missing row ({where})"
        if self.expected is None:
            return f"row {self.row} ({where}): should not be there"
        return f"row {self.row} ({where}): {self.column} is {self.found!r}, simulated {self.expected!r}"


def first_difference(expected: pl.DataFrame, found: pl.DataFrame, tolerance: float) -> Difference | None:
    """Compare row by row.

    :param found: the columns of `expected` after "row", the place of each in its file.
    :param tolerance: floats may differ by so much; 0: the same bits, where NaN equals NaN.
    """
    height = min(expected.height, found.height)
    first, column = height, ""
    for name in expected.columns:
        a, b = expected[name].to_numpy()[:height], found[name].to_numpy()[:height]
        unequal = _unequal(a, b, tolerance)
        if unequal.any() and (place := int(unequal.argmax())) < first:
            first, column = place, name
    if first < height:
        rows = expected[first].to_dicts()[0], found[first].to_dicts()[0]
        return Difference(rows[1]["row"], _key(rows[0]), column, rows[0][column], rows[1][column])
    if found.height > height:
        row = found[height].to_dicts()[0]
        return Difference(row["row"], _key(row), "", None, row)
    if expected.height > height:
        return Difference(None, _key(expected[height].to_dicts()[0]), "", "a row", None)
    return None


def _unequal(a: NDArray[Any], b: NDArray[Any], tolerance: float) -> NDArray[np.bool_]:
    if a.dtype.kind != "f":
        differs: NDArray[np.bool_] = a != b
        return differs
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    if tolerance > 0.0:
        with np.errstate(invalid="ignore"):
            same |= np.abs(a.astype(np.float64) - b.astype(np.float64)) <= tolerance
    return ~same


def _key(row: dict[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in ("count", "frame") if name in row}
