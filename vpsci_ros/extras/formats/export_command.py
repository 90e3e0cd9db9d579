"""The command `vpsci export`."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import writes_folder

export_app = typer.Typer(add_completion=False)


@export_app.command(rich_help_panel="Generate and look", short_help="Write episodes in other formats.")
@writes_folder
def export(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", help="Near-miss table, folder of a dataset or of an exam, or bag.")
    ],
    formats: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT,...",
            help="openscenario, commonroad, osi, scenarionet, mp4, lanelet2, or an added one.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command.")],
    episodes: Annotated[
        str, typer.Option(metavar="NUMBER,...", help="Only episodes of these numbers or names; default: all.")
    ] = "",
    vehicle: Annotated[
        str,
        typer.Option(
            metavar="controllable|trajectory",
            help="openscenario and commonroad: a controller drives the vehicle, or it follows its trajectory.",
        ),
    ] = "controllable",
    road: Annotated[
        str,
        typer.Option(
            "--map", metavar="NAME", help="openscenario: your own map, such as Town10HD; default: a map of the lane."
        ),
    ] = "",
) -> None:
    """Write episodes in other formats, each format in its own folder below the output folder."""
    from vpsci_ros.documents import given_names
    from vpsci_ros.extras.formats.exporters import Options
    from vpsci_ros.extras.formats.exporters import export as run

    counts = run(source, given_names(formats, "--to"), output, Options(vehicle, road), episodes)
    for name, count in counts.items():
        print(f"written: {output / name}, {count:,} file{'s' * (count != 1)}")
