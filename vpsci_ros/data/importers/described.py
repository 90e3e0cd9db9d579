"""Recordings of any other layout, whose columns the file `layout.yaml` in the same folder describes."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import polars as pl

from vpsci_ros.data.importers.layout import Layout, classes_in, clip_of
from vpsci_ros.data.importers.layout_file import FILE, LayoutFile, read_layout_file
from vpsci_ros.data.importers.tracks import LINE, WHOLE, Clip, Importer, merged, read_csv, require_columns
from vpsci_ros.data.near_misses import TURN_LIMIT
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import listed, reason, shown
from vpsci_ros.errors import InvalidInput, require

LOST = "rows that are marked as lost"  # a count of `Clip.left_out`
UNREADABLE = "road users that cannot be read"  # a count of `Clip.left_out`
BLANK = "rows without the name of a clip"  # likewise
_MARKS = {"1": True, "true": True, "0": False, "false": False, "": False}  # of a lost row, and of others


def described(folder: Path, description: Path | None = None) -> Iterator[Clip]:
    """Yield the clips of the files that the layout names: one a file, or one a value of the layout's `clip` column.

    :param description: the layout's file; None: `layout.yaml` in the folder.
    :raises InvalidInput: no layout, or one with a key that is missing, unknown or wrong, or whose classes do not occur
        (of a `description`, none of them); or see `_readable`.
    """
    path = description or folder / FILE
    keys, layouts = read_layout_file(path)
    files = _files(folder, keys, path)
    scales = _scales(folder, files, keys.metres, path)
    size, seen = (float(keys.length), float(keys.width)), Counter[str]()
    for file in files:
        name = file.relative_to(folder).with_suffix("").as_posix()
        scaled = [replace(layout, metres=scales[file]) for layout in layouts]
        for part, table, left_out in _clips(file, keys, layouts):
            parts = [_readable(f"{name}{part}", file, _rows_of(table, keys, each), each) for each in scaled]
            clip = _without_heading_jumps(merged(parts)).with_size(*size).without_faster(float(keys.fastest))
            yield replace(clip, left_out={**clip.left_out, **left_out}, source=keys.source)
            seen.update(classes_in(table, layouts[0]) if len(layouts) == 1 else {})
    layout = layouts[0]
    for key, named in (("vehicles", layout.vehicles), ("pedestrians", layout.pedestrians)) * (len(layouts) == 1):
        wanted = named - seen.keys()
        if wanted == named or (wanted and description is None):
            counted = ", ".join(f"{name!r} ({count} road users)" for name, count in sorted(seen.items()))
            raise InvalidInput(
                f"{path}: {key}: none of {', '.join(sorted(wanted))} occurs in column {layout.columns['class']}, which "
                f"has {counted}"
            )


def _files(folder: Path, keys: LayoutFile, path: Path) -> list[Path]:
    """Return the files that a layout names, sorted.

    :raises InvalidInput: it names none, or `beside` none of the files that may be beside them.
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
    for own, theirs in keys.beside.items():
        if not any(_beside(file, str(own), str(theirs)) for file in files):
            raise InvalidInput(
                f"{path}: beside: no file with {own} in its name has one with {theirs} there beside it; found "
                f"{listed(file.name for file in files)}"
            )
    return files


def _beside(file: Path, own: str, theirs: str) -> Path | None:
    """Return the file whose name has `theirs` where that of `file` has `own`; None: there is none."""
    other = file.with_name(file.name.replace(own, theirs))
    return other if other != file and other.is_file() else None


def _scales(folder: Path, files: list[Path], metres: float | Mapping[str, float], path: Path) -> dict[Path, float]:
    """Return metres in one unit of each file: one number for all, or by patterns of the files' names.

    :raises InvalidInput: a file for which there are none or several, or a pattern of no file.
    """
    if not isinstance(metres, Mapping):
        return dict.fromkeys(files, float(metres))
    names = {file: file.relative_to(folder).as_posix() for file in files}
    matches = {file: [pattern for pattern in metres if fnmatchcase(name, pattern)] for file, name in names.items()}
    for file, found in matches.items():
        if len(found) != 1:
            raise InvalidInput(
                f"{path}: metres: expected one pattern for file {names[file]}, got {listed(found)} of {listed(metres)}"
            )
    if unused := [pattern for pattern in metres if [pattern] not in matches.values()]:
        raise InvalidInput(f"{path}: metres: {unused[0]} names no file; there are {listed(names.values())}")
    return {file: float(metres[found[0]]) for file, found in matches.items()}


def _rows_of(table: pl.DataFrame, keys: LayoutFile, layout: Layout) -> pl.DataFrame:
    """Return the layout's rows of a table with both agents in a row: those in which its agent is there, each once."""
    columns = keys.vehicle if layout.vehicles else keys.pedestrian
    own = [str(column) for column in columns.values()]
    if not own or not set(layout.columns.values()) <= set(table.columns):
        return table
    there = table.filter(~pl.all_horizontal(pl.col(own).is_null()))
    return there.unique(sorted(set(layout.columns.values())), keep="first", maintain_order=True)


