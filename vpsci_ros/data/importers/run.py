"""The entry point of the importers: from folders and format names to a near-miss table and a summary."""

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console

from vpsci_ros.data.importers.cqut_pvi import CQUT_PVI
from vpsci_ros.data.importers.described import DESCRIBED
from vpsci_ros.data.importers.tracks import FAST, Clip, Importer, Track, median_speed, require_source, slope
from vpsci_ros.data.importers.vci import VCI_CITR, VCI_DUT
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS, concat_near_misses, with_groups
from vpsci_ros.data.reference import causal_curvttc, flags, paths_apart, trailing_slope
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.text_table import text_table
from vpsci_ros.safety import CRITICAL_TTC, HORIZON, PEDESTRIAN_RADIUS, curvature_from_yaw_rate, curvttc
from vpsci_ros.world.observation import STEP

# ---- What an import returns and prints: the near misses, a summary of each source, and what is stored with the
# table.


@dataclass(frozen=True)
class SourceSummary:
    """Counts of one source.

    :ivar pairs: vehicles and pedestrians that are there at the same time.
    :ivar near_misses: those of them whose CurvTTC falls below 5 s and that have `LEAST_STEPS` rows.
    :ivar steps: rows of the table; `critical_steps` of them below 5 s.
    :ivar quartiles: of the least CurvTTC of each near miss [s], NaN where there is none.
    :ivar vehicle_length, vehicle_width: the rectangle that CurvTTC was computed with [m], unless a track has its own.
    :ivar left_out: what of the recordings is not in `pairs`: what it is -> how often.
    :ivar assumed: what the recordings do not hold.
    :ivar vehicles, pedestrians: unbroken tracks; `fast` of the pedestrians have a median speed above 2.5 m/s.
    """

    source: str
    clips: int
    pairs: int
    near_misses: int
    steps: int
    critical_steps: int
    quartiles: tuple[float, float, float]
    vehicle_length: float
    vehicle_width: float
    left_out: Mapping[str, int]
    assumed: tuple[str, ...] = ()
    vehicles: int = 0
    pedestrians: int = 0
    fast: int = 0

    @property
    def speeds(self) -> str:
        """A line that says how many pedestrians are as fast as bicycles, and how to leave them out."""
        share = f"{self.fast:,} of {self.pedestrians:,} pedestrians ({self.fast / max(self.pedestrians, 1):.1%})"
        hint = f"; --fastest {FAST:g} leaves them out" if self.fast else ""
        return f"{share} are faster than {FAST:g} m/s (median while they move){hint}"


@dataclass(frozen=True)
class ImportResult:
    """A near-miss table and the summaries of the sources it came from."""

    table: pl.DataFrame
    summaries: tuple[SourceSummary, ...]

    @property
    def metadata(self) -> dict[str, Any]:
        """What `write_near_misses` should store beside the rows."""
        return {
            "sources": {summary.source: asdict(summary) for summary in self.summaries},
            "step": STEP,
            "critical_ttc": CRITICAL_TTC,
            "horizon": HORIZON,
            "pedestrian_radius": PEDESTRIAN_RADIUS,
            "versions": software_versions(),
        }


def joined(results: Sequence[ImportResult]) -> ImportResult:
    """Return several results as one, with consecutive interaction numbers.

    :raises InvalidInput: none given, or the same recording twice.
    """
    table = concat_near_misses([result.table for result in results])
    by_source: dict[str, list[SourceSummary]] = {}
    for result in results:
        for summary in result.summaries:
            by_source.setdefault(summary.source, []).append(summary)
    return ImportResult(table, tuple(_of_one_source(own, table) for own in by_source.values()))


def _of_one_source(parts: Sequence[SourceSummary], table: pl.DataFrame) -> SourceSummary:
    """Return what several folders of one source hold together."""
    if len(parts) == 1:
        return parts[0]
    left_out: Counter[str] = Counter()
    for part in parts:
        left_out.update(part.left_out)
    names = ("clips", "pairs", "near_misses", "steps", "critical_steps", "vehicles", "pedestrians", "fast")
    sums = {name: sum(getattr(part, name) for part in parts) for name in names}
    assumed = dict.fromkeys(text for part in parts for text in part.assumed)
    quartiles = least_quartiles(table.filter(pl.col("source") == parts[0].source))
    return replace(parts[0], **sums, quartiles=quartiles, left_out=dict(left_out), assumed=tuple(assumed))


