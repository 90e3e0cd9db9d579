"""The command `vpsci drive`: a person drives in a browser."""

import contextlib
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import Params, People, Settings, of_people, read_sections, stoppable, writes_folder
from vpsci_ros.errors import require

drive_app = typer.Typer(add_completion=False)


@drive_app.command(rich_help_panel="Examine a driving system", short_help="Drive the car by keys in a browser.")
@writes_folder
def drive(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same drive.")],
    params: Params = Path("drive"),
    episodes: Annotated[int | None, typer.Option(min=1, metavar="N", help="Episodes in each scenario.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0: a free one.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page; otherwise only print its address.")] = True,
    people: People = None,
    settings: Settings = None,
) -> None:
    """Drive the car by keys in a browser; the default pedestrian reacts, and you get the report of an exam.

    The page is served to this machine alone, at an address with a secret. The command ends when you close the page.
    """
    require("tornado")
    from vpsci_ros.extras.drive.drive_page import Page
    from vpsci_ros.extras.drive.person_exam import RELOADED, prepare_person, run_drive

    sections = read_sections(params, [*(settings or []), *of_people(people)[-1:]])  # the pedestrian's: a person drives
    if episodes is not None:
        sections = sections.changed("world_simulator", {"episodes": episodes})
    exam, factor = prepare_person(sections)
    with contextlib.closing(Page(output, port)) as page:
        print(f"open {page.address}", flush=True)
        if browser and not webbrowser.open(page.address):
            print("no browser could be opened here; load that address in one on this machine", flush=True)
        with stoppable(output):
            failures = run_drive(exam, factor, output, page)
        print("the page shows the results; close it, or press Ctrl-C, to end", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            page.wait_until_left(RELOADED)
    for reason in failures:
        print(f"not all episodes were driven: {reason}", file=sys.stderr)
    if failures:
        raise typer.Exit(1)
