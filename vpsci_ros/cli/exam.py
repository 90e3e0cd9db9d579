"""The command `vpsci ads-test`, which examines a driving system."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vpsci_ros.cli.options import (
    Cluster,
    MixedCpus,
    Params,
    People,
    Quiet,
    Settings,
    of_people,
    read_sections,
    site_of,
    stoppable,
    writes_folder,
)
from vpsci_ros.errors import VpsciError

if TYPE_CHECKING:
    from vpsci_ros.runs.run_config import Sections

ExamFolder = Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same exam.")]
Ads = Annotated[
    str | None,
    typer.Option(
        "--ads",
        metavar="COMMAND",
        help="Command that starts the driving system, such as 'python my_ads.py'; 'external' if you start it "
        "yourself in this ROS_DOMAIN_ID. Default: the parameter file's, example_ads.",
    ),
]
AdsClass = Annotated[
    str | None,
    typer.Option(
        "--ads-class",
        metavar="MODULE:CLASS",
        help="Python class with reset(begin) and act(observation) that is the driving system instead: many "
        "episodes side by side in a process of its own, without ROS (docs/ads.md).",
    ),
]
Episodes = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Episodes in each scenario, with each pedestrian.")
]
Recorded = Annotated[
    Path | None,
    typer.Option(metavar="TABLE", help="Meet recorded pedestrians, too: right_turns, a Parquet file, a part of one."),
]
FailIf = Annotated[
    list[str] | None,
    typer.Option(
        "--fail-if",
        metavar="'[REQUIREMENT: ]MEASURE > NUMBER [@PEDESTRIAN]'",
        help="Exit with status 1 where this holds, with the pedestrian named or with any; repeatable. REQUIREMENT is "
        "your label, which junit.xml repeats.",
    ),
]
AllowStanding = Annotated[
    bool,
    typer.Option(
        "--allow-standing",
        help="Pass also a system that does not arrive on the empty road, or misses more than 5% of the pedestrians.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Graphs (or processes of a class) side by side, instead of one; all else is equal."
    ),
]


@writes_folder
def ads_test(
    output: ExamFolder,
    params: Params = Path("ads_test"),
    ads: Ads = None,
    ads_class: AdsClass = None,
    episodes: Episodes = None,
    recorded: Recorded = None,
    baseline: Annotated[
        Path | None,
        typer.Option(
            "--baseline",
            metavar="RUN",
            help="Folder of an earlier exam: say which of its episodes are fixed, newly broken, unchanged.",
        ),
    ] = None,
    detect: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=100.0,
            metavar="POINTS",
            help="Only say how many episodes show a change of failures by so many percentage points; drive nothing.",
        ),
    ] = None,
    fail_if: FailIf = None,
    allow_standing: AllowStanding = False,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    people: People = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Examine a driving system on the same episodes with the default pedestrian and reference pedestrians.

    Exit status: 0 passed; 1 a --fail-if holds, or the driving system did not drive all episodes, or does not arrive on
    the empty road; 2 bad input.
    """
    from vpsci_ros.exam.comparison import compared_with
    from vpsci_ros.exam.conduct import REPORT, run_exam
    from vpsci_ros.exam.exam import identity_of, prepare
    from vpsci_ros.exam.power import needed

    chosen = [*(settings or []), *of_people(people)[-1:]]  # the pedestrian's: the ADS drives
    sections = examined_sections(params, chosen, episodes, recorded)
    if allow_standing:
        sections = sections.changed("ads_test", {"allow_standing": True})
    site = site_of(workers, cluster, mixed_cpus)
    exam = prepare(sections, ads, ads_class, site)
    if detect is not None:
        earlier = compared_with(exam, identity_of(exam), baseline).rows if baseline else None
        typer.echo("\n".join(needed(exam, detect, earlier)))
        return
    with stoppable(output), _demanded(output / REPORT):
        failures = run_exam(exam, output, fail_if or [], workers=site, against=baseline, quiet=quiet)
    if failures:
        raise typer.Exit(1)


def examined_sections(
    params: Path, settings: list[str] | None, episodes: int | None, recorded: Path | None
) -> "Sections":
    """Return the sections of an exam's parameter file with the options of `vpsci ads-test` applied.

    :raises InvalidInput: the file or an override is refused.
    """
    sections = read_sections(params, settings)
    if episodes is not None:
        sections = sections.changed("world_simulator", {"episodes": episodes})
    return sections if recorded is None else sections.changed("ads_test", {"recorded": str(recorded)})


@contextlib.contextmanager
def _demanded(report: Path) -> Iterator[None]:
    """Raise if the `with` block ends without the exam's report, as when code of another package ends the program.

    :raises VpsciError: there is no report, or the block raised SystemExit.
    """
    try:
        yield
    except SystemExit as error:
        raise VpsciError(f"code of another package ended the program (SystemExit: {error}); no report") from error
    if not report.is_file():
        raise VpsciError(f"{report}: the exam ended without its report")
