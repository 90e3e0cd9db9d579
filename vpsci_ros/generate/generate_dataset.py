"""`vpsci generate`: a whole dataset, resumable, by any number of workers."""

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import FORMATS
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.generate.datasheet import datasheet
from vpsci_ros.generate.job import Job, Unit
from vpsci_ros.generate.parts import FINISHED, WANTED, Parts, parts_of
from vpsci_ros.generate.plan import DatasetPlan, ScenarioPlan
from vpsci_ros.generate.simulate import Simulator, storing
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.record import write_record
from vpsci_ros.runs.workers import Site, Work, Workers, computed, local_workers

UNIT = 1024  # episodes in a unit of work; small datasets have smaller ones
PARALLEL = 1024  # episodes that a worker simulates side by side
Report = Callable[[DatasetPlan], None]


@dataclass(frozen=True)
class Generated:
    """The result of a generation.

    :ivar description: content of dataset.json.
    :ivar computed: episodes simulated by this run, with those beyond the last needed one; 0 for a finished dataset.
    :ivar seconds: time of simulation and of writing.
    """

    description: dict[str, Any]
    computed: int
    seconds: tuple[float, float]


def simulators(job: Job, batch: int, count: int) -> Workers[Unit, EpisodeBlock]:
    """Return `count` worker processes that compute episodes; for a count of 1, this process itself."""
    return local_workers(partial(Simulator, job, batch), count)


def part_writers(job: Job, batch: int, site: Site, parts: Parts) -> Workers[Unit, int]:
    """Return the workers of a site that make parts of a dataset, see `storing`."""
    return site.start(Work(partial(storing, job, batch, parts), parts.folder))


def generate(
    job: Job,
    targets: Mapping[int, int],
    folder: Path,
    workers: Callable[[Parts], Workers[Unit, int]],
    *,
    unit: int = UNIT,
    first: int = 0,
    formats: Sequence[str] = FORMATS[:1],
    mixed_cpus: bool = False,
    report: Report | None = None,
) -> Generated:
    """Generate a dataset, or resume a stopped one.

    The episodes are those from `first` on, in the order of their numbers, up to the last kept one wanted in each
    scenario. The bytes of every file but generation.json depend on (job, targets, formats, first) alone.

    :param targets: kept episodes wanted by scenario number.
    :param folder: must be new or empty, or hold the same run, unfinished or complete.
    :param workers: called to start workers when a unit is missing; each writes parts, and returns how many episodes of
        a unit are kept.
    :param unit: most episodes in a unit of work of a new run.
    :param formats: of `vpsci_ros.data.dataset_tables.FORMATS`.
    :param mixed_cpus: workers may have several kinds of CPU, as dataset.json then says.
    :param report: called after each unit.
    :raises InvalidInput: `folder` has another content, or this dataset, damaged; or another process uses it.
    :raises VpsciError: a scenario keeps almost no episode, workers die repeatedly, or the disk is full.
    """
    run = {
        **job.description(),
        "first_episode": first,
        WANTED: {str(number): targets[number] for number in sorted(targets)},
        "formats": list(formats),
    } | ({"mixed_cpus": True} if mixed_cpus else {})
    more = {"versions": software_versions(), "mixed_cpus": mixed_cpus or None}
    begin = time.monotonic()
    with parts_of(folder, run | more, min(unit, max(32, 2 * max(targets.values())))) as parts:
        if parts is None:
            data = Dataset(folder)
            _require_whole(data)
            return Generated(data.description, 0, (0.0, 0.0))
        plan = DatasetPlan(targets, first, parts.unit)
        if (folder / FINISHED).is_file():
            _reopen(Dataset(folder), plan, parts)
        _resume(plan, parts)
        if not plan.complete:
            job.compile_kernels()
        try:
            computed = 0 if plan.complete else _compute(plan, workers(parts), report)
            middle = time.monotonic()
            description = _assemble(job, plan, parts, folder, formats, run)
            seconds = round(middle - begin, 3), round(time.monotonic() - middle, 3)
            write_record(
                folder / FINISHED,
                begun=begin,
                results={"episodes_computed": computed, "seconds": {"simulating": seconds[0], "writing": seconds[1]}},
                inputs={policy.file: policy.digest for policy in job.policies.values()},
                facts={"unit": parts.unit},
            )
        except OSError as error:
            raise VpsciError(
                f"{folder}: cannot write ({error.strerror}); mend that and run the same command, which goes on"
            ) from error
        parts.remove()
    return Generated(description, computed, seconds)


