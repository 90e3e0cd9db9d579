"""Recordings of any other layout, whose columns the file `layout.yaml` in the same folder describes."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout import classes_in, clip_of
from vpsci_ros.data.importers.layout_file import FILE, LENGTH, WIDTH, Layout, LayoutFile, read_layout_file
from vpsci_ros.data.importers.tracks import (
    LINE,
    Clip,
    Importer,
    Unusable,
    alike,
    attempted,
    hypot,
    merged,
    read_csv,
    require_columns,
    unusable,
)
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import reason, shown
from vpsci_ros.errors import InvalidInput

LOST = "rows that are marked as lost"  # a count of `Clip.left_out`
BLANK = "rows without the name of a clip"  # a count of `Clip.left_out`
OFF = 0.5, 0.1  # [m], and share, by which the median distance may differ from that of the positions
_MARKS = {"1": True, "true": True, "0": False, "false": False, "": False}  # of a lost row, and of others


def described(folder: Path, description: Path | None = None, frame_rate: float = 0.0) -> Iterator[Clip]:
    """Yield the clips of the files that the layout names: one a file, or one a value of the layout's `clip` column.

    :param description: the layout's file; None: `layout.yaml` in the folder.
    :param frame_rate: in place of the layout's, if above 0 [1/s].
    :raises InvalidInput: no layout, or one with a key that is missing, unknown or wrong, or whose classes do not occur
        (of a `description`, none of them).
    """
    path = description or folder / FILE
    keys = read_layout_file(path)
    own, usable = description is None, list[bool]()
    layouts = [replace(each, described=own, frame_rate=frame_rate or each.frame_rate) for each in keys.layouts]
    size = keys.length, keys.width
    common: dict[str, Any] = {"source": keys.source, "size": size, "fixed": keys.fixed, "described": own}
    seen = Counter[str]()
    for file in _files(folder, keys, path):
        name = file.relative_to(folder).with_suffix("").as_posix()
        try:
            for part, table, lost in _clips(file, keys):
                clip = attempted(name + part, partial(_clip, name + part, file, table, keys, layouts, seen))
                usable.append(clip.usable)
                yield replace(clip, **common, left_out={**clip.left_out, **lost})
        except InvalidInput as error:
            usable.append(False)
            yield replace(unusable(name, error), **common)
    layout = layouts[0]
    for key, named in (("vehicles", layout.vehicles), ("pedestrians", layout.pedestrians)) * (len(layouts) == 1):
        wanted = named - seen.keys()
        if any(usable) and (wanted == named or (wanted and own and all(usable))):
            counted = ", ".join(f"{name!r} ({count} road users)" for name, count in sorted(seen.items()))
            raise InvalidInput(
                f"{path}: {key}: none of {', '.join(sorted(wanted))} occurs in column {layout.columns['class']}, which "
                f"has {counted}"
            )


def _clip(
    name: str, file: Path, table: pl.DataFrame, keys: LayoutFile, layouts: list[Layout], seen: Counter[str]
) -> Clip:
    """Return a clip of a table, and count its classes in `seen`, of a layout that has any.

    Of two layouts each has the rows in which its road user is there, each once.
    """
    if keys.distance:
        _require_distance(table, keys, layouts, file)
    if len(layouts) == 1:
        clip = clip_of(name, {file: (table, layouts[0])})
        seen.update(classes_in(table, layouts[0]))
        return clip
    parts = []
    for layout in layouts:
        rows, columns = table, set(layout.columns.values())
        if columns <= set(table.columns):
            own = [column for key, column in layout.columns.items() if key not in ("frame", "time")]
            rows = table.filter(~pl.all_horizontal(pl.col(own).is_null()))
            rows = rows.unique(sorted(columns), keep="first", maintain_order=True)
        parts.append(clip_of(name, {file: (rows, layout)}))
    return merged(parts)


def _files(folder: Path, keys: LayoutFile, path: Path) -> list[Path]:
    """Return the files that a layout names, sorted.

    :raises InvalidInput: it names none.
    """
    pattern, unusable = keys.files, ""
    try:
        files = sorted(file for file in folder.glob(pattern) if file.is_file() and file.resolve() != path.resolve())
    except (ValueError, IndexError, NotImplementedError) as error:
        files, unusable = [], f" ({reason(error)})"
    if unusable or ".." in Path(pattern).parts:
        raise InvalidInput(
            f"{path}: files: expected a pattern for files in the folder, such as '*.csv' or '**/*.csv', got "
            f"{shown(pattern)}{unusable}"
        )
    if not files:
        raise InvalidInput(f"{folder}: expected files {pattern}, as {path.name} says; found none")
    return files


def _require_distance(table: pl.DataFrame, keys: LayoutFile, layouts: list[Layout], file: Path) -> None:
    """Refuse distances that contradict the positions of the vehicle and of the pedestrian in each row."""
    require_columns(table, [keys.distance], file)
    places = [[layout.columns.get(name, "") for name in ("x", "y")] for layout in layouts]
    if not {name for place in places for name in place} <= set(table.columns):
        return
    (x, y), (px, py) = ([pl.col(name).cast(pl.Float64, strict=False) for name in place] for place in places)
    rows = table.select(
        apart=hypot(x - px, y - py), said=pl.col(keys.distance).cast(pl.Float64, strict=False)
    ).drop_nulls()
    apart_, said = (float(np.median(rows[name].to_numpy())) * layouts[0].metres for name in ("apart", "said"))
    if abs(apart_ - said) > max(OFF[0], OFF[1] * apart_):
        raise Unusable(
            "clips whose distances contradict their positions",
            f"{file}: column {keys.distance} says {said:.3g} m, the positions are {apart_:.3g} m apart (medians); they "
            "may be of another unit or of other points of the vehicle; or leave the column out",
        )


def _clips(file: Path, keys: LayoutFile) -> Iterator[tuple[str, pl.DataFrame, dict[str, int]]]:
    """Yield the clips of a file: end of the name, table, and counts of left-out rows; the first clip has all counts.

    :raises InvalidInput: a column is missing, no row has a value in the column `clip`, or one in `lost` is no mark.
    """
    if file.suffix == ".parquet":
        table = read_parquet(file, "a table of tracks")
    else:
        table = read_csv(file, keys.delimiter, header=keys.header)
    table = table.with_columns((pl.int_range(pl.len()) + (2 if keys.header else 1)).alias(LINE))
    require_columns(table, filter(None, (keys.lost, keys.clip)), file)
    whole, left_out = table.height, Counter[str]()
    if column := keys.lost:
        text = alike(table[column]).str.to_lowercase().fill_null("")
        if (odd := table.filter(~text.is_in(list(_MARKS)))).height:
            raise InvalidInput(
                f"{file}: line {odd[LINE][0]}, column {column}: expected 0 or 1, true or false, got "
                f"{shown(odd[column][0])}"
            )
        table = table.filter(~text.replace_strict(_MARKS, return_dtype=pl.Boolean))
        left_out[LOST] = whole - table.height
    if not keys.clip:
        yield "", table, left_out
        return
    known = table.drop_nulls(keys.clip)
    if known.is_empty():
        raise InvalidInput(f"{file}: column {keys.clip}: expected the name of a clip in each row, got none")
    left_out[BLANK] = table.height - known.height
    for (part,), rows in sorted(known.partition_by(keys.clip, as_dict=True, maintain_order=True).items()):
        yield f"/{part}", rows, left_out
        left_out = Counter()


DESCRIBED = Importer(described, length=LENGTH, width=WIDTH)
