"""A small dataset with a known outcome: one scenario in which the vehicle yields, one in which the pedestrian does."""

from pathlib import Path

import numpy as np
import pytest
import torch

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.episode_frames import EpisodeBatch
from vpsci_ros.world.state import COLLISION, GOAL

DT, FRAMES = 0.05, 180
VEHICLE_YIELDS, PEDESTRIAN_YIELDS = "LocationA_PedCross_S-N", "LocationA_PedCross_N-S"


@pytest.fixture(scope="module")
def one_thread():
    """Have torch's threads not wait for each other over small networks."""
    torch.set_num_threads(1)


def motion(speed: np.ndarray) -> np.ndarray:
    """Return the way [m] that lies behind at each frame at these speeds [m/s]."""
    return np.concatenate([[0.0], np.cumsum(speed[:-1])]) * DT


def encounter(vehicle_yields: bool, n: int, scenario: int, least: np.ndarray) -> EpisodeBatch:
    """Return n episodes: a car along y = 0 to x = 25 m, a pedestrian up x = 20 m; who yields stands in the middle."""
    t = np.arange(FRAMES) * DT
    pause = 1.0 - 0.98 * np.clip((t - 2.0) / 0.8, 0.0, 1.0) + 0.98 * np.clip((t - 6.0) / 0.8, 0.0, 1.0)
    drive, walk = (5.0 * pause, 1.4 + 0.0 * t) if vehicle_yields else (5.0 + 0.0 * t, 1.4 * pause)
    values = np.zeros((n, FRAMES, 10), np.float32)
    values[..., 0] = motion(drive)
    values[..., 2] = drive
    values[..., 4] = 20.0
    values[..., 5] = -4.5 + motion(walk)
    values[..., 7] = walk
    values[..., 8] = np.hypot(values[..., 0] - 20.0, values[..., 5])
    values[..., 9] = np.where((t > 1.5) & (t < 3.0), least[:, None], np.inf)
    outcome = np.full(n, GOAL, np.uint8)
    outcome[-1] = COLLISION
    numbers = np.arange(n, dtype=np.int64)
    return EpisodeBatch(
        np.full(n, scenario, np.uint8), numbers, outcome, np.full(n, FRAMES), values, np.zeros(256, np.int64)
    )


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a dataset of 4, 3 and 1 episodes; one of the second scenario, and the third's, never are critical."""
    folder = tmp_path_factory.mktemp("analysis") / "dataset"
    with DatasetWriter(folder, {1: VEHICLE_YIELDS, 2: PEDESTRIAN_YIELDS, 3: "empty"}, {}, period=DT) as writer:
        writer.add(encounter(True, 4, 1, np.array([1.0, 2.0, 3.0, 4.0])))
        writer.add(encounter(False, 3, 2, np.array([9.0, 2.5, 1.5])))
        writer.add(encounter(True, 1, 3, np.array([7.0])))
        writer.close()
    return folder


@pytest.fixture(scope="session")
def harmless_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a dataset of one episode that never was critical, so that none was kept."""
    folder = tmp_path_factory.mktemp("analysis") / "harmless"
    with DatasetWriter(folder, {1: VEHICLE_YIELDS}, {}, period=DT) as writer:
        writer.add(encounter(True, 1, 1, np.array([7.0])))
        writer.close()
    return folder
