"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Any

import typer

Params = Annotated[Path, typer.Option("--params", help="Parameter file; those of the package are in params/.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="Output folder; must be new or empty.")]
Resumable = Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same run.")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="Override one parameter; repeatable.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
NearMisses = Annotated[
    list[Path] | None,
    typer.Option(
        "--near-misses",
        metavar="FILE",
        help="Near-miss table (Parquet); repeatable. Default: the parameter file's, or a synthetic sample.",
    ),
]


def read_sections(
    params: Path, settings: list[str] | None, near_misses: list[Path] | None = None
) -> dict[str, dict[str, Any]]:
    """Return a parameter file's sections with overrides applied.

    :raises InvalidInput: the file or an override is refused.
    """
    from vpsci_ros import config

    sections = config.load(params)
    config.override(sections, settings or [])
    if near_misses:
        sections["learner"]["near_misses"] = [str(path) for path in near_misses]
    return sections