def named(result: ImportResult, name: str) -> ImportResult:
    """Return a result whose only source has another name, by which a bank's reactions are chosen (`--people`).

    :raises InvalidInput: several sources, or a name that cannot be one.
    """
    require_source(name, "--name")
    if len(result.summaries) != 1:
        sources = ", ".join(summary.source for summary in result.summaries)
        raise InvalidInput(f"--name {name}: expected one source, got {sources}; import them one by one")
    (summary,) = result.summaries
    return ImportResult(result.table.with_columns(source=pl.lit(name)), (replace(summary, source=name),))


def least_quartiles(table: pl.DataFrame) -> tuple[float, float, float]:
    """Return the quartiles of each interaction's least CurvTTC [s]; NaN without interactions."""
    least = table.group_by("interaction").agg(pl.col("curvttc").min())["curvttc"].to_numpy()
    low, median, high = np.quantile(least, (0.25, 0.5, 0.75)) if len(least) else np.full(3, np.nan)
    return float(low), float(median), float(high)


def print_import_summary(result: ImportResult, console: Console | None = None) -> None:
    """Print the table of `vpsci import`: clips, pairs, near misses, steps, quartiles of the least CurvTTC."""
    columns = [
        (one.source, (one.clips, one.pairs, one.near_misses, one.steps, one.critical_steps), one.quartiles)
        for one in result.summaries
    ]
    if len(columns) > 1:
        sums = tuple(sum(counts) for counts in zip(*(counts for _, counts, _ in columns), strict=True))
        columns.append(("together", sums, least_quartiles(result.table)))
    rows: list[list[str] | None] = []
    for i, name in enumerate(("clips", "pairs", "near misses", "steps", "of them critical")):
        rows.append([name, *(f"{counts[i]:,}" for _, counts, _ in columns)])
        if name == "near misses":
            rows.append(["share of pairs", *(f"{counts[2] / max(counts[1], 1):.1%}" for _, counts, _ in columns)])
    rows.append(None)
    for i, name in enumerate(("first quartile", "median", "third quartile")):
        rows.append([f"least CurvTTC, {name} [s]", *(f"{quartiles[i]:.2f}" for *_, quartiles in columns)])
    title = f"Near misses: pairs whose CurvTTC falls below {CRITICAL_TTC:g} s"
    console = console or Console()
    console.print(text_table(title, ("", *(source for source, _, _ in columns)), rows))
    for row in result.summaries:
        console.print(f"{row.source}: {row.speeds}")
        for text, count in row.left_out.items():
            console.print(f"{row.source}: left out {count:,} {text}")
        for text in row.assumed:
            console.print(f"{row.source}: {text}")


def require_near_misses(result: ImportResult) -> None:
    """Refuse an import without a near miss.

    :raises InvalidInput: says what was read of each source, what was left out of it, and the likely cause.
    """
    if result.table.height:
        return
    found = []
    for one in result.summaries:
        left_out = ", ".join(f"{count:,} {what}" for what, count in one.left_out.items()) or "nothing"
        found.append(
            f"{one.source}: {one.clips:,} clips, {one.vehicles:,} tracks of vehicles, {one.pedestrians:,} of "
            f"pedestrians, {one.pairs:,} pairs that are there at the same time, none below "
            f"{CRITICAL_TTC:g} s of CurvTTC; left out: {left_out}"
        )
    cause = (
        "nobody meets a vehicle closely; if they should, check units, axes and headings (--check draws pairs)"
        if any(one.pairs for one in result.summaries)
        else "no vehicle is there when a pedestrian is; check the times of both, and which classes are named"
    )
    raise InvalidInput(f"no near miss: {'; '.join(found)}; {cause}")


# ---- Each vehicle with each pedestrian of a clip: CurvTTC along their joint track, and those that become critical.
#
# The whole joint track of a near miss is kept; `vpsci_ros.data.reference` says which of its rows learning takes.


