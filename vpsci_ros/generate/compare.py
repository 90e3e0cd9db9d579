"""The first row in which two tables differ, to the bit or within a tolerance."""

from typing import Any

import polars as pl


def first_difference(expected: pl.DataFrame, found: pl.DataFrame, tolerance: float) -> str | None:
    """Return the first difference of two tables in words; None without one.

    :param found: "row", the place of each row in its file, and the columns of `expected`.
    :param tolerance: allowed difference of floats; 0: the same bits, where NaN equals NaN.
    """
    height = min(expected.height, found.height)
    first, column = height, ""
    for mine in expected.head(height):
        theirs = found[mine.name].head(height)
        unequal = mine != theirs
        if tolerance > 0.0 and mine.dtype.is_float():
            unequal &= ~((mine.cast(pl.Float64) - theirs.cast(pl.Float64)).abs() <= tolerance)
        if unequal.any() and (place := unequal.arg_max() or 0) < first:
            first, column = place, mine.name
    wanted, there = (table.row(first, named=True) if first < table.height else None for table in (expected, found))
    if there is None:
        return None if wanted is None else f"missing row ({_key(wanted)})"
    if wanted is None:
        return f"row {there['row']} ({_key(there)}): should not be there"
    return f"row {there['row']} ({_key(there)}): {column} is {there[column]!r}, simulated {wanted[column]!r}"


def _key(row: dict[str, Any]) -> str:
    """Return what the row is: its `count`, and its `frame` where it has one."""
    return ", ".join(f"{name} {row[name]}" for name in ("count", "frame") if name in row)
