"""A small dataset by policies of random weights: two scenarios, twelve kept episodes each."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from generate.small import NETWORK, PARALLEL, TARGETS, UNIT
from synthetic import random_weights

from vpsci_ros.generate.generate_dataset import Generated, generate, part_writers
from vpsci_ros.generate.job import Job, job_from
from vpsci_ros.policy.weights import save_weights
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import ThisMachine


@pytest.fixture(scope="session")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A weights file whose policies act, if not wisely."""
    path = tmp_path_factory.mktemp("weights") / "random.safetensors"
    save_weights(path, random_weights(NETWORK, seed=5))
    return path


@pytest.fixture(scope="session")
def sections(weights: Path) -> Sections:
    """The sections of a parameter file."""
    policy = {"weights": str(weights)}
    return Sections(
        {
            "world_simulator": {
                "seed": 3,
                "scenarios": [1, 6],
                "spawn": "paper",
                "episode_time": 10.0,
                "release_time": 5.0,
                "pedestrian_gain": 0.5,
            },
            "vehicle_policy": policy,
            "pedestrian_policy": policy,
            "dataset": {"keep_rejected": True},
        }
    )


@pytest.fixture(scope="session")
def job(sections: Sections) -> Job:
    """What the datasets of these tests are made from."""
    return job_from(sections)


@pytest.fixture(scope="session")
def make(job: Job) -> Callable[..., Generated]:
    """Generate into a folder: by so many workers, with other sizes of units and batches, for another job."""

    def run(
        folder: Path, workers: int = 1, *, of: Job = job, unit: int = UNIT, parallel: int = PARALLEL, **options: Any
    ):
        start = partial(part_writers, of, parallel, ThisMachine(workers))
        return generate(of, TARGETS, folder, start, unit=unit, **options)

    return run


@pytest.fixture(scope="session")
def made(make: Callable[..., Generated], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished dataset; not to be changed."""
    folder = tmp_path_factory.mktemp("made") / "dataset"
    make(folder)
    return folder
