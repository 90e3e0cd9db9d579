"""The commands about generated datasets: `vpsci generate`, and `vpsci dataset` info, verify, bag, merge, select."""

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from vpsci_ros.cli.options import (
    Cluster,
    MixedCpus,
    Params,
    People,
    Quiet,
    Resumable,
    Settings,
    of_people,
    site_of,
    stoppable,
    writes_folder,
)
from vpsci_ros.errors import InvalidInput, VpsciError

dataset_app = typer.Typer(no_args_is_help=True, help="Inspect, verify, merge and select generated datasets.")

Count = Annotated[
    int | None, typer.Option("--workers", min=1, metavar="N", help="Processes; default: one for each usable core.")
]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a dataset.")]


@writes_folder
def generate(
    output: Resumable,
    params: Params = Path("stage3_generate"),
    scenarios: Annotated[
        str | None, typer.Option(metavar="1,2,...", help="Scenarios; default: the parameter file's.")
    ] = None,
    episodes: Annotated[int | None, typer.Option(min=1, metavar="N", help="Kept episodes in each scenario.")] = None,
    table10: Annotated[bool, typer.Option("--table10", help="Generate Table 10: 198,157 kept episodes.")] = False,
    people: People = None,
    settings: Settings = None,
    workers: Count = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    repeat: Annotated[
        Path | None, typer.Option("--from", metavar="DATASET.JSON", help="Generate the dataset of this file again.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Generate a dataset of episodes (stage 3); the same command resumes a stopped run, more --episodes extend it."""
    from vpsci_ros.cli.parameter_file import load
    from vpsci_ros.data.published import KEPT_PER_HOUR, TABLE_10
    from vpsci_ros.generate.generate_dataset import PARALLEL, part_writers
    from vpsci_ros.generate.generate_dataset import generate as run
    from vpsci_ros.generate.job import DatasetConfig, job_from
    from vpsci_ros.generate.progress import ProgressOfRun
    from vpsci_ros.generate.verify import repeated
    from vpsci_ros.runs.run_config import RunConfig

    if repeat is not None:
        if table10 or settings or people or any(each is not None for each in (scenarios, episodes)):
            raise InvalidInput("--from repeats a dataset as it is; leave out what else says what is generated")
        job, targets, first, formats = repeated(repeat)
    else:
        if table10 and episodes is not None:
            raise InvalidInput("--table10 and --episodes both say how many episodes are wanted; give one of them")
        if scenarios is not None and not all(part.strip().isdigit() for part in scenarios.split(",")):
            raise InvalidInput(f"--scenarios {scenarios}: expected numbers with commas, say 1,6")
        chosen = [] if scenarios is None else [f"world_simulator.scenarios=[{scenarios}]"]
        sections = load(params, [*(settings or []), *chosen, *of_people(people)])
        values = sections.get(DatasetConfig, "dataset")
        job = job_from(sections)
        wanted = episodes or (0 if table10 else values.kept)
        if not wanted and (unknown := [s.name for s in job.scenarios if s.number not in TABLE_10]):
            raise InvalidInput(f"scenario {unknown[0]} is not one of Table 10; say how many are wanted by --episodes N")
        targets = {s.number: wanted or TABLE_10[s.number].kept for s in job.scenarios}
        formats = values.formats
        first = sections.get(RunConfig, "world_simulator").first_episode
    names = {s.number: s.name for s in job.scenarios}
    site = site_of(workers, cluster, mixed_cpus, default=_cores())
    with stoppable(output), ProgressOfRun(names, quiet=quiet, where=site.hosts) as progress:
        done = run(
            job,
            targets,
            output,
            partial(part_writers, job, PARALLEL, site),
            first=first,
            formats=formats,
            mixed_cpus=site.mixed_cpus,
            report=progress.show,
        )
    kept = sum(row["kept"] for row in done.description["scenarios"].values())
    print(f"{kept:,} episodes kept; written: {output}, described in README.md and dataset.json")
    ranged = [row["beyond_range"] for row in done.description["scenarios"].values() if row.get("beyond_range")]
    if ranged:
        beyond, of = sum(row["episodes"] for row in ranged), sum(row["of"] for row in ranged)
        print(f"{beyond:,} of {of:,} ({beyond / of:.0%}) become critical beyond the range of the recorded people")
    if done.computed:
        simulating, writing = done.seconds
        rate = kept / (simulating + writing) * 3600.0
        paper = f"the paper's CARLA, which simulates more, kept {KEPT_PER_HOUR:.0f}"
        print(f"simulated in {simulating:.1f} s, written in {writing:.1f} s: {rate:,.0f} kept an hour; {paper}")


@dataset_app.command()
def info(folder: Folder) -> None:
    """Print a dataset's counts beside the paper's Table 10, rejections by reason, quartiles of the least CurvTTC."""
    from rich.console import Console

    from vpsci_ros.report.summary import print_info

    print_info(folder, Console())


@dataset_app.command()
def verify(
    folder: Folder,
    sample: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Episodes of each scenario, drawn at random; default: all.")
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=0.0, help="Allowed difference in m, m/s and s; 0: to the bit, for the same kind of CPU."),
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sample.")] = 0,
    workers: Count = None,
) -> None:
    """Simulate a dataset's episodes again and name each file that differs, with its first differing row."""
    from vpsci_ros.generate.generate_dataset import simulators
    from vpsci_ros.generate.verify import verify as run
    from vpsci_ros.runs.progress import Bars

    with Bars(f"simulating {folder} again"):
        start = partial(simulators, batch=512, count=workers or _cores())
        result = run(folder, start, sample=sample, tolerance=tolerance, seed=seed)
    for finding in result.findings:
        print(f"{finding.file}: {finding.what}" + (" (its hash is wrong, too)" if finding.changed else ""))
    if result.findings:
        hint = "" if result.same_cpu or tolerance else "; it comes from another kind of CPU: try --tolerance 1e-3"
        raise VpsciError(f"{folder}: {len(result.findings)} of its files are not as simulated{hint}")
    how = f"within {tolerance:g}" if tolerance else "to the bit"
    print(f"{folder}: {result.episodes:,} episodes simulated again, {result.rows:,} rows the same {how}, hashes right")


@dataset_app.command()
@writes_folder
def bag(
    folder: Folder,
    output: Annotated[Path, typer.Option("--output", "-o", help="Bag folder; must be new or empty.")],
    episodes: Annotated[
        list[str], typer.Option("--episode", metavar="SCENARIO:COUNT", help="An episode, say 6:12; repeatable.")
    ],
) -> None:
    """Simulate chosen episodes of a dataset again; write states, CurvTTC, actions and odometry as a bag (MCAP)."""
    from vpsci_ros.generate.bag import record_episodes

    chosen = []
    for text in episodes:
        scenario, _, number = text.partition(":")
        if not (scenario.isdigit() and number.isdigit()):
            raise InvalidInput(f"--episode {text}: expected SCENARIO:COUNT, two numbers, say 6:12")
        chosen.append((int(scenario), int(number)))
    ticks = record_episodes(folder, chosen, output)
    print(f"{len(chosen)} episodes in {ticks:,} ticks; written: {output}")


@dataset_app.command()
@writes_folder
def merge(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of datasets.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the new dataset; must be new or empty.")],
) -> None:
    """Merge datasets of one seed and configuration: other scenarios, or other episodes of them."""
    from vpsci_ros.generate.combine import merge as run

    _print_made(run(folders, output), output)


@dataset_app.command()
@writes_folder
def select(
    folder: Folder,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the new dataset; must be new or empty.")],
    scenarios: Annotated[str, typer.Option(metavar="1,2,...", help="Only these scenarios.")] = "",
    episodes: Annotated[str, typer.Option(metavar="6:12,1:3-9", help="Only these episodes.")] = "",
    outcome: Annotated[str, typer.Option(metavar="NAME", help="Only episodes that end so, say collision.")] = "",
    curvttc_below: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Only episodes whose least CurvTTC is below.")
    ] = None,
) -> None:
    """Write a part of a dataset as a dataset: the episodes that meet all given conditions."""
    from vpsci_ros.documents import given_names
    from vpsci_ros.generate.combine import select as run

    numbers = given_names(scenarios, "--scenarios")
    if not all(number.isdigit() for number in numbers):
        raise InvalidInput(f"--scenarios {scenarios}: expected numbers with commas, say 1,6")
    chosen = [int(number) for number in numbers]
    found = run(folder, output, scenarios=chosen, episodes=episodes, outcome=outcome, curvttc_below=curvttc_below)
    _print_made(found, output)


def _print_made(description: dict[str, Any], output: Path) -> None:
    kept = sum(row["kept"] for row in description["scenarios"].values())
    print(f"{kept:,} episodes kept; written: {output}, described in README.md and dataset.json")


def _cores() -> int:
    return len(os.sched_getaffinity(0))