def _require_whole(data: Dataset) -> None:
    """Refuse a finished dataset with a missing or changed file.

    :raises InvalidInput: a file is missing, or its content is not what dataset.json says.
    """
    if lost := data.changed():
        raise InvalidInput(
            f"{data.folder}: the dataset was finished, and {', '.join(lost)} {'are' if len(lost) > 1 else 'is'} "
            "missing or changed since; `vpsci dataset verify` says what; delete the folder to generate it again"
        )


def _reopen(data: Dataset, plan: DatasetPlan, parts: Parts) -> None:
    """Make parts of the episodes of a finished dataset, which is to be extended.

    Episodes of a unit that it holds in part are computed again.

    :raises InvalidInput: a file of the dataset is missing or changed.
    """
    _require_whole(data)
    for name, counts in data.scenarios.items():
        scenario = plan.scenarios[counts["number"]]
        block = data.stored(name)
        for begin in range(0, len(block) - parts.unit + 1, parts.unit):
            if (unit := scenario.unit_from(int(block.records["count"][begin]))) is not None:
                parts.write(unit, block.between(begin, begin + parts.unit))


def _resume(plan: DatasetPlan, parts: Parts) -> None:
    """Record the finished units, and name the files that are no part of this run."""
    for path, unit in parts.files(plan):
        if unit is not None and (part := parts.load(unit)) is not None:
            plan.scenarios[unit.scenario].take(unit, int(part.kept.sum()))
        else:
            print(f"note: {path} is damaged or no part of this run, so it is not used", file=sys.stderr)


def _compute(plan: DatasetPlan, workers: Workers[Unit, int], report: Report | None) -> int:
    episodes = 0
    try:
        for unit, kept in computed(workers, plan.next):
            plan.scenarios[unit.scenario].take(unit, kept)
            episodes += len(unit.numbers)
            if report is not None:
                report(plan)
            if plan.complete:
                break
    finally:
        workers.close()
    return episodes


def _assemble(
    job: Job, plan: DatasetPlan, parts: Parts, folder: Path, formats: Sequence[str], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Write every file of the dataset, dataset.json last, and return its content.

    :param provenance: facts for dataset.json and for the metadata of each Parquet file.
    :raises InvalidInput: a finished unit was damaged; it is removed, to be computed again.
    """
    names = {scenario.number: scenario.name for scenario in job.scenarios}
    keep = job.keep_rejected
    for name in (DESCRIPTION, FINISHED):  # of the dataset that is extended: its episodes are in the parts
        (folder / name).unlink(missing_ok=True)
    with (
        DatasetWriter(
            folder, names, provenance, filters=job.filters, formats=formats, keep_rejected=keep, resumed=True
        ) as writer,
        ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads,
    ):
        for number in names:
            writer.begin(number)
        list(threads.map(lambda number: _write(writer, plan.scenarios[number], parts), names))
        policies = {policy.file: policy.data for policy in job.policies.values()}
        return writer.close(beside=policies, datasheet=lambda found: datasheet(found, job.scenarios))


def _write(writer: DatasetWriter, plan: ScenarioPlan, parts: Parts) -> None:
    missing = plan.target
    for place in range(plan.units_needed() or 0):
        if (block := parts.load(plan.unit(place))) is None:
            raise InvalidInput(f"{parts.path(plan.unit(place))}: damaged since it was written; generate again")
        kept = np.flatnonzero(block.kept)[:missing]
        missing -= len(kept)
        writer.write(plan.scenario, block if missing else block.between(0, int(kept[-1]) + 1))
