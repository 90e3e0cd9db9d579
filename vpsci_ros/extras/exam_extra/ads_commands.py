"""The commands `vpsci ads-search`, `ads-why`, `ads-compare`, `ads-protocol` and `ads-socket`."""

import math
import sys
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.exam import Ads, AdsClass, Episodes, ExamFolder, FailIf, Recorded, Workers, examined_sections
from vpsci_ros.cli.options import (
    Cluster,
    MixedCpus,
    Params,
    Quiet,
    Settings,
    file_to_write,
    read_sections,
    site_of,
    stoppable,
    writes_folder,
)

PANEL = "Examine a driving system"  # of `vpsci --help`
search_app, why_app, compare_app, protocol_app, socket_app = (typer.Typer(add_completion=False) for _ in range(5))


@search_app.command(rich_help_panel=PANEL, short_help="Find the episodes in which a system fails.")
@writes_folder
def ads_search(
    output: ExamFolder,
    params: Params = Path("ads_test"),
    ads: Ads = None,
    ads_class: AdsClass = None,
    pedestrian: Annotated[str, typer.Option(help="Pedestrian of the exam, except recorded.")] = "learned",
    pool: Annotated[
        int, typer.Option(min=100, max=10_000_000, help="Episodes to search, simulated with a surrogate of the system.")
    ] = 20_000,
    budget: Annotated[int, typer.Option(min=40, max=1_000_000, help="Episodes that the system drives.")] = 1000,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Find episodes in which a driving system fails (parameter ads_test.failure), and estimate how often it does."""
    from vpsci_ros.exam.exam import prepare
    from vpsci_ros.extras.exam_extra.search.search_exam import run_search
    from vpsci_ros.extras.exam_extra.search.seek import SearchConfig

    search = SearchConfig(pedestrian, pool, budget)
    site = site_of(workers, cluster, mixed_cpus)
    exam = prepare(read_sections(params, settings), ads, ads_class, site)
    with stoppable(output):
        failures = run_search(exam, search, output, workers=site, quiet=quiet)
    for reason in failures:
        print(f"failed: {reason}", file=sys.stderr)
    _end(failures)


@why_app.command(rich_help_panel=PANEL, short_help="Find changes that avoid an exam's failures.")
def ads_why(
    exam: Annotated[Path, typer.Argument(metavar="EXAM", help="Folder of a finished exam of `vpsci ads-test`.")],
    failures: Annotated[int, typer.Option("-n", min=1, help="Worst failures to repeat, for each pedestrian.")] = 3,
    minutes: Annotated[
        float, typer.Option(min=0.0, help="Start no run later; the same command resumes. 0: no limit.")
    ] = 10.0,
    workers: Workers = None,
    quiet: Quiet = False,
) -> None:
    """Repeat the worst failures of an exam with one change each, and report the changes that avoid them.

    Run it in the folder and environment of the exam, since it drives the same system. The result is in EXAM/why.
    """
    from vpsci_ros.extras.exam_extra.explain import explain_exam

    with stoppable(exam):
        limit = 60.0 * minutes or math.inf
        page = explain_exam(exam, failures, workers=workers or 1, quiet=quiet, limit=limit)
    print(f"report: {page}")


@compare_app.command(rich_help_panel=PANEL, short_help="Compare exams of several systems.")
def ads_compare(
    exams: Annotated[list[Path], typer.Argument(metavar="EXAM EXAM ...", help="Folders of `vpsci ads-test`.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PAGE.html", callback=file_to_write, help="The page to write.")
    ],
    json_path: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", callback=file_to_write, help="Write all numbers to this file."),
    ] = None,
) -> None:
    """Compare finished exams of the same episodes in one table, with paired differences and an order of the systems.

    Exams of other episodes are refused. Two systems have an order where their difference shows (docs/ads.md).
    """
    from vpsci_ros.extras.exam_extra.side_by_side import compare_exams

    compare_exams(exams, output, json_path)


@protocol_app.command(rich_help_panel=PANEL, short_help="Drive Euro NCAP's car-to-pedestrian tests.")
@writes_folder
def ads_protocol(
    output: ExamFolder,
    params: Params = Path("ads_test"),
    ads: Ads = None,
    ads_class: AdsClass = None,
    beside: Annotated[
        Path | None, typer.Option("--exam", metavar="EXAM", help="Show this exam of the same system beside the points.")
    ] = None,
    fail_below: Annotated[
        float, typer.Option(metavar="POINTS", help="Exit with status 1 below this number of points.")
    ] = 0.0,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Run Euro NCAP's car-to-pedestrian tests, as far as a kinematic world can, and compute their points."""
    from vpsci_ros.exam.exam import prepare
    from vpsci_ros.extras.exam_extra.protocol import run_protocol

    site = site_of(workers, cluster, mixed_cpus)
    exam = prepare(read_sections(params, settings), ads, ads_class, site)
    with stoppable(output):
        failures = run_protocol(exam, output, beside, fail_below, workers=site, quiet=quiet)
    _end(failures)


@socket_app.command(rich_help_panel=PANEL, short_help="Examine a program behind a socket: any language.")
@writes_folder
def ads_socket(
    output: ExamFolder,
    params: Params = Path("ads_test"),
    ads: Annotated[
        str | None,
        typer.Option(
            metavar="COMMAND", help="Command that starts the program; 'external' with --port if you start it yourself."
        ),
    ] = None,
    port: Annotated[
        int,
        typer.Option(min=0, max=65_535, help="Port on 127.0.0.1; 0: a free one, passed in VPSCI_ADS_PORT."),
    ] = 0,
    episodes: Episodes = None,
    recorded: Recorded = None,
    fail_if: FailIf = None,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Examine a program in any language that connects to a socket (one JSON object a line), without ROS."""
    from vpsci_ros.exam.conduct import run_exam
    from vpsci_ros.extras.exam_extra.socket_driver import prepare_socket

    site = site_of(workers, cluster, mixed_cpus)
    exam = prepare_socket(examined_sections(params, settings, episodes, recorded), ads, port, site)
    with stoppable(output):
        failures = run_exam(exam, output, fail_if or [], workers=site, quiet=quiet)
    _end(failures)


def _end(failures: list[str]) -> None:
    if failures:
        raise typer.Exit(1)
