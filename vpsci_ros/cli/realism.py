"""`vpsci realism`: how like people the policies behave, by the three protocols, beside their controls."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import Quiet, writes_folder
from vpsci_ros.resources import TO_MEASURE_ON


@writes_folder
def realism(
    data: Annotated[
        Path,
        typer.Option(
            "--data",
            metavar="TABLE",
            help="Near misses to be scored on: right_turns, a Parquet file, a part of one.",
        ),
    ] = Path(TO_MEASURE_ON),
    library: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE",
            help="Near misses whose residuals the control borrows. Default: other clips of --data's file.",
        ),
    ] = None,
    weights: Annotated[
        list[str] | None,
        typer.Option("--weights", metavar="[NAME=]FILE", help="Further weights: files or shipped names; repeatable."),
    ] = None,
    folds: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of `vpsci study folds` on --data: each clip by the weights that never saw it."
        ),
    ] = None,
    dataset: Annotated[Path | None, typer.Option(help="Folder of generated episodes, for free simulation.")] = None,
    conflicts: Annotated[
        Path | None, typer.Option(help="datlong.csv of the right-turn study, for evidence from elsewhere.")
    ] = None,
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Only clips that no weights given have learned from, by their metadata.")
    ] = False,
    clean: Annotated[
        bool, typer.Option("--clean", help="Without cars that stand and tracks that begin critical.")
    ] = False,
    temperature: Annotated[float, typer.Option(min=0.0, max=2.0, help="Of stochastic policies.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Of all that is drawn.")] = 0,
    episodes: Annotated[int, typer.Option(min=1, help="Of the dataset that are looked at, at most.")] = 2000,
    json_path: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all numbers to this file.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for numbers, picture and record: new, empty, or of the same run."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """How like people: energy score, likelihood, and how well a classifier separates simulated from recorded.

    From the same recorded onsets: the shipped weights and --weights beside
    the recording itself, constant velocity, social force, and residuals of
    other people. With --dataset and --conflicts free simulation and evidence
    from elsewhere, too. Weights are measured as they are; for honest numbers
    give --held-out, --folds, or recordings that they have never seen. With
    -o a run that is stopped (Ctrl-C) goes on when the same command is given
    again.

    About a minute of one core for each model.
    """
    given = locals()
    from vpsci_ros.studies.realism import RealismStudy, run_realism

    own = ("json_path", "output", "quiet")
    study = RealismStudy(**{name: value for name, value in given.items() if name not in own})
    run_realism(study, json_path, output, quiet=quiet)