LEAST_STEPS = 5  # of a near miss: a slope over 0.4 s, as velocities and yaw rates are, takes so many
BRIEF = f"near misses of fewer than {LEAST_STEPS} steps"  # a count of `SourceSummary.left_out`
LEAST_EXTENT = 1.0  # [m] of a clip: as far apart are the middles of a vehicle and of a pedestrian at least


def near_misses_of(
    source: str,
    clips: Iterable[Clip],
    *,
    length: float,
    width: float,
    critical: float = CRITICAL_TTC,
    fastest: float = math.inf,
) -> ImportResult:
    """Return the near misses of a source, interactions numbered from 0 in order of clip, vehicle and pedestrian.

    :param length, width: of vehicles whose tracks do not say [m].
    :param critical: CurvTTC below which a pair is a near miss [s].
    :param fastest: pedestrians whose median speed exceeds this are left out [m/s], see `Clip.without_faster`.
    :raises InvalidInput: no vehicle at all, no pedestrian, or two clips of one name; or see `clips`.
    """
    parts: list[pl.DataFrame] = []
    pairs = vehicles = pedestrians = fast = 0
    left_out: Counter[str] = Counter()
    assumed: dict[str, None] = {}
    names: set[str] = set()
    for recorded in clips:
        _require_metres(source, recorded)
        clip = recorded.with_headings().without_faster(fastest)
        if clip.name in names:
            raise InvalidInput(
                f"{source}: two recordings are called {clip.name}; rename one, or give their folders one by one, which "
                "tells clips of one name apart"
            )
        names.add(clip.name)
        fast += sum(median_speed(track) > FAST for track in clip.pedestrians)
        vehicles, pedestrians = vehicles + len(clip.vehicles), pedestrians + len(clip.pedestrians)
        left_out.update(clip.left_out)
        assumed |= dict.fromkeys(clip.assumed)
        for vehicle, pedestrian in _together(clip):
            near_miss = _near_miss(vehicle, pedestrian, *(vehicle.size or (length, width)), critical)
            pairs += 1
            if near_miss is not None and near_miss.height < LEAST_STEPS:
                left_out[BRIEF] += 1
            elif near_miss is not None:
                number = pl.lit(len(parts), pl.Int64)
                parts.append(near_miss.with_columns(interaction=number, source=pl.lit(source), clip=pl.lit(clip.name)))
    events = any(what.startswith("events") for what in left_out)  # whole pairs, each for a reason of its own
    if names and not (vehicles and pedestrians) and not events:
        others = ", ".join(f"{count:,} {what}" for what, count in (+left_out).items()) or "nothing"
        what = "vehicle" if not vehicles else "pedestrian"
        raise InvalidInput(
            f"{source}: no {what} in {len(names)} clips; left out were {others}; name the classes as there"
        )
    empty = pl.DataFrame(schema={name: column.dtype for name, column in NEAR_MISS_COLUMNS.items()})
    table = with_groups(pl.concat(parts)).select(list(NEAR_MISS_COLUMNS)) if parts else empty
    summary = SourceSummary(
        source,
        clips=len(names),
        pairs=pairs,
        near_misses=len(parts),
        steps=table.height,
        critical_steps=table.filter(pl.col("curvttc") < critical).height,
        quartiles=least_quartiles(table),
        vehicle_length=length,
        vehicle_width=width,
        left_out=dict(+left_out),
        assumed=tuple(assumed),
        vehicles=vehicles,
        pedestrians=pedestrians,
        fast=fast,
    )
    return ImportResult(table, (summary,))


