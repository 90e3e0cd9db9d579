"""A dataset reads back as it was written, a row group at a time."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import GOAL

LENGTHS = [150, 60, 110, 201]


@pytest.fixture
def folder(simulate, tmp_path: Path) -> Path:
    collector = EpisodeFrames(3)
    with DatasetWriter(tmp_path / "d", {1: "one", 2: "unseen"}, {"seed": 3, "period": 0.05}, row_group=200) as writer:
        write_blocks(writer, (collector.add(tick) for tick in simulate(LENGTHS, [GOAL] * 4, 3)))
        writer.close()
    return tmp_path / "d"


def test_episodes_of_several_row_groups_come_back_one_by_one(folder: Path) -> None:
    episodes = list(Dataset(folder).read())
    assert [(one.number, len(one)) for one in episodes] == [(0, 150), (2, 110), (3, 201)]
    assert episodes[2].ped_vy == pytest.approx(np.full((1, 201), 1.5))


def test_rows_that_are_missing_are_noticed(folder: Path) -> None:
    rows = pl.read_parquet(folder / "one.parquet")
    pl.concat([rows[:49], rows[59:]]).write_parquet(folder / "one.parquet")
    with pytest.raises(InvalidInput, match=r"one\.parquet: frame 59 of episode 0: expected frame 49"):
        list(Dataset(folder).read())


def test_a_file_that_is_gone_or_no_table_of_a_dataset_is_named(folder: Path) -> None:
    pl.DataFrame({"a": [1]}).write_parquet(folder / "one.parquet")
    with pytest.raises(InvalidInput, match=r"one\.parquet: expected the columns of an episode"):
        list(Dataset(folder).read())
    (folder / "one.parquet").unlink()
    with pytest.raises(InvalidInput, match=r"one\.parquet: no such file"):
        list(Dataset(folder).read())


def test_a_folder_without_a_description_is_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"dataset\.json: no such file; expected the folder of a dataset"):
        Dataset(tmp_path)
    (tmp_path / "dataset.json").write_text("[]")
    with pytest.raises(InvalidInput, match="not the description of a dataset"):
        Dataset(tmp_path)
