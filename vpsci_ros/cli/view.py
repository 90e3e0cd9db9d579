"""The command `vpsci view`, which writes a page that plays episodes."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import file_to_write


def view(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE...", help="Near-miss tables, folders of datasets, bags, folders of exams."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", callback=file_to_write, help="HTML file to write.")] = Path(
        "view.html"
    ),
    limit: Annotated[
        int, typer.Option(min=1, max=20_000, metavar="N", help="Most episodes of each source, evenly spread.")
    ] = 1000,
    episodes: Annotated[
        list[str] | None,
        typer.Option(
            "--episode", metavar="NAME", help="Show this episode only, say 6:12 or 17; repeatable; for one source."
        ),
    ] = None,
    title: Annotated[str, typer.Option(help="Title of the page; default: the sources' names.")] = "",
) -> None:
    """Write one HTML page that plays episodes from above; it opens from disk without a network.

    Two sources play side by side: recorded beside generated episodes, or the
    driving system of an exam beside the autopilot.
    """
    from vpsci_ros.data.dataset_description import DESCRIPTION
    from vpsci_ros.data.dataset_reader import Dataset
    from vpsci_ros.errors import InvalidInput
    from vpsci_ros.exam.view import is_exam, read_exam
    from vpsci_ros.view.episode_sources import read_source
    from vpsci_ros.view.view_page import write_view

    if episodes and (len(sources) > 1 or is_exam(sources[0])):
        raise InvalidInput("--episode goes with one table, dataset or bag; give one, or leave --episode out")
    found = []
    for path in sources:
        if (path / DESCRIPTION).is_file() and (warning := Dataset(path).warning()):
            print(f"note: {warning}", file=sys.stderr)
        found += read_exam(path, limit) if is_exam(path) else [read_source(path, limit, episodes or ())]
    size = write_view(output, found, title or ", ".join(path.resolve().name for path in sources))
    for source in found:
        part = f" of {source.total:,}, evenly spread" if len(source.episodes) < source.total and not episodes else ""
        print(f"  {source.title}: {len(source.episodes):,} episodes{part}")
    print(f"written: {output} ({size / 1e6:.1f} MB); open it in a browser")
