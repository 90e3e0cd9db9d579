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


def test_episodes_come_back_padded_and_in_pieces(folder: Path) -> None:
    parts = list(Dataset(folder).episodes("one"))
    assert [part.count.tolist() for part in parts] == [[0, 2], [3]]
    assert [part.lengths.tolist() for part in parts] == [[150, 110], [201]]
    assert parts[0].values.shape == (2, 150, 10)
    assert np.isnan(parts[0].values[1, 110:]).all()
    assert parts[1]["velocity_y_ped"][0] == pytest.approx(1.5)


def test_csv_alone_serves_as_well(folder: Path) -> None:
    before = Dataset(folder).rows("one")
    (folder / "one.parquet").unlink()
    assert Dataset(folder).rows("one").equals(before)
    (part,) = Dataset(folder).episodes("one")
    assert part.count.tolist() == [0, 2, 3]


def test_rows_that_are_missing_are_noticed(folder: Path) -> None:
    (folder / "one.parquet").unlink()
    lines = (folder / "one.csv").read_text().splitlines()
    (folder / "one.csv").write_text("\n".join(lines[:50] + lines[60:]) + "\n")
    with pytest.raises(InvalidInput, match=r"one\.csv: frame 59 of episode 0: expected frame 49"):
        list(Dataset(folder).episodes("one"))


def test_an_unknown_scenario_is_refused_with_the_known_ones(folder: Path) -> None:
    with pytest.raises(InvalidInput, match="no scenario two; it has one"):
        Dataset(folder).rows("two")
