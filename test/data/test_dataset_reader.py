"""A dataset reads back as it was written, from either format, a row group at a time."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode_frames import EpisodeFrames
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import GOAL

LENGTHS = [150, 60, 110, 201]


@pytest.fixture
def folder(simulate, tmp_path: Path) -> Path:
    collector = EpisodeFrames(3)
    with DatasetWriter(tmp_path / "d", {1: "one", 2: "unseen"}, {"seed": 3, "period": 0.05}, row_group=200) as writer:
        for tick in simulate(LENGTHS, [GOAL] * 4, 3):
            writer.add(collector.add(*tick))
        writer.close()
    return tmp_path / "d"


def test_episodes_of_several_row_groups_come_back_one_by_one(folder: Path) -> None:
    episodes = list(Dataset(folder).read())
    assert [(one.number, len(one)) for one in episodes] == [(0, 150), (2, 110), (3, 201)]
    assert episodes[2].ped_vy == pytest.approx(np.full((1, 201), 1.5))


def test_csv_alone_serves_as_well(folder: Path) -> None:
    before = Dataset(folder).rows("one")
    (folder / "one.parquet").unlink()
    assert Dataset(folder).rows("one").equals(before)
    assert [one.number for one in Dataset(folder).read()] == [0, 2, 3]


def test_rows_that_are_missing_are_noticed(folder: Path) -> None:
    (folder / "one.parquet").unlink()
    lines = (folder / "one.csv").read_text().splitlines()
    (folder / "one.csv").write_text("\n".join(lines[:50] + lines[60:]) + "\n")
    with pytest.raises(InvalidInput, match=r"one\.csv: frame 59 of episode 0: expected frame 49"):
        list(Dataset(folder).read())


def test_an_unknown_scenario_is_refused_with_the_known_ones(folder: Path) -> None:
    with pytest.raises(InvalidInput, match="no scenario two; it has one"):
        Dataset(folder).rows("two")
