"""The `vpsci` command. Each subcommand imports what it needs when it runs, so that `vpsci --help` is quick."""

import io
import os
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros import __version__
from vpsci_ros.cli.added import WithAddedCommands
from vpsci_ros.cli.bag import bag_app
from vpsci_ros.cli.dataset import dataset_app, generate
from vpsci_ros.cli.doctor import doctor
from vpsci_ros.cli.exam import ads_test
from vpsci_ros.cli.learning import evaluate, import_command, pretrain, refine
from vpsci_ros.cli.options import (
    Output,
    Params,
    People,
    Quiet,
    Settings,
    file_to_write,
    of_people,
    read_sections,
    say_stopped,
    writes_folder,
)
from vpsci_ros.cli.people import people
from vpsci_ros.cli.view import view
from vpsci_ros.errors import InvalidInput, VpsciError, in_words, is_shortage

app = typer.Typer(
    name="vpsci",
    cls=WithAddedCommands,
    help="Generate safety-critical episodes of a car and a pedestrian, and examine driving systems with them.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
world_app = typer.Typer(no_args_is_help=True, help="Scenarios of the simulated world.")


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        print(f"vpsci_ros {__version__}")
        raise typer.Exit


@writes_folder
def graph(
    params: Params,
    output: Output,
    settings: Settings = None,
    domain_id: Annotated[
        int | None, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID; default: the environment's.")
    ] = None,
    composed: Annotated[bool, typer.Option("--composed", help="Run all nodes in one process: faster.")] = False,
    people: People = None,
    quiet: Quiet = False,
) -> None:
    """Run a graph of nodes from start to end. The parameter file selects the stage."""
    from vpsci_ros.nodes.graph import STOPPED, run_graph

    sections = read_sections(params, [*(settings or []), *of_people(people), *["graph.composed=true"] * composed])
    if domain_id is not None:
        os.environ["ROS_DOMAIN_ID"] = str(domain_id)
    result = run_graph(sections, output, quiet=quiet)
    if result.error:
        text = f"{result.error}; what was written up to then is in {output}"
        raise say_stopped(text) if result.error == STOPPED else VpsciError(text)
    print(f"done in {result.wall_time:.1f} s; written: {output}")


def node(
    context: typer.Context, name: Annotated[str, typer.Argument(help="Executable, as for `ros2 run vpsci_ros`.")]
) -> None:
    """Run one node, as `ros2 run` does, without ROS's tools: vpsci node NAME --ros-args -p batch:=4 ..."""
    from vpsci_ros.nodes.entry import start
    from vpsci_ros.nodes.node_config import EXECUTABLES

    if name not in EXECUTABLES:
        raise InvalidInput(f"unknown node {name!r}; expected one of {', '.join(EXECUTABLES)}")
    raise typer.Exit(start(name, [name, *context.args]))


@writes_folder
def demo(
    output: Output = Path("out/demo"),
    data: Annotated[
        Path | None,
        typer.Option(help="Folder with vci_dut and vci_citr, for more near misses.", envvar="VPSCI_DATA"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier demo in the output folder.")] = False,
) -> None:
    """Run short versions of all three stages by nodes; write bags, tables and a page that plays the episodes."""
    from vpsci_ros.cli.demo import run_demo

    run_demo(output, data, force=force)


@world_app.command("show")
def world_show(
    scenario: Annotated[
        str, typer.Argument(help="Number 1 to 8 (Table 6) or 101 to 104, name, or a YAML file of your own.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", callback=file_to_write, help="PNG to write.")],
    seed: Annotated[int, typer.Option(help="Seed of the spawns in the picture.")] = 1,
) -> None:
    """Draw a scenario as a PNG: lane, crosswalk, routes, goals and the places where agents are spawned."""
    from vpsci_ros.report.world_figures import save_scenario
    from vpsci_ros.world import load_scenario

    save_scenario(load_scenario(int(scenario) if scenario.isdigit() else scenario), output, seed)
    print(f"written: {output}")


START, EXAMINE, MAKE, NODES, LEARN, MEASURE = (
    "Start here", "Examine a driving system", "Generate and look", "Run nodes", "Learn from recordings", "Measure",
)  # fmt: skip
"""Groups of `vpsci --help`; the branches name theirs in words, too."""
for _panel, _name, _command, _line in (
    (START, "demo", demo, "Learn a little, generate, and leave a page that plays it."),
    (START, "doctor", doctor, "Say what is installed and whether ROS 2 works here."),
    (EXAMINE, "ads-test", ads_test, "Drive a system through episodes and report on it."),
    (MAKE, "generate", generate, "Generate a dataset of episodes."),
    (MAKE, "view", view, "Write a page that plays episodes."),
    (NODES, "graph", graph, "Run a graph of nodes from start to end."),
    (NODES, "node", node, "Run one node, as `ros2 run` does."),
    (LEARN, "import", import_command, "Make near misses from recordings."),
    (LEARN, "people", people, "Make a bank of recorded reactions: agents."),
    (LEARN, "pretrain", pretrain, "Train networks on near misses (stage 1)."),
    (LEARN, "refine", refine, "Train them further in simulation (stage 2)."),
    (MEASURE, "evaluate", evaluate, "Print the agents' errors on near misses (Table 9)."),
):
    _settings = {"allow_extra_args": True, "ignore_unknown_options": True} if _command is node else None
    app.command(_name, rich_help_panel=_panel, short_help=_line, context_settings=_settings)(_command)
for _panel, _name, _group, _line in (
    (MAKE, "dataset", dataset_app, "Inspect and verify datasets, or write one as a bag."),
    (MAKE, "world", world_app, "Draw a scenario."),
    (NODES, "bag", bag_app, "Inspect, export, verify and repair bags."),
):
    app.add_typer(_group, name=_name, rich_help_panel=_panel, short_help=_line)


def main() -> None:
    """Run the command line; print an error of this package as one line on standard error.

    Exit status: 2 for refused input, 1 for a failure, 130 for an interrupt.
    """
    _complete_streams()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends a command as Ctrl-C does, with its record
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # idle threads of torch wait without burning a core
    try:
        try:
            app()
        finally:
            signal.signal(signal.SIGTERM, before)
            sys.stdout.flush()
    except VpsciError as error:
        _end(2 if isinstance(error, InvalidInput) and not is_shortage(error) else 1, f"error: {error}")
    except KeyboardInterrupt:
        _end(130, "stopped")
    except BaseException as error:  # polars, in Rust, ends in a panic that is no Exception where it gets no thread
        if not (text := in_words(error)):
            raise
        _end(2 if isinstance(error, ModuleNotFoundError) else 1, f"error: {text}")


def _complete_streams() -> None:
    """Open the standard streams that the caller has closed on /dev/null; print escaped what a terminal cannot show."""
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:  # the next file that is opened would get its number
        os.set_inheritable(handle, True)
    os.close(handle)
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if (stream := getattr(sys, name)) is None:
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115 - until the end
        elif number and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _end(status: int, text: str) -> None:
    """Print `text` and end the process with `status`; a full disk or closed pipe loses the text."""
    from vpsci_ros.documents import printable

    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is sys.stderr:
                print(printable(text), file=stream)
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(status)
