"""From a bag to a dataset: the episodes that a graph recorded, filtered, as tables, with a summary and a picture."""

import json
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from vpsci_ros.analysis.figures import save_trajectories
from vpsci_ros.analysis.panels import typical_panels
from vpsci_ros.analysis.summary import print_rejections, print_summary, summarise
from vpsci_ros.data.bag_reader import bag_files
from vpsci_ros.data.bags import read_bag
from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_files import FORMATS
from vpsci_ros.data.episode_frames import EpisodeFrames
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.errors import InvalidInput
from vpsci_ros.provenance import sha256
from vpsci_ros.world import Scenario, load_scenarios
from vpsci_ros.world.scenario import scenario_files

PICTURE = "trajectories.png"


def export_bag(
    bag: str | Path,
    folder: str | Path,
    *,
    filters: FilterConfig | None = None,
    formats: tuple[str, ...] = FORMATS,
    keep_rejected: bool = False,
    recover: bool = False,
    console: Console | None = None,
) -> dict[str, Any]:
    """Write the episodes of a bag as a dataset with a picture, print what it holds, and return its description.

    :param bag: rosbag2 folder; a run's params.yaml and run.json beside it go into the dataset's description.
    :param folder: output folder; must be new or empty.
    :param recover: take what is whole of a bag that was not closed.
    :raises InvalidInput: no bag of a graph, no episode that ended in it, or the folder is not empty.
    """
    console = console or Console()
    scenarios = load_scenarios(scenario_files())
    ticks = read_bag(bag, recover=recover)
    first = next(ticks)
    frames = EpisodeFrames(len(first.state))
    with DatasetWriter(
        folder,
        {scenario.number: scenario.name for scenario in scenarios},
        provenance_of(Path(bag)),
        period=first.period,
        filters=filters,
        formats=formats,
        keep_rejected=keep_rejected,
    ) as writer:
        writer.add(frames.add(first.state, first.curvttc, first.distance))
        for tick in ticks:
            writer.add(frames.add(tick.state, tick.curvttc, tick.distance))
        if not writer.counts:
            raise InvalidInput(f"{bag}: not one of its {frames.unfinished} episodes ended while it was recorded")
        description = writer.close(unfinished=frames.unfinished)
    report(folder, scenarios, console)
    return description


def report(folder: str | Path, scenarios: list[Scenario], console: Console) -> None:
    """Print the summary of a dataset and draw its typical episodes into it."""
    rows = summarise(folder)
    print_summary(rows, console)
    print_rejections(folder, console)
    if any(row.kept for row in rows):
        save_trajectories(typical_panels(folder), scenarios, Path(folder) / PICTURE)
    else:
        console.print("no episode was kept, so there is no picture")


def provenance_of(bag: Path) -> dict[str, Any]:
    """Return what is known of how a bag was made: its files' hashes, and the run's configuration where it lies beside.

    :raises InvalidInput: params.yaml or run.json of the run is not readable.
    """
    found: dict[str, Any] = {
        "bag": {path.name: sha256(path) for path in bag_files(bag)},
        "configuration": None,
        "seed": None,
        "weights": None,
    }
    parameters, record = bag.resolve().parent / "params.yaml", bag.resolve().parent / "run.json"
    try:
        if parameters.is_file():
            sections = yaml.safe_load(parameters.read_text(encoding="utf-8"))
            found["configuration"] = {name: section["ros__parameters"] for name, section in sections.items()}
            found["seed"] = found["configuration"].get("world_simulator", {}).get("seed")
        if record.is_file():
            found["weights"] = json.loads(record.read_text(encoding="utf-8")).get("weights_sha256")
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidInput(f"{bag.parent}: params.yaml or run.json is not as a run writes it: {error!r}") from None
    return found
