"""The episodes of a bag through the collector that the simulation uses."""

from pathlib import Path

from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.episode_block import EpisodeBlock, EpisodeFrames


def collected(bag: Path) -> list[EpisodeBlock]:
    """Return the blocks of episodes that ended, none of them empty."""
    ticks = list(read_bag(bag))
    frames = EpisodeFrames(len(ticks[0].state))
    return [batch for batch in (frames.add(tick) for tick in ticks) if len(batch)]
