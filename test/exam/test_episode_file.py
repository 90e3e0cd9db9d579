"""Simulated episodes as one Parquet file."""

from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.episode_block import EpisodeBlock, concat_blocks, ended_blocks
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.result import EpisodeFile, write_episodes
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop

SCENARIOS = load_scenarios([1, 104], [])
CONFIG = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", episode_time=2.0, pedestrians=2)


def simulated() -> EpisodeBlock:
    """Return one episode of each scenario, with two pedestrians and 41 frames."""
    steps = Loop(World(CONFIG, SCENARIOS, [(1, 0), (104, 0)], 2, 1))
    return concat_blocks(list(ended_blocks(steps, SCENARIOS)))


def test_episodes_are_read_to_the_bit_and_what_is_damaged_is_refused(tmp_path: Path) -> None:
    block = simulated()
    episodes = list(block.episodes(CONFIG.tick, SCENARIOS, "a loop"))
    assert [episode.name for episode in episodes] == ["1:0", "104:0"], "of one number, in different scenarios"
    assert [episode.pedestrians for episode in episodes] == [2, 2]
    path = tmp_path / "frames.parquet"
    write_episodes(path, block, CONFIG.tick, SCENARIOS)
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
    write_episodes(path, block.without(block.keys), CONFIG.tick, SCENARIOS)
    assert list(EpisodeFile(path).read()) == []


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        ((81, 82), "episode 1:0, pedestrian 1: expected the number of its frames to be 41, got 40"),
        ((0, 41), "episode 1:0, pedestrian 1: expected its number to be 0, got 1"),
        ((82, 123), "episode 104:0, pedestrian 1: expected its number to be 0, got 1"),
    ],
)
def test_a_pedestrian_without_some_of_its_frames_is_named(lost: tuple[int, int], said: str, tmp_path: Path) -> None:
    path = tmp_path / "frames.parquet"
    write_episodes(path, simulated(), CONFIG.tick, SCENARIOS)
    whole = pq.read_table(path)  # with what the file says of its episodes
    pq.write_table(pa.concat_tables([whole.slice(0, lost[0]), whole.slice(lost[1])]), path)
    with pytest.raises(InvalidInput, match=f"frames.parquet: {said}; rows are missing"):
        list(EpisodeFile(path).read())
