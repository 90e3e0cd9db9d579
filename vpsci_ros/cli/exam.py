"""The command that puts a driving system to the exam: `vpsci ads-test`."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import Params, Quiet, Settings, read_sections


def ads_test(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same exam.")],
    params: Params = Path("ads_test"),
    ads: Annotated[
        str | None,
        typer.Option(
            "--ads",
            metavar="COMMAND",
            help="Command that starts the driving system, such as 'python my_ads.py'; 'external' if you start it "
            "yourself in this ROS_DOMAIN_ID. Default: the parameter file's, example_ads.",
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Episodes in each scenario, with each pedestrian.")
    ] = None,
    recorded: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Meet recorded people as well: a near-miss table (Parquet)."),
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-if",
            metavar="'MEASURE > NUMBER [@PEDESTRIAN]'",
            help="Exit with status 1 where this holds, with the pedestrian named or with any; repeatable.",
        ),
    ] = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Put a driving system to the exam: the same episodes with the learned and with reference pedestrians.

    Exit status: 0 passed; 1 a --fail-if holds, or the driving system did not drive all episodes; 2 bad input.
    """
    from vpsci_ros.exam.run import prepare, run_exam

    sections = read_sections(params, settings)
    if episodes is not None:
        sections = sections.changed("world_simulator", {"episodes": episodes})
    if recorded is not None:
        sections = sections.changed("ads_test", {"recorded": str(recorded)})
    if run_exam(prepare(sections, ads), output, fail_if or [], quiet=quiet):
        raise typer.Exit(1)
