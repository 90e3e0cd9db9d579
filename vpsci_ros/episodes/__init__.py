"""Episodes of motion from whatever holds them: near-miss tables, datasets, bags and exams through one door."""

from vpsci_ros.episodes.sources import EpisodeSource, open_source, read_episodes

__all__ = ["EpisodeSource", "open_source", "read_episodes"]
