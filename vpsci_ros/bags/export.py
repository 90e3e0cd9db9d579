"""Export of a bag as a dataset: its recorded episodes, filtered, as tables."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from vpsci_ros.bags.episodes import bag_episodes, choose, episode_ticks
from vpsci_ros.bags.reader import Bag, opened
from vpsci_ros.bags.run_record import bag_run, scenarios_of
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.dataset_tables import FORMATS
from vpsci_ros.data.episode_block import EpisodeBlock, EpisodeFrames
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import sha256

KEEP_ALL = FilterConfig(
    critical_ttc=1e9, missing_frames=10**9, least_frames=1, vehicle_distance=-1.0, pedestrian_distance=-1.0
)
"""Filters that every episode passes which has a CurvTTC at all."""


def export_bag(
    bag: str | Path | Bag,
    folder: str | Path,
    *,
    formats: Sequence[str] = FORMATS[:1],
    episodes: str = "",
    curvttc_below: float | None = None,
    keep_rejected: bool = False,
    console: Console | None = None,
) -> dict[str, Any]:
    """Write the episodes of a bag as a dataset and return its description.

    :param bag: rosbag2 folder; what it says of its making goes into the dataset's description.
    :param folder: output folder; must be new or empty.
    :param console: prints how many frames lack a state or its CurvTTC.
    :param episodes, curvttc_below: only these episodes, see `vpsci_ros.bags.episodes.choose`, and all of them, those
        without any CurvTTC in `rejected/`; otherwise the paper's filters decide.
    :raises InvalidInput: no bag of a graph, no episode that ended in it or is as chosen, or the folder is not empty.
    """
    console = console or Console()
    bag = opened(bag)
    scenarios = scenarios_of(bag)
    ticks, filters = read_bag(bag), None
    if episodes or curvttc_below is not None:
        chosen = choose(bag_episodes(bag), episodes, curvttc_below)
        ticks, filters = episode_ticks(bag, chosen), KEEP_ALL
        keep_rejected |= any(not np.isfinite(episode.listed.least_curvttc) for episode in chosen)
    first = next(ticks)
    frames, unseen = EpisodeFrames(len(first.state), scenarios=scenarios), 0

    def ended() -> Iterator[EpisodeBlock]:
        nonlocal unseen
        for tick in itertools.chain((first,), ticks):
            block = frames.add(tick)
            unseen += int(np.isnan(block.values).any(axis=1).sum())
            yield block

    with DatasetWriter(
        folder,
        {scenario.number: scenario.name for scenario in scenarios},
        {"period": first.period, **provenance_of(bag)},
        filters=filters,
        formats=formats,
        keep_rejected=keep_rejected,
    ) as writer:
        if not write_blocks(writer, ended()):
            raise InvalidInput(f"{bag}: not one of its {frames.unfinished} episodes ended while it was recorded")
        description = writer.close(unfinished=frames.unfinished)
    if unseen:
        console.print(f"the bag lacks states, or the monitor's answers to them, of {unseen} frames: empty cells")
    return description


def provenance_of(bag: str | Path | Bag) -> dict[str, Any]:
    """Return the origin of a bag: hashes of its files, and the configuration of its run.

    :raises InvalidInput: see `vpsci_ros.bags.run_record.bag_run`.
    """
    bag = opened(bag)
    run = bag_run(bag)
    return {
        "bag": {file.path.name: sha256(file.path) for file in bag.files},
        "configuration": run.parameters or None,
        "seed": run.parameters.get("world_simulator", {}).get("seed"),
        "weights": run.weights or None,
    } | ({"own_scenarios": run.own_scenarios} if run.own_scenarios else {})
