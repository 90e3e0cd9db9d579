"""The commands of section 4: `vpsci report` and `vpsci safety`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.dataset import Folder
from vpsci_ros.cli.options import Quiet
from vpsci_ros.resources import RIGHT_TURNS

report_app = typer.Typer(add_completion=False)
safety_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="CurvTTC and other safety measures.",
    short_help="Compare CurvTTC with other safety measures.",
    rich_help_panel="Measure",
)


@report_app.command(rich_help_panel="Generate and look", short_help="Draw a dataset's figures as a page.")
def report(
    folder: Folder,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command; default: DIR/report."),
    ] = None,
    near_misses: Annotated[
        Path,
        typer.Option(
            metavar="TABLE", help="Recorded near misses to compare with: right_turns, a Parquet file, a part."
        ),
    ] = Path(RIGHT_TURNS),
    beside: Annotated[Path | None, typer.Option(metavar="DIR", help="Another dataset to compare with.")] = None,
    quiet: Quiet = False,
) -> None:
    """Draw a dataset's figures and statistics of the paper's section 4, as one HTML page.

    Figures 7 to 9 and 11 to 13 and Table 10, beside recorded people and
    another dataset, with intervals. Writes report.html (needs no other file),
    report.md (sections 4.3, 4.5 and 4.6 as one table of numbers), report.json
    and the pictures. A dataset of the rule-based pair:

      vpsci generate -o OUT
        --set world_simulator.vehicle_driver=autopilot
        --set world_simulator.pedestrian_driver=autopilot
    """
    from vpsci_ros.extras.paper.section_4.section_4_page import PAGE, TABLE, VIEW, sources_of_report, write_report
    from vpsci_ros.runs.output_folder import output_folder
    from vpsci_ros.runs.progress import Bars
    from vpsci_ros.view.episode_sources import read_source
    from vpsci_ros.view.view_page import write_view

    folder_of_report = output or folder / "report"
    with output_folder(folder_of_report), Bars("reading", quiet=quiet) as bars:
        write_report(folder, folder_of_report, near_misses=near_misses, beside=beside, notify=bars.line)
        bars.line("reading episodes")
        inputs = sources_of_report(folder, near_misses, beside)
        shown = [replace(read_source(path), key=key, title=title) for key, title, path in inputs]
        write_view(folder_of_report / VIEW, shown, f"Episodes of {folder}")
    print((folder_of_report / TABLE).read_text(encoding="utf-8"))
    print(f"written: {folder_of_report / PAGE} and {VIEW}, which plays the episodes; {TABLE}, report.json, pictures")


@safety_app.callback()
def _safety() -> None:
    """Keep `compare` a command of its own name, though it is the only one."""


@safety_app.command("compare")
def safety_compare(near_misses: Annotated[Path, typer.Argument(help="Near-miss table (Parquet).")]) -> None:
    """Print how often each safety measure detects the conflicts of each other measure, and how much earlier."""
    from vpsci_ros.extras.paper.section_4.safety_compare import compare

    compare(near_misses)