def _projected(table: pl.DataFrame, projection: str, layout: Layout, path: Path) -> pl.DataFrame:
    """Return a table with longitudes and latitudes projected to metres; without a `projection` the table itself.

    :raises InvalidInput: no such projection, or not one in metres; or the package pyproj is missing.
    """
    if not projection or not {layout.columns["x"], layout.columns["y"]} <= set(table.columns):
        return table
    names = [layout.columns["x"], layout.columns["y"]]
    require("pyproj")
    import pyproj

    try:
        system = pyproj.CRS(projection)
        if {axis.unit_name for axis in system.axis_info} != {"metre"}:
            raise InvalidInput(
                f"{path}: projection: expected one in metres such as EPSG:32632, got {shown(projection)}"
            )
        to_metres = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)
    except pyproj.exceptions.ProjError as error:
        raise InvalidInput(f"{path}: projection: {reason(error)}; expected one such as EPSG:32632") from None
    degrees = [table[name].cast(pl.Float64, strict=False).to_numpy() for name in names]
    return table.with_columns(**dict(zip(names, to_metres.transform(*degrees), strict=True)))


def _clips(file: Path, keys: LayoutFile, layouts: list[Layout]) -> Iterator[tuple[str, pl.DataFrame, dict[str, int]]]:
    """Yield the clips of a file: end of the name, table, and counts of left-out rows; the first clip has all counts.

    :raises InvalidInput: the file does not have the column `clip`, or no row has a value there; or see `_not_lost`.
    """
    table = _table(file, keys)
    for own, theirs in keys.beside.items():
        if (other := _beside(file, str(own), str(theirs))) is not None:
            table = pl.concat([table, _table(other, keys)], how="diagonal_relaxed")
    for layout in layouts:
        table = _projected(table, keys.projection, layout, file)
    whole, left_out = table.height, Counter[str]()
    if "lost" in keys.columns:
        table = _not_lost(table, str(keys.columns["lost"]), file)
        left_out[LOST] = whole - table.height
    column = str(keys.clip)
    if not column:
        yield "", table, left_out
        return
    require_columns(table, [column], file)
    known = table.drop_nulls(column)
    if known.is_empty():
        raise InvalidInput(f"{file}: column {column}: expected the name of a clip in each row, got none")
    left_out[BLANK] = table.height - known.height
    for (part,), rows in sorted(known.partition_by(column, as_dict=True, maintain_order=True).items()):
        yield f"/{part}", rows, left_out
        left_out = Counter()


def _not_lost(table: pl.DataFrame, column: str, file: Path) -> pl.DataFrame:
    """Return the rows that are not marked as lost.

    :raises InvalidInput: no such column, or a value that is no mark.
    """
    require_columns(table, [column], file)
    text = table[column].cast(pl.String).str.strip_chars().str.to_lowercase().str.replace(WHOLE, "${1}").fill_null("")
    if (odd := table.filter(~text.is_in(list(_MARKS)))).height:
        raise InvalidInput(
            f"{file}: line {odd[LINE][0]}, column {column}: expected 0 or 1, true or false, got {shown(odd[column][0])}"
        )
    return table.filter(~text.replace_strict(_MARKS, return_dtype=pl.Boolean))


def _table(file: Path, keys: LayoutFile) -> pl.DataFrame:
    if file.suffix == ".parquet":
        table = read_parquet(file, "a table of tracks")
    else:
        table = read_csv(file, keys.delimiter, header=keys.header)
    first = 2 if keys.header else 1
    return table.with_columns(pl.int_range(first, first + pl.len()).alias(LINE))


def _readable(name: str, path: Path, table: pl.DataFrame, layout: Layout) -> Clip:
    """Return the clip of a table without the road users that cannot be read.

    They have to be fewer than half, and neither all vehicles nor all pedestrians.

    :raises InvalidInput: see `clip_of`.
    """
    try:
        return clip_of(name, {path: (table, layout)})
    except InvalidInput as refused:
        column = layout.columns["id"]
        if column not in table.columns:
            raise
        known = table.drop_nulls(column)
        numbered = known.with_columns(known[column].cast(pl.String).rank("dense").cast(pl.Int64).alias(column))
        names = dict(zip(numbered[column], known[column].cast(pl.String), strict=True))
        clips, bad, classes = [], 0, set[str]()
        for track in numbered.partition_by(column, maintain_order=True):
            try:
                clips.append(clip_of(name, {path: (track, layout)}))
            except InvalidInput:
                bad += 1
                classes |= classes_in(track, layout).keys()
        no_vehicle = classes & layout.vehicles and not any(clip.vehicles for clip in clips)
        no_pedestrian = classes & layout.pedestrians and not any(clip.pedestrians for clip in clips)
        if bad >= len(clips) or no_vehicle or no_pedestrian:
            raise
        clip = merged(clips)
        return replace(
            clip,
            vehicles=[replace(track, name=names[track.number]) for track in clip.vehicles],
            pedestrians=[replace(track, name=names[track.number]) for track in clip.pedestrians],
            left_out={UNREADABLE: bad, "rows without an id": table.height - known.height, **clip.left_out},
            assumed=(*clip.assumed, f"the first left out: {refused}"),
        )


def _without_heading_jumps(clip: Clip) -> Clip:
    good = [track for track in clip.vehicles if not (np.abs(np.diff(track.values["heading"])) >= TURN_LIMIT).any()]
    left_out = {**clip.left_out, "vehicles whose heading jumps": len(clip.vehicles) - len(good)}
    return replace(clip, vehicles=good, left_out=left_out)


DESCRIBED = Importer(described, length=LayoutFile.length, width=LayoutFile.width)
