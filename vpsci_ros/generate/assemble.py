"""The dataset's files from finished units: the same bytes for any order and size of units."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.datasheet import datasheet
from vpsci_ros.generate.job import Job
from vpsci_ros.generate.journal import Journal
from vpsci_ros.generate.plan import DatasetPlan, ScenarioPlan


def assemble(
    job: Job, plan: DatasetPlan, journal: Journal, folder: Path, formats: Sequence[str], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Write every file of the dataset, dataset.json last, and return its content.

    :param provenance: facts for dataset.json and for the metadata of each Parquet file.
    :raises InvalidInput: a finished unit was damaged; it is removed, to be computed again.
    """
    names = {scenario.number: scenario.name for scenario in job.scenarios}
    keep = job.keep_rejected
    with (
        DatasetWriter(
            folder, names, provenance, filters=job.filters, formats=formats, keep_rejected=keep, resumed=True
        ) as writer,
        ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads,
    ):
        for number in names:
            writer.begin(number)
        list(threads.map(lambda number: _write(writer, plan.scenarios[number], journal), names))
        policies = {policy.file: policy.data for policy in job.policies.values()}
        return writer.close(beside=policies, datasheet=lambda found: datasheet(found, job.scenarios))


def _write(writer: DatasetWriter, plan: ScenarioPlan, journal: Journal) -> None:
    missing = plan.target
    for place in range(plan.units_needed() or 0):
        block = journal.load(plan.unit(place))
        if block is None:
            raise InvalidInput(f"{journal.path(plan.unit(place))}: damaged since it was written; generate again")
        if (count := _up_to_kept(block, missing)) < len(block):
            block = block.only(np.arange(len(block)) < count)
        missing -= int(block.kept.sum())
        writer.write(plan.scenario, block)


def _up_to_kept(block: EpisodeBlock, wanted: int) -> int:
    """Return how many episodes of the block there are up to the `wanted`th kept one, or all."""
    places = np.flatnonzero(block.kept)
    return int(places[wanted - 1]) + 1 if len(places) >= wanted else len(block)
