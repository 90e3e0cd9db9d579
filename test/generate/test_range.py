"""Which episodes become critical beyond the range of the recorded people, on episodes that are known by hand."""

import numpy as np

from vpsci_ros.data.dataset_description import counts_of
from vpsci_ros.data.dataset_tables import index_table
from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock
from vpsci_ros.generate.simulate import ranged
from vpsci_ros.policy.onset_range import LEVELS

WIDE = np.repeat([[0.0, 10.0], [0.0, 40.0], [0.0, 3.0], [0.0, 180.0]], [1, len(LEVELS) - 1], axis=1)
"""Speeds to 10 m/s, distances to 40 m, walking speeds to 3 m/s, any angle."""


def block(speeds: list[float], ttc: list[float], pedestrians: int = 1) -> EpisodeBlock:
    """An episode of two frames each: a car along x, a walker 20 m ahead across; `ttc` is that of the second frame."""
    records = np.zeros(len(speeds) // pedestrians, JUDGED)
    records["frames"], records["pedestrians"] = 2, pedestrians
    records["count"], records["rows"] = np.arange(len(records)), 2 * pedestrians
    values = np.zeros((2 * len(speeds), len(QUANTITIES)), np.float32)
    values[:, 2] = np.repeat(speeds, 2)
    values[:, 4], values[:, 7] = 20.0, 1.2
    values[::2, 9], values[1::2, 9] = np.inf, ttc
    return EpisodeBlock(records, values)


def named(found: EpisodeBlock) -> list[str]:
    return index_table(found.records)["range"].to_list()


def test_the_first_critical_frame_decides_and_an_episode_without_one_has_no_range() -> None:
    found = ranged(block([5.0, 12.0, 12.0, 5.0], [4.0, 4.0, 6.0, np.inf]), [WIDE])
    assert named(found) == ["within", "beyond", "", ""]
    found.records["reason"] = 0
    assert counts_of(found.records)["beyond_range"] == {"episodes": 1, "of": 2}


def test_one_pedestrian_beyond_makes_the_episode_so() -> None:
    assert named(ranged(block([5.0, 12.0, 5.0, 5.0], [4.0] * 4, pedestrians=2), [WIDE])) == ["beyond", "within"]


def test_beyond_the_range_of_one_of_two_agents_is_beyond() -> None:
    narrow = WIDE.copy()
    narrow[0, 1:] = 4.0
    assert named(ranged(block([5.0, 3.0], [4.0, 4.0]), [WIDE, narrow])) == ["beyond", "within"]


def test_networks_have_no_range() -> None:
    found = ranged(block([5.0], [4.0]), [])
    assert named(found) == [""]
    assert counts_of(found.records)["beyond_range"] is None
