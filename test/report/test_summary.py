"""The summary counts what the files hold, and says who yielded."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import batches, headings, yields
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.summary import print_summary, summarise
from vpsci_ros.safety.yielding import Yielded


def test_each_scenario_has_its_counts_quartiles_and_yields(dataset: Path) -> None:
    table = summarise(dataset)
    counts = table.select("scenario", "episodes", "kept", "collisions", "kept_collisions", "vehicle_yields")
    assert counts.rows() == [
        ("LocationA_PedCross_S-N", 4, 4, 1, 1, 4),
        ("LocationA_PedCross_N-S", 3, 2, 1, 1, 0),
        ("empty", 1, 0, 1, 0, 0),
        ("all", 8, 6, 3, 2, 4),
    ]
    assert table["pedestrian_yields"].to_list() == [0, 2, 0, 2]
    assert table["quartiles"][0].to_list() == pytest.approx([1.75, 2.5, 3.25])
    assert table["quartiles"][2].to_list() == []
    assert table["quartiles"][3].to_list() == pytest.approx(
        np.quantile([1.0, 2.0, 3.0, 4.0, 2.5, 1.5], [0.25, 0.5, 0.75])
    )


def test_the_table_fits_a_terminal_of_eighty_columns(dataset: Path) -> None:
    text = io.StringIO()
    print_summary(summarise(dataset), Console(width=80, file=text))
    lines = text.getvalue().splitlines()
    assert max(len(line.rstrip()) for line in lines) <= 80
    assert "…" not in text.getvalue()
    (row,) = (line.split() for line in lines if line.strip().startswith("A S-N"))
    assert row == ["A", "S-N", "4", "4", "1", "(1)", "1.75", "2.50", "3.25", "100", "0", "0"]


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


def test_episodes_are_classified_alike_in_any_batch(dataset: Path) -> None:
    episodes = list(Dataset(dataset).read())
    assert [len(batch) for batch in batches(episodes, 4)] == [4, 2]
    assert yields(episodes).tolist() == [one.yielded() for one in episodes]


def test_a_folder_without_a_description_is_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"dataset\.json: no such file; expected the folder of a dataset"):
        summarise(tmp_path)
    (tmp_path / "dataset.json").write_text("[]")
    with pytest.raises(InvalidInput, match="not the description of a dataset"):
        summarise(tmp_path)


def test_a_file_that_the_description_promises_must_be_there(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text((dataset / "dataset.json").read_text())
    (tmp_path / "episodes.parquet").write_bytes((dataset / "episodes.parquet").read_bytes())
    with pytest.raises(InvalidInput, match=r"LocationA_PedCross_S-N\.parquet: no such file"):
        summarise(tmp_path)
    (tmp_path / "LocationA_PedCross_S-N.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InvalidInput, match=r"S-N\.csv: expected the columns of Table 7"):
        summarise(tmp_path)