def _require_metres(source: str, clip: Clip) -> None:
    """Refuse a clip in which a vehicle and a pedestrian have no room beside each other.

    :raises InvalidInput: names the projection where its positions may be longitudes and latitudes.
    """
    if not clip.vehicles or not clip.pedestrians:
        return
    tracks = [track.values for track in (*clip.vehicles, *clip.pedestrians)]
    x, y = (np.concatenate([values[name] for values in tracks]) for name in ("x", "y"))
    extent = float(np.hypot(np.ptp(x), np.ptp(y)))
    if extent < LEAST_EXTENT:
        zone = f"EPSG:32{'6' if y.mean() >= 0.0 else '7'}{int((x.mean() + 180.0) // 6.0) % 60 + 1:02}"
        raise InvalidInput(
            f"{source}, clip {clip.name}: all road users are within {extent:.2g} of each other: expected positions in "
            "metres; describe the files (--format described) with `metres` of their unit"
            + (f", or, for longitude and latitude, with `projection: {zone}`" * bool(np.abs((x, y)).max() <= 180.0))
        )


def _together(clip: Clip) -> Iterable[tuple[Track, Track]]:
    """Yield each vehicle, with its yaw rates, and each pedestrian that is there at some of its steps."""
    begins, ends = (np.array([getattr(each, end) for each in clip.pedestrians], int) for end in ("first", "last"))
    for vehicle in clip.vehicles:
        together = np.flatnonzero((begins <= vehicle.last) & (ends >= vehicle.first))  # of thousands, a few
        if len(together):
            heading = vehicle.values["heading"]
            rates = {"yaw_rate": slope(heading), "yaw_rate_causal": trailing_slope(heading)}
            turning = replace(vehicle, values=vehicle.values | rates)
            yield from ((turning, clip.pedestrians[number]) for number in together)


def _near_miss(vehicle: Track, pedestrian: Track, length: float, width: float, critical: float) -> pl.DataFrame | None:
    first, last = max(vehicle.first, pedestrian.first), min(vehicle.last, pedestrian.last)
    veh, ped = (
        {name: values[first - track.first : last - track.first + 1] for name, values in track.values.items()}
        for track in (vehicle, pedestrian)
    )
    curvature = curvature_from_yaw_rate(veh["yaw_rate"], veh["speed"])
    ttc = curvttc(
        *(veh["x"], veh["y"], veh["heading"], veh["speed"], curvature),
        *(ped["x"], ped["y"], ped["vx"], ped["vy"]),
        length=length,
        width=width,
        radius=PEDESTRIAN_RADIUS,
    )
    if not (ttc < critical).any():
        return None
    columns = {f"veh_{name}": veh[name] for name in ("x", "y", "heading", "speed")}
    columns["veh_vx"] = veh["speed"] * np.cos(veh["heading"])
    columns["veh_vy"] = veh["speed"] * np.sin(veh["heading"])
    columns |= {f"ped_{name}": ped[name] for name in ("x", "y", "vx", "vy")}
    steps = np.arange(len(ttc))
    return pl.DataFrame(
        {
            "step": steps,
            "time": (first + steps) * STEP,
            "veh_id": np.full(len(ttc), vehicle.number),
            "ped_id": np.full(len(ttc), pedestrian.number),
            "veh_name": vehicle.name or str(vehicle.number),
            "ped_name": pedestrian.name or str(pedestrian.number),
            "veh_length": float(length),
            "veh_width": float(width),
            **columns,
            "curvttc": ttc,
            "distance": np.hypot(veh["x"] - ped["x"], veh["y"] - ped["y"]),
            "curvttc_causal": causal_curvttc(columns, veh["yaw_rate_causal"], length, width),
        }
        | flags(ttc, veh["speed"])
        | {"apart": paths_apart(columns)}
    )


BUILT_IN = {"vci-dut": VCI_DUT, "vci-citr": VCI_CITR, "cqut-pvi": CQUT_PVI, "described": DESCRIBED}
IMPORTERS = PluginGroup("vpsci_ros.importers", "format", Importer, BUILT_IN)


def import_trajectories(folder: str | Path, format_name: str, fastest: float = math.inf) -> ImportResult:
    """Return the near misses of every clip of a folder, read as published.

    :param format_name: of `IMPORTERS`; the table's `source`, unless the folder itself names it.
    :param fastest: median speed of a pedestrian above which it is left out [m/s].
    :raises InvalidInput: an unknown format, a missing folder or file, a file that does not hold what it should.
    """
    importer, folder = IMPORTERS.find(format_name), Path(folder)
    return _near_misses_of_folder(importer, folder, format_name, importer.read(folder), fastest)


