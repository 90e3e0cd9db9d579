"""Who yielded is read off episodes, alike in any batch."""

from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.data.courses import headings
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import yields
from vpsci_ros.safety.yielding import Yielded


def test_rejected_episodes_do_not_count_among_the_yields(dataset: Path) -> None:
    episodes = list(Dataset(dataset).read(scenario="LocationA_PedCross_N-S"))
    assert [one.number for one in episodes] == [1, 2]
    assert yields(episodes).tolist() == [Yielded.PEDESTRIAN] * 2


def test_a_standing_vehicle_keeps_its_heading() -> None:
    vx, vy = np.array([[0.0, 1.0, 0.0, 0.0, -1.0]]), np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])
    assert headings(vx, vy)[0] == pytest.approx([np.pi / 4, np.pi / 4, np.pi / 4, np.pi / 4, np.pi])
    assert np.isnan(headings(np.zeros((1, 3)), np.zeros((1, 3)))).all()


def test_frames_that_nobody_saw_do_not_stop_the_classification(dataset: Path) -> None:
    episodes = list(Dataset(dataset).read(scenario="LocationA_PedCross_S-N"))
    for one in episodes:
        for values in (one.x, one.y, one.heading, one.speed, one.ped_x, one.ped_y, one.ped_vx, one.ped_vy, one.curvttc):
            values[..., 70:75] = np.nan
    assert yields(episodes).tolist() == [Yielded.VEHICLE] * 4
