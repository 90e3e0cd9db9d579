"""A dataset's README says what is in it, in the dataset's own numbers, and the metadata hold for any scenario."""

import json
from pathlib import Path

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.generate.datasheet import datasheet
from vpsci_ros.world import load_scenarios


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
    acts = "Both road users act by `random` from the moment a collision is near (CurvTTC below 5 s), and by"
    assert f"{acts} rules before." in text


def test_the_datasheet_of_a_crowd_among_parked_vehicles_says_so(made: Path) -> None:
    description = json.loads((made / "dataset.json").read_text()) | {"weights": {}}
    description["configuration"]["world_simulator"]["pedestrians"] = 3
    text = datasheet(description, load_scenarios([104]))
    assert "24 episodes of one car turning right and one to three pedestrians crossing, in 2 scenarios" in text
    assert "- One vehicle of one type and one to three pedestrians; no other traffic, signals or weather.\n" in text
    assert "- Parked vehicles hide pedestrians in Town10HD_Parked;" in text
    assert "All road users are rule-based." in text
