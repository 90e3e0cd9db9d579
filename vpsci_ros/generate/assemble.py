"""From finished units to the dataset's files: the same bytes whoever computed the units, in which order, how large."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_files import INDEX_COLUMNS, EpisodeTable
from vpsci_ros.data.dataset_index import DESCRIPTION, INDEX, REJECTED, Tally, description_of, file_entry, index_table
from vpsci_ros.data.filters import REASONS
from vpsci_ros.data.parquet import write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.datasheet import DATASHEET, datasheet
from vpsci_ros.generate.job import Job
from vpsci_ros.generate.journal import Journal
from vpsci_ros.generate.part import Part
from vpsci_ros.generate.plan import Plan, ScenarioPlan
from vpsci_ros.runs.files import write_json, write_text, written_whole
from vpsci_ros.world import COLLISION, Scenario

ROW_GROUP = 1 << 17
_TOO_SHORT = REASONS.index("too short") - 1


@dataclass(frozen=True)
class _Assembled:
    """One scenario's share of the dataset."""

    name: str
    counts: dict[str, Any]
    files: dict[str, dict[str, Any]]
    index: list[tuple[NDArray[Any], ...]]
    least: NDArray[np.float32]
    least_with_early_collisions: NDArray[np.float32]


def assemble(
    job: Job, plan: Plan, journal: Journal, folder: Path, formats: Sequence[str], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Write every file of the dataset, dataset.json last, and return its content.

    :param provenance: what goes into dataset.json and into the metadata of each Parquet file.
    :raises InvalidInput: a finished unit was damaged meanwhile; it is removed, so that it will be computed again.
    """

    def of(scenario: Scenario) -> _Assembled:
        return _assemble(job, scenario, plan.scenarios[scenario.number], journal, folder, formats, provenance)

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
        parts = list(threads.map(of, job.scenarios))
    files = {name: entry for part in parts for name, entry in part.files.items()}
    index = index_table([columns for part in parts for columns in part.index])
    write_parquet(index, folder / INDEX, INDEX_COLUMNS, **provenance)
    files[INDEX] = file_entry(folder / INDEX, index.height)
    for policy in job.policies.values():
        with written_whole(folder / policy.file) as path:
            path.write_bytes(policy.data)
        files[policy.file] = file_entry(folder / policy.file, 0)
    everything = {
        "least_curvttc": _quartiles(np.concatenate([part.least for part in parts])),
        "with_early_collisions": {
            "kept": sum(part.counts["with_early_collisions"]["kept"] for part in parts),
            "collisions": sum(part.counts["with_early_collisions"]["collisions"] for part in parts),
            "least_curvttc": _quartiles(np.concatenate([part.least_with_early_collisions for part in parts])),
        },
    }
    scenarios = {part.name: part.counts for part in parts}
    description = description_of({**provenance, "all": everything}, job.filters, 0, scenarios, files)
    write_text(folder / DATASHEET, datasheet(description))
    description["files"][DATASHEET] = file_entry(folder / DATASHEET, 0)
    write_json(folder / DESCRIPTION, description)
    return description


def _assemble(
    job: Job,
    scenario: Scenario,
    plan: ScenarioPlan,
    journal: Journal,
    folder: Path,
    formats: Sequence[str],
    provenance: Mapping[str, Any],
) -> _Assembled:
    tables = {}
    for kept in (True, False) if job.keep_rejected else (True,):
        beside = folder if kept else folder / REJECTED
        beside.mkdir(exist_ok=True)
        metadata = {"scenario": scenario.number, "name": scenario.name, "kept": kept, **provenance}
        tables[kept] = EpisodeTable(beside, scenario.name, formats, ROW_GROUP, metadata)
    tally, missing = Tally(), plan.target
    index: list[tuple[NDArray[Any], ...]] = []
    least, with_early = [], []
    early_collisions = 0
    try:
        for place in range(plan.units_needed() or 0):
            part = journal.load(plan.unit(place))
            if part is None:
                raise InvalidInput(f"{journal.path(plan.unit(place))}: damaged since it was written; generate again")
            part = part.head(_up_to_kept(part, missing))
            missing -= int(part.kept.sum())
            starts = part.starts()
            for i in np.flatnonzero(part.stored):
                if (kept := bool(part.kept[i])) in tables:
                    tables[kept].add(
                        int(part.number[i]), part.values[starts[i] : starts[i + 1]], int(part.pedestrians[i])
                    )
            tally.add(part.reason, part.outcome, part.failed, part.vehicle_path, part.pedestrian_path)
            lengths = part.vehicle_path.astype(np.float32), part.pedestrian_path.astype(np.float32)
            of_scenario = np.full(len(part), scenario.number, np.uint8)
            index.append(
                (of_scenario, part.number, part.outcome, part.reason, part.frames, part.least_curvttc, *lengths)
            )
            early = _early_collisions(part)
            early_collisions += int(early.sum())
            least.append(part.least_curvttc[part.kept])
            with_early.append(part.least_curvttc[part.kept | early])
        files = {
            path.relative_to(folder).as_posix(): file_entry(path, rows)
            for table in tables.values()
            for path, rows in table.close()
        }
    except BaseException:
        for table in tables.values():
            table.discard()
        raise
    summary = tally.summary()
    of_kept, of_all = np.concatenate(least), np.concatenate(with_early)
    counts = {
        "number": scenario.number,
        **summary,
        "least_curvttc": _quartiles(of_kept),
        "with_early_collisions": {
            "kept": len(of_all),
            "collisions": summary["kept_outcomes"]["collision"] + early_collisions,
            "least_curvttc": _quartiles(of_all),
        },
    }
    return _Assembled(scenario.name, counts, files, index, of_kept, of_all)


def _up_to_kept(part: Part, wanted: int) -> int:
    """Return how many episodes of the part there are up to the `wanted`th kept one, or all."""
    places = np.flatnonzero(part.kept)
    return int(places[wanted - 1]) + 1 if len(places) >= wanted else len(part)


def _early_collisions(part: Part) -> NDArray[np.bool_]:
    """Return bool[n], collisions that are rejected for nothing but ending the episode too early."""
    others = np.delete(part.failed, _TOO_SHORT, axis=1).any(axis=1)
    mask: NDArray[np.bool_] = part.failed[:, _TOO_SHORT] & ~others & (part.outcome == COLLISION)
    return mask


def _quartiles(least: NDArray[np.float32]) -> list[float]:
    return [round(float(value), 4) for value in np.quantile(least.astype(np.float64), (0.25, 0.5, 0.75))]
