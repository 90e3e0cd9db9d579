"""The commands about recorded bags: `vpsci bag` info, export, verify, repair."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import writes_folder

bag_app = typer.Typer(
    no_args_is_help=True, help="Inspect, export, verify and repair bags of this package or of other ROS 2 tools."
)

BagPath = Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder (MCAP), or one of its files.")]
Recover = Annotated[bool, typer.Option("--recover", help="Read the whole messages of a damaged bag.")]


@bag_app.command()
def info(
    bag: BagPath,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything, with all episodes, as JSON.")] = False,
) -> None:
    """Print topics, types, rates, episodes, outcomes and origin of a bag."""
    from rich.console import Console

    from vpsci_ros.bags.info import bag_info, print_info

    found = bag_info(bag)
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        print_info(found, Console())


@bag_app.command()
@writes_folder
def export(
    bag: BagPath,
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder; must be new or empty.")],
    episodes: Annotated[
        str, typer.Option(metavar="3,7-9,6:12", help="Export these episodes only; 6:12 is number 12 of scenario 6.")
    ] = "",
    curvttc_below: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Export episodes whose least CurvTTC is below.")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV besides Parquet.")] = False,
    keep_rejected: Annotated[bool, typer.Option(help="Write rejected episodes besides.")] = False,
    recover: Recover = False,
) -> None:
    """Write a bag's episodes as a dataset (files and columns as in the paper's Tables 6 and 7); print a summary.

    Without a selection the paper's four filters decide. A selection by number or CurvTTC overrides them.
    """
    from rich.console import Console

    from vpsci_ros.bags.export import export_bag
    from vpsci_ros.bags.reader import Bag
    from vpsci_ros.report.summary import print_info
    from vpsci_ros.runs.progress import Bars

    opened = Bag(bag, recover=recover)
    with Bars(f"reading {bag}"):
        export_bag(
            opened,
            output,
            formats=("parquet", "csv") if csv else ("parquet",),
            episodes=episodes,
            curvttc_below=curvttc_below,
            keep_rejected=keep_rejected,
        )
    print_info(output, Console())


@bag_app.command()
def verify(
    bag: BagPath,
    weights: Annotated[
        str, typer.Option(metavar="FILE", help="Weights to simulate with, if the bag's are not installed.")
    ] = "",
    recover: Recover = False,
) -> None:
    """Simulate a bag again from its parameters; compare every state, safety answer, action and event, to the bit.

    Exit status: 0 equal; 1 a difference; 2 it cannot be simulated again; 3 a part was not compared.
    """
    from vpsci_ros.bags.reader import Bag
    from vpsci_ros.bags.verify import verify_bag
    from vpsci_ros.runs.progress import Bars

    with Bars(f"simulating {bag} again"):
        result = verify_bag(Bag(bag, recover=recover), weights=weights)
    for note in result.notes:
        print(f"note: {note}")
    if result.difference:
        print(f"{bag}: differs at {result.difference}; {result.ticks - 1:,} ticks before it are the same")
        raise typer.Exit(1)
    print(
        f"{bag}: {result.episodes:,} episode{'s' * (result.episodes != 1)} in {result.ticks:,} ticks simulated again, "
        f"{result.values:,} values of state, safety and actions the same to the bit"
    )
    for text in result.uncompared:
        print(f"not compared: {text}")
    if result.uncompared:
        raise typer.Exit(3)


@bag_app.command()
def repair(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder whose recorder was killed.")],
) -> None:
    """Complete a bag that was not closed: keep every whole message, write index and metadata again."""
    from vpsci_ros.bags.repair import repair_bag

    print(repair_bag(bag))
