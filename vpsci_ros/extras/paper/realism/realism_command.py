"""`vpsci realism`: likeness of the agents to recorded people, beside naive controls."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import Quiet, file_to_write, writes_folder
from vpsci_ros.resources import TO_MEASURE_ON

realism_app = typer.Typer(add_completion=False)


@realism_app.command(rich_help_panel="Measure", short_help="Compare the agents with recorded people.")
@writes_folder
def realism(
    data: Annotated[
        Path,
        typer.Option(
            "--data",
            metavar="TABLE",
            help="Near misses to measure on: right_turns, a Parquet file, a part of one.",
        ),
    ] = Path(TO_MEASURE_ON),
    library: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE",
            help="Near misses whose residuals the control uses. Default: other clips of --data's file.",
        ),
    ] = None,
    weights: Annotated[
        list[str] | None,
        typer.Option("--weights", metavar="[NAME=]FILE", help="Further weights: files or shipped names; repeatable."),
    ] = None,
    people: Annotated[
        str | None,
        typer.Option(
            "--people",
            metavar="SOURCE",
            help="Source of the banks whose reactions act; default: that of --data, else the bank's first.",
        ),
    ] = None,
    dataset: Annotated[Path | None, typer.Option(help="Folder of generated episodes, for free simulation.")] = None,
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Measure only on clips held out of all --weights (without: of people).")
    ] = False,
    clean: Annotated[
        bool,
        typer.Option("--clean", help="Leave out cars that stand, tracks that begin critical, paths that stay apart."),
    ] = False,
    onsets: Annotated[
        int | None, typer.Option(min=2, metavar="N", help="Measure on N onsets at most, drawn by --seed.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the roll-outs.")] = 0,
    json_path: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", callback=file_to_write, help="Write all numbers to this file."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for numbers and record: new, empty, or of the same run."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Print likeness to people: energy score, likelihood, and a classifier's AUC of simulated against recorded.

    All start at the same recorded onsets: the shipped weights and --weights,
    the recording, constant velocity, constant turn, social force, and
    residuals of similar onsets. --dataset adds free simulation. Use --held-out, or recordings on
    which the weights were not trained. With -o the same command resumes a
    stopped run.

    Some seconds of one core for each model and hundred onsets.
    """
    options = locals()
    from vpsci_ros.extras.paper.realism.measure_realism import run_realism

    run_realism(**options)
