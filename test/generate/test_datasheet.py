"""A dataset's README says what is in it, in the dataset's own numbers, and the metadata hold for any scenario."""

from functools import partial
from pathlib import Path

import pytest
from generate.small import UNIT

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.generate.generate_dataset import generate, part_writers
from vpsci_ros.generate.job import job_from
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import ThisMachine


@pytest.fixture(scope="module")
def crowd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of up to three pedestrians among parked vehicles, by the rule-based pair."""
    drivers = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}
    world = {"scenarios": [104], "pedestrians": 3, "crowd.sizes": [1.0, 1.0, 2.0], **drivers}
    anything = {"critical_ttc": 60.0, "least_frames": 1, "vehicle_distance": 0.0, "pedestrian_distance": 0.0}
    job = job_from(Sections({"world_simulator": world, "dataset": anything}))
    folder = tmp_path_factory.mktemp("crowd") / "dataset"
    generate(job, {104: 4}, folder, partial(part_writers, job, 40, ThisMachine()), unit=UNIT)
    return folder


def test_the_datasheet_states_the_datasets_own_numbers(made: Path) -> None:
    text = (made / "README.md").read_text()
    data = Dataset(made)
    simulated = sum(row["simulated"] for row in data.scenarios.values())
    assert f"{simulated:,} episodes were simulated, 24 kept." in text
    assert all(f"| {name} | 12 |" in text for name in data.scenarios)


def test_the_datasheet_of_one_pedestrian_says_so(made: Path) -> None:
    text = (made / "README.md").read_text()
    assert "24 episodes of one car turning right and one pedestrian crossing, in 2 scenarios" in text
    assert "- One vehicle of one type and one pedestrian; no other traffic, signals, weather or occlusion.\n" in text
    assert "Both road users are learned policies from the moment a collision is near (CurvTTC below 5 s)" in text


def test_the_datasheet_of_a_crowd_among_parked_vehicles_says_so(crowd: Path) -> None:
    text = (crowd / "README.md").read_text()
    assert "4 episodes of one car and one to three pedestrians crossing, in 1 scenario," in text
    assert "- One vehicle of one type and one to three pedestrians; no other traffic, signals or weather.\n" in text
    assert "- Parked vehicles hide pedestrians in Town10HD_Parked;" in text
    assert "All road users are rule-based." in text
