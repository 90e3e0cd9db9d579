"""Options that several commands share."""

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec

import typer

from vpsci_ros.errors import InvalidInput

if TYPE_CHECKING:
    from vpsci_ros.runs.run_config import Sections
    from vpsci_ros.runs.workers import Site

P = ParamSpec("P")

Params = Annotated[
    Path, typer.Option("--params", metavar="FILE", help="Parameter file: a path, or the name of one of the package's.")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="Output folder; must be new or empty.")]
Resumable = Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same run.")]


def file_to_write(context: typer.Context, path: Path | None) -> Path | None:
    """Return the path given for an output file, or refuse it; a callback of `typer.Option`.

    Until the command ends, a file that is read and is the output, by whatever path, is refused, too.

    :raises InvalidInput: no file can be written there, which is said before the work begins.
    """
    from vpsci_ros.documents import OUTPUTS
    from vpsci_ros.runs.files import require_writable

    if path is not None:
        require_writable(path)
        OUTPUTS.add(path)
        context.call_on_close(lambda: OUTPUTS.discard(path))
    return path


Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="NODE.PARAMETER=VALUE", help="Override one parameter; repeatable.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]


People = Annotated[
    str | None,
    typer.Option(
        "--people",
        metavar="SOURCE",
        help="Whose recorded reactions act, a source of the bank (`vpsci people BANK` lists them); default: its first.",
    ),
]


NearMisses = Annotated[
    list[Path] | None,
    typer.Option(
        "--near-misses",
        metavar="TABLE",
        help="Near misses: right_turns, a Parquet file, or a part of either (right_turns/train); repeatable. "
        "Default: the parameter file's, or right_turns/train.",
    ),
]


Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        envvar="DASK_SCHEDULER_ADDRESS",
        help="Work on a Dask cluster instead (docs/cluster.md): its scheduler, tcp://host:8786, or a scheduler file.",
    ),
]
MixedCpus = Annotated[
    bool,
    typer.Option("--mixed-cpus", help="Take workers with other CPUs, too: last bits differ, and the output says so."),
]


def site_of(workers: int | None, cluster: str | None, mixed_cpus: bool, *, default: int = 1) -> "Site":
    """Return where the work is done, by the options --workers, --cluster and --mixed-cpus.

    :param default: processes of this machine if nothing is said.
    :raises InvalidInput: they contradict each other.
    """
    from vpsci_ros.runs.workers import ThisMachine, cluster_at

    if not cluster:
        if mixed_cpus:
            raise InvalidInput("--mixed-cpus is about the workers of a cluster; give --cluster ADDRESS, too")
        return ThisMachine(workers or default)
    if workers is not None:
        raise InvalidInput(
            f"--workers {workers} counts processes of this machine, and --cluster {cluster} has workers of its own; "
            "give one of them"
        )
    return cluster_at(cluster, mixed_cpus)


def writes_folder(command: Callable[P, None]) -> Callable[P, None]:
    """Lock the folder of a command's parameter `output` while the command runs.

    The command raises `InvalidInput` where another parameter names this folder or a file in it.
    """

    @functools.wraps(command)
    def held(*args: P.args, **given: P.kwargs) -> None:
        from vpsci_ros.runs.output_folder import output_folder

        output: Any = given.get("output")
        status = None
        for name, value in given.items() if output else ():
            for each in value if isinstance(value, list) else [value] * (name != "output"):
                _require_outside(output, str(each).rpartition("=")[2])
        with contextlib.nullcontext() if output is None else output_folder(output):
            try:
                command(*args, **given)
            except typer.Exit as error:  # a result, not a failure
                status = error
        if status is not None:
            raise status

    return held


def _require_outside(output: Path, given: str) -> None:
    own, path = output.resolve(), Path(given)
    exists = os.path.exists(given)  # noqa: PTH110 - Path.exists() raises where the text is too long for a name
    if exists and own in (path.resolve(), *path.resolve().parents):
        raise InvalidInput(f"-o {output}: the output would replace an input, {path}; choose another output folder")


def of_people(people: str | None) -> list[str]:
    """Return the --set texts by which both policies use the source `people` of their banks; [] for None."""
    return [] if people is None else [f"{agent}_policy.people={people}" for agent in ("vehicle", "pedestrian")]


@contextlib.contextmanager
def stoppable(folder: Path) -> Iterator[None]:
    """Context manager that, after Ctrl-C or SIGTERM, prints how to resume in `folder` and exits with status 130."""
    from vpsci_ros.errors import Stopped

    try:
        yield
    except (KeyboardInterrupt, Stopped):
        raise say_stopped(f"stopped; what is done is in {folder}: the same command goes on there") from None


def say_stopped(text: str) -> typer.Exit:
    """Print that a command was stopped, unless standard error is full; return the exit with status 130 to raise."""
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr, flush=True)
    return typer.Exit(130)


def read_sections(params: Path, settings: list[str] | None, near_misses: list[Path] | None = None) -> "Sections":
    """Return a parameter file's sections with the --set texts and near-miss tables applied.

    :raises InvalidInput: the file or an override is refused.
    """
    from vpsci_ros.cli.parameter_file import load

    sections = load(params, settings or [])
    given = {"near_misses": [str(path) for path in near_misses]} if near_misses else {}
    return sections.changed("learner", given)
