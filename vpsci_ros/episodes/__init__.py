"""Episodes of motion from near-miss tables, datasets, bags and exams, by one function."""

from vpsci_ros.episodes.sources import EpisodeSource, open_source, read_episodes

__all__ = ["EpisodeSource", "open_source", "read_episodes"]