def _near_misses_of_folder(
    importer: Importer, folder: Path, format_name: str, clips: Iterable[Clip], fastest: float
) -> ImportResult:
    source = importer.source(folder) or format_name
    return near_misses_of(source, clips, length=importer.length, width=importer.width, fastest=fastest)


def imported_clips(
    folders: Sequence[str | Path], formats: Sequence[str], fastest: float = math.inf
) -> list[tuple[list[Clip], ImportResult]]:
    """Return the clips of each folder and their near misses.

    :param formats: one for each folder, or one for all; fastest: see `import_trajectories`.
    :raises InvalidInput: formats that do not match the folders, or see `import_trajectories`.
    """
    found = []
    for folder, form in _with_formats(folders, formats):
        importer = IMPORTERS.find(form)
        clips = list(importer.read(folder))
        found.append((clips, _near_misses_of_folder(importer, folder, form, clips, fastest)))
    return found


def import_folders(folders: Sequence[str | Path], formats: Sequence[str], fastest: float = math.inf) -> ImportResult:
    """Import several folders into one table, with consecutive interaction numbers.

    :param formats: one for each folder, or one for all.
    :param fastest: median speed of a pedestrian above which it is left out [m/s].
    :raises InvalidInput: formats that do not match the folders, the same recording twice, or see `import_trajectories`.
    """
    results = [import_trajectories(folder, form, fastest) for folder, form in _with_formats(folders, formats)]
    return joined(told_apart([Path(folder) for folder in folders], results))


def _with_formats(folders: Sequence[str | Path], formats: Sequence[str]) -> list[tuple[Path, str]]:
    """Return each folder with its format.

    :raises InvalidInput: no folder, or neither one format for each folder nor one for all.
    """
    forms = list(formats) * len(folders) if len(formats) == 1 else list(formats)
    if not folders or len(forms) != len(folders):
        raise InvalidInput(
            f"expected one format for each folder, or one for all; got {len(folders)} folders, {len(forms)} formats"
        )
    return [(Path(folder), form) for folder, form in zip(folders, forms, strict=True)]


def told_apart(folders: Sequence[Path], results: Sequence[ImportResult]) -> list[ImportResult]:
    """Return imports of folders with unique clip names.

    Where two folders of one format have a clip of one name, all clips of this format have their folder before their
    names: its path below the folder that all of these are in.

    :raises InvalidInput: two folders are the same one, or hold the same recording.
    """
    out = list(results)
    for source in dict.fromkeys(result.summaries[0].source for result in results):
        mine = [number for number, result in enumerate(results) if result.summaries[0].source == source]
        paths = [folders[number].resolve() for number in mine]
        if twice := [path for path in paths if paths.count(path) > 1]:
            raise InvalidInput(f"{twice[0]}: this folder is given twice; give each folder of recordings once")
        tables = [results[number].table for number in mine]
        if not _have_clips_in_common(tables):
            continue
        _refuse_copies(paths, tables)
        root = Path(os.path.commonpath([path.parent for path in paths]))
        for number, path in zip(mine, paths, strict=True):
            named = pl.lit(f"{path.relative_to(root).as_posix()}/") + pl.col("clip")
            out[number] = replace(results[number], table=results[number].table.with_columns(clip=named))
    return out


def _have_clips_in_common(tables: Sequence[pl.DataFrame]) -> bool:
    names = pl.concat([table.select(pl.col("clip").unique()) for table in tables])
    return bool(names["clip"].is_duplicated().any())


def _refuse_copies(folders: Sequence[Path], tables: Sequence[pl.DataFrame]) -> None:
    seen: dict[tuple[str, int], tuple[Path, pl.DataFrame]] = {}
    for folder, table in zip(folders, tables, strict=True):
        for (clip,), rows in (
            table.drop("interaction", "group").partition_by("clip", as_dict=True, maintain_order=True).items()
        ):
            other, theirs = seen.setdefault((str(clip), rows.height), (folder, rows))
            if other != folder and theirs.equals(rows):
                raise InvalidInput(f"{folder}: its clip {clip} is that of {other} to the bit; give each recording once")
