"""`vpsci generate`: a whole dataset, resumable, by any number of workers."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_index import DESCRIPTION, FORMATS
from vpsci_ros.data.episode_block import REASONS, EpisodeBlock
from vpsci_ros.data.published import LEAST_CURVTTC, TABLE_10
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.generate.job import Job, Unit
from vpsci_ros.generate.plan import RECORD, DatasetPlan, Journal, ScenarioPlan, journal_of
from vpsci_ros.generate.simulate import computing
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.runs.files import changed_files
from vpsci_ros.runs.progress import LINE_EVERY, Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.record import write_record
from vpsci_ros.runs.text_table import short_name
from vpsci_ros.runs.workers import Workers, computed, local_workers
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import Scenario

# ---- The datasheet of a generated dataset: content, origin and limits, in its own numbers.
#
# It is the folder's README.md. Its words are in `templates/datasheet.md`.


_TEMPLATES = Path(__file__).resolve().parent / "templates"
_NUMBERS = ("", "one", "two", "three", "four", "five", "six", "seven", "eight")


def datasheet(description: Mapping[str, Any], scenarios: Sequence[Scenario]) -> str:
    """Return the datasheet as Markdown.

    :param description: content of dataset.json.
    :param scenarios: of the dataset.
    """
    rows, configuration = description["scenarios"], description["configuration"]
    several = int(configuration["world_simulator"]["pedestrians"])
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("datasheet.md").render(
        d=description,
        rows=rows,
        kept=sum(row["kept"] for row in rows.values()),
        simulated=sum(row["simulated"] for row in rows.values()),
        collided=sum(row["kept_outcomes"]["collision"] for row in rows.values()),
        early=description["all"]["with_early_collisions"],
        right_turns=all(row["number"] in TABLE_10 for row in rows.values()),
        people="one pedestrian" if several == 1 else f"one to {_NUMBERS[several]} pedestrians",
        several=several > 1,
        parked=[scenario.name for scenario in scenarios if len(scenario.parked)],
        drivers=_drivers("All" if several > 1 else "Both", list(description["weights"])),
        reasons=REASONS[1:],
        table_10=TABLE_10,
        published=LEAST_CURVTTC,
        critical=CRITICAL_TTC,
        number="{:,}".format,
        seconds=lambda quartiles: ", ".join(f"{value:.2f}" for value in quartiles) + " s",
    )


def _drivers(everybody: str, learned: Sequence[str]) -> str:
    """Return in words the agents that act by a policy while CurvTTC is critical."""
    if not learned:
        return f"{everybody} road users are rule-based"
    return (
        f"{everybody} road users are learned policies" if len(learned) > 1 else f"The {learned[0]} is a learned policy"
    )


UNIT = 1024  # episodes in a unit of work; small datasets have smaller ones
PARALLEL = 1024  # episodes that a worker simulates side by side
Report = Callable[[DatasetPlan], None]


@dataclass(frozen=True)
class Generated:
    """The result of a run.

    :ivar description: content of dataset.json.
    :ivar computed: episodes simulated by this run, with those beyond the last needed one; 0 for a finished dataset.
    :ivar seconds: time of simulation and of writing.
    """

    description: dict[str, Any]
    computed: int
    seconds: tuple[float, float]


def simulators(job: Job, batch: int, count: int) -> Workers[Unit, tuple[int, bytes]]:
    """Return `count` workers on this machine; one of them is this process itself."""
    return local_workers(partial(computing, job, batch), count)


def generate(
    job: Job,
    targets: Mapping[int, int],
    folder: Path,
    workers: Callable[[], Workers[Unit, tuple[int, bytes]]],
    *,
    unit: int = UNIT,
    first: int = 0,
    formats: Sequence[str] = FORMATS[:1],
    report: Report | None = None,
) -> Generated:
    """Generate a dataset, or resume a stopped one.

    The episodes are those from `first` on, in the order of their numbers, up to the last kept one wanted in each
    scenario. The bytes of every file but generation.json depend on (job, targets, formats, first) alone.

    :param targets: kept episodes wanted by scenario number.
    :param folder: must be new or empty, or hold the same run, unfinished or complete.
    :param workers: called to start workers when a unit is missing.
    :param unit: most episodes in a unit of work of a new run.
    :param formats: of `vpsci_ros.data.dataset_index.FORMATS`.
    :param report: called after each unit.
    :raises InvalidInput: `folder` has another content, or this dataset, damaged; or another process uses it.
    :raises VpsciError: a scenario keeps almost no episode, workers die repeatedly, or the disk is full.
    """
    run = {
        **job.description(),
        "first_episode": first,
        "kept_wanted": {str(number): targets[number] for number in sorted(targets)},
        "formats": list(formats),
    }
    versions = {"versions": software_versions()}
    begin = time.monotonic()
    with journal_of(folder, run | versions, min(unit, max(32, 2 * max(targets.values())))) as journal:
        if journal is None:
            description = read_json(folder / DESCRIPTION)
            _require_whole(folder, description)
            return Generated(description, 0, (0.0, 0.0))
        plan = DatasetPlan(targets, first, journal.unit)
        for scenario in plan.scenarios.values():
            _resume(scenario, journal)
        if not plan.complete:
            compile_kernels()
        try:
            computed = 0 if plan.complete else _compute(plan, journal, workers(), report)
            middle = time.monotonic()
            description = _assemble(job, plan, journal, folder, formats, run)
            seconds = round(middle - begin, 3), round(time.monotonic() - middle, 3)
            write_record(
                folder / RECORD,
                begun=begin,
                results={"episodes_computed": computed, "seconds": {"simulating": seconds[0], "writing": seconds[1]}},
                inputs={policy.file: policy.digest for policy in job.policies.values()},
                facts={"unit": journal.unit},
            )
        except OSError as error:
            raise VpsciError(
                f"{folder}: cannot write ({error.strerror}); mend that and run the same command, which goes on"
            ) from error
        journal.remove()
    return Generated(description, computed, seconds)


def _require_whole(folder: Path, description: Mapping[str, Any]) -> None:
    """Refuse a finished dataset with a missing or changed file.

    :raises InvalidInput: a file is missing, or its content is not what dataset.json says.
    """
    require_form(description, {"files": {"*": {"sha256": str}}}, str(folder / DESCRIPTION))
    if lost := changed_files(folder, {name: entry["sha256"] for name, entry in description["files"].items()}):
        raise InvalidInput(
            f"{folder}: the dataset was finished, and {', '.join(lost)} {'are' if len(lost) > 1 else 'is'} missing or "
            "changed since; `vpsci dataset verify` says what; delete the folder to generate it again"
        )


def _resume(scenario: ScenarioPlan, journal: Journal) -> None:
    finished = set(journal.finished(scenario.scenario))
    place = 0
    while finished:
        unit = scenario.unit(place)
        place += 1
        finished.discard(unit.numbers[0])
        if (block := journal.load(unit)) is not None:
            scenario.take(unit, int(block.kept.sum()))


def _compute(
    plan: DatasetPlan, journal: Journal, workers: Workers[Unit, tuple[int, bytes]], report: Report | None
) -> int:
    def next_unit() -> Unit | None:
        unit = plan.next()
        return unit._replace(file=journal.path(unit)) if unit is not None else None

    episodes = 0
    try:
        for unit, (kept, _) in computed(workers, next_unit):
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


# ---- Progress of a run: a bar for each scenario with kept, rejected, acceptance, rate and time left.


class ProgressOfRun(Bars):
    """A bar for each scenario; without a terminal a line for all at intervals and at the end.

    :param names: of the scenarios by number.
    """

    def __init__(self, names: dict[int, str], *, quiet: bool = False, interval: float = LINE_EVERY) -> None:
        super().__init__(quiet=quiet, interval=interval)
        self._names = names
        self._before: dict[int, int] | None = None

    def __enter__(self) -> "ProgressOfRun":
        super().__enter__()
        return self

    def show(self, plan: DatasetPlan) -> None:
        """Update the display."""
        if self._before is None:  # what an earlier run had done does not count for this one's rate
            self._before = {number: _counted(scenario) for number, scenario in plan.scenarios.items()}
        hours = max(1e-3, time.monotonic() - self._begun) / 3600.0
        kept = simulated = wanted = 0
        for number, scenario in plan.scenarios.items():
            done = _counted(scenario)
            kept, simulated, wanted = kept + done, simulated + scenario.simulated, wanted + scenario.target
            rejected = scenario.simulated - scenario.kept
            rate = (done - self._before[number]) / hours
            note = f"kept, {rejected:,} rejected, {scenario.acceptance:.0%} pass, {rate:,.0f}/h"
            self.bar(short_name(self._names[number]), done, scenario.target, note)
        rate = (kept - sum(self._before.values())) / hours
        self.line(f"{kept:,} of {wanted:,} kept, {simulated:,} simulated, {rate:,.0f} kept/h", now=plan.complete)


def _counted(scenario: ScenarioPlan) -> int:
    """Return the kept episodes of a scenario, at most its target."""
    return min(scenario.kept, scenario.target)
