"""Simulated episodes as one Parquet file."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.dataset import write_episodes
from vpsci_ros.data.dataset_reader import EpisodeFile
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.episode_block import concat_blocks, ended_blocks
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop


def test_episodes_are_read_to_the_bit_and_what_is_damaged_is_refused(tmp_path: Path) -> None:
    scenarios = load_scenarios([1, 104], [])
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", episode_time=2.0, pedestrians=2)
    steps = Loop(World(config, scenarios, [(1, 0), (104, 0)], 2, 1))
    block = concat_blocks(list(ended_blocks(steps, scenarios)))
    episodes = list(block.episodes(config.tick, scenarios, "a loop"))
    assert [episode.name for episode in episodes] == ["1:0", "104:0"], "of one number, in different scenarios"
    assert [episode.pedestrians for episode in episodes] == [2, 2]
    path = tmp_path / "frames.parquet"
    write_episodes(path, block, config.tick, scenarios)
    for one, other in zip(episodes, EpisodeFile(path).read(), strict=True):
        assert (one.listed, one.period, one.kinds) == (other.listed, other.period, other.kinds)
        assert one.scenario is not None
        assert other.scenario is not None
        assert one.scenario.document == other.scenario.document
        arrays = [name for name in Episode.__dataclass_fields__ if isinstance(getattr(one, name), np.ndarray)]
        assert len(arrays) == 13
        assert all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in arrays)
    rows = pl.read_parquet(path)
    assert rows.columns == list(EPISODE_COLUMNS)
    assert tuple(rows.columns[: len(TABLE_7)]) == TABLE_7
    assert rows.filter(pl.col("scenario") == 1)["position_x_ped"].to_list() == episodes[0].ped_x.ravel().tolist()
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 8] ^= 1
    for damaged in (whole[:-200], bytes(flipped)):
        path.write_bytes(damaged)
        with pytest.raises(InvalidInput, match=r"frames.parquet: .*not readable"):
            list(EpisodeFile(path).read())
    write_episodes(path, block.without(block.keys), config.tick, scenarios)
    assert list(EpisodeFile(path).read()) == []
