"""The entry point of the importers: from folders and format names to a near-miss table and a summary."""

import math
import os
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.importers.described import DESCRIBED
from vpsci_ros.data.importers.pairs import near_misses_of
from vpsci_ros.data.importers.summary import ImportResult, SourceSummary, least_quartiles, require_agreement, summed
from vpsci_ros.data.importers.tracks import Clip, Importer, require_source
from vpsci_ros.data.near_misses import KINDS, WALKER, concat_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.plugins import PluginGroup

BUILT_IN = {"described": DESCRIBED}
IMPORTERS = PluginGroup("vpsci_ros.importers", "format", Importer, BUILT_IN)


def import_trajectories(folder: str | Path, format_name: str, **options: Any) -> ImportResult:
    """Return the near misses of every clip of a folder, read as published.

    :param format_name: of `IMPORTERS`; the table's `source`, unless the folder itself names it.
    :param options: see `imported_clips`.
    :raises InvalidInput: see `imported_clips`.
    """
    return import_folders([folder], [format_name], **options)


def importers_of(
    folders: Sequence[str | Path],
    formats: Sequence[str],
    *,
    frame_rate: float = 0.0,
    kinds: Collection[str] = (WALKER,),
) -> list[tuple[str, Importer]]:
    """Return format and importer of each folder, without a look into the folders; parameters as of `imported_clips`.

    :raises InvalidInput: formats that do not match the folders, an unknown format or kind, or a frame rate for a format
        whose files have times.
    """
    if not kinds or set(kinds) - {*KINDS}:
        raise InvalidInput(f"--kinds {','.join(kinds)}: expected one or some of {','.join(KINDS)}")
    forms = list(formats) * len(folders) if len(formats) == 1 else list(formats)
    if not folders or len(forms) != len(folders):
        raise InvalidInput(
            f"expected one format for each folder, or one for all; got {len(folders)} folders, {len(forms)} formats"
        )
    found = [(form, IMPORTERS.find(form)) for form in forms]
    if frame_rate and (timed := [form for form, importer in found if not importer.frame_rate]):
        raise InvalidInput(f"--frame-rate: files of format {timed[0]} say their own frame rate or times; leave it out")
    return found


def imported_clips(
    folders: Sequence[str | Path],
    formats: Sequence[str],
    *,
    fastest: float = math.inf,
    frame_rate: float = 0.0,
    kinds: Collection[str] = (WALKER,),
    strict: bool = False,
    keep: bool = True,
) -> list[tuple[list[Clip], ImportResult]]:
    """Return the clips of each folder and their near misses.

    :param formats: one for each folder, or one for all.
    :param fastest: median speed of a pedestrian above which it is left out [m/s].
    :param frame_rate: of files that count frames [1/s]; 0: the format's.
    :param kinds: of `KINDS`, those of the pedestrians to import.
    :param strict: refuse the first clip or road user that a check would leave out.
    :param keep: false: without the clips, each of which is then in memory for a while only.
    :raises InvalidInput: as `importers_of`; a missing folder, or recordings most of which do not hold what they should.
    """
    found = []
    read = importers_of(folders, formats, frame_rate=frame_rate, kinds=kinds)
    for folder, (form, importer) in zip(map(Path, folders), read, strict=True):
        clips = importer.read(folder, frame_rate=frame_rate) if frame_rate else importer.read(folder)
        clips = list(clips) if keep else clips
        options: dict[str, Any] = {"fastest": fastest, "kinds": kinds, "strict": strict}
        result = near_misses_of(form, clips, length=importer.length, width=importer.width, **options)
        found.append((list(clips) if keep else [], result))
    require_agreement(_of_each_source([result for _, result in found]))
    return found


def import_folders(folders: Sequence[str | Path], formats: Sequence[str], **options: Any) -> ImportResult:
    """Import several folders into one table, with consecutive interaction numbers.

    :param formats: one for each folder, or one for all; options: see `imported_clips`.
    :raises InvalidInput: the same recording twice, or see `imported_clips`.
    """
    found = imported_clips(folders, formats, keep=False, **options)
    results = [result for _, result in found]
    results = with_unique_clip_names([Path(folder) for folder in folders], results)
    return ImportResult(concat_near_misses([result.table for result in results]), _of_each_source(results))


def _of_each_source(results: Sequence[ImportResult]) -> tuple[SourceSummary, ...]:
    """Return one summary of each source, with sums over its folders."""
    by_source: dict[str, list[ImportResult]] = {}
    for result in results:
        by_source.setdefault(result.summaries[0].source, []).append(result)
    out = []
    for own in by_source.values():
        numbers = [pl.format("{} {}", pl.lit(i), "interaction").alias("interaction") for i in range(len(own))]
        least = pl.concat(one.table.select(each, "curvttc") for one, each in zip(own, numbers, strict=True))
        out.append(replace(summed([one.summaries[0] for one in own]), quartiles=least_quartiles(least)))
    return tuple(out)


def with_unique_clip_names(folders: Sequence[Path], results: Sequence[ImportResult]) -> list[ImportResult]:
    """Return imports of folders with unique clip names.

    Where two folders of one source have a clip of one name, the name of every clip of this source gets its folder in
    front: the folder's path below the nearest folder that contains them all.

    :raises InvalidInput: a folder is given twice, or two folders hold the same recording.
    """
    out = list(results)
    for source in dict.fromkeys(result.summaries[0].source for result in results):
        mine = [number for number, result in enumerate(results) if result.summaries[0].source == source]
        paths = [folders[number].resolve() for number in mine]
        if twice := [path for path in paths if paths.count(path) > 1]:
            raise InvalidInput(f"{twice[0]}: this folder is given twice; give each folder of recordings once")
        tables = [results[number].table for number in mine]
        if not pl.concat(table.select(pl.col("clip").unique()) for table in tables)["clip"].is_duplicated().any():
            continue
        _refuse_copies(paths, tables)
        root = Path(os.path.commonpath([path.parent for path in paths]))
        for number, path in zip(mine, paths, strict=True):
            named = pl.lit(f"{path.relative_to(root).as_posix()}/") + pl.col("clip")
            out[number] = replace(results[number], table=results[number].table.with_columns(clip=named))
    return out


def _refuse_copies(folders: Sequence[Path], tables: Sequence[pl.DataFrame]) -> None:
    seen: dict[tuple[str, int], tuple[Path, pl.DataFrame]] = {}
    for folder, table in zip(folders, tables, strict=True):
        for (clip,), rows in (
            table.drop("interaction", "group").partition_by("clip", as_dict=True, maintain_order=True).items()
        ):
            other, theirs = seen.setdefault((str(clip), rows.height), (folder, rows))
            if other != folder and theirs.equals(rows):
                raise InvalidInput(f"{folder}: its clip {clip} is that of {other} to the bit; give each recording once")


def named(result: ImportResult, name: str) -> ImportResult:
    """Return an import's result with its only source renamed; `--people` chooses reactions by this name.

    :raises InvalidInput: several sources, or a name that cannot be one.
    """
    require_source(name, "--name")
    if len(result.summaries) != 1:
        sources = ", ".join(summary.source for summary in result.summaries)
        raise InvalidInput(f"--name {name}: expected one source, got {sources}; import them one by one")
    (summary,) = result.summaries
    return ImportResult(result.table.with_columns(source=pl.lit(name)), (replace(summary, source=name),))
