"""A dataset that is not what its description says is found out, with the file and the first row that differs."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS
from vpsci_ros.data.parquet import read_metadata, write_parquet
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.generate_dataset import simulators
from vpsci_ros.generate.verify import job_of, verify
from vpsci_ros.policy.weights import load_weights, save_weights

NAME = "LocationB_PedCross_N-S"


def serial(job):
    return simulators(job, 40, 1)


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    """A copy of the dataset that a test may change."""
    shutil.copytree(made, tmp_path / "copy")
    return tmp_path / "copy"


def edit(path: Path, change: Callable[[pl.DataFrame], pl.DataFrame]) -> None:
    """Write a Parquet file of the dataset again, with rows changed and everything else as it was."""
    metadata = read_metadata(path)
    write_parquet(change(pl.read_parquet(path)), path, EPISODE_COLUMNS, **metadata)


def nudge(row: int, column: str, by: float) -> Callable[[pl.DataFrame], pl.DataFrame]:
    def change(rows: pl.DataFrame) -> pl.DataFrame:
        values = rows[column].to_numpy().copy()
        values[row] += by
        return rows.with_columns(pl.Series(column, values))

    return change


def test_a_dataset_as_generated_is_the_same_to_the_bit(made) -> None:
    result = verify(made, serial)
    assert result.findings == []
    assert result.episodes == sum(
        row["simulated"] for row in json.loads((made / "dataset.json").read_text())["scenarios"].values()
    )


def test_a_sample_simulates_only_as_many_episodes(made) -> None:
    result = verify(made, serial, sample=2)
    assert (result.findings, result.episodes) == ([], 4)


@pytest.mark.parametrize("sample", [None, 1])
def test_one_edited_value_is_found_wherever_it_is(copy, sample) -> None:
    path = copy / f"{NAME}.parquet"
    rows = pl.read_parquet(path)
    row = len(rows) - 7
    edit(path, nudge(row, "velocity_x_ped", 0.01))
    (finding,) = verify(copy, serial, sample=sample).findings
    assert (finding.file, finding.changed) == (path.name, True)
    where = f"row {row} (count {rows['count'][row]}, frame {rows['frame'][row]}): velocity_x_ped is "
    assert finding.what.startswith(where)


def test_an_edit_with_the_hash_made_right_is_found_all_the_same(copy) -> None:
    from vpsci_ros.runs.files import sha256

    path = copy / f"{NAME}.parquet"
    edit(path, nudge(3, "CurvTTC", 0.0))
    edit(path, nudge(11, "position_x_av", 0.5))
    description = json.loads((copy / "dataset.json").read_text())
    description["files"][path.name]["sha256"] = sha256(path)
    (copy / "dataset.json").write_text(json.dumps(description))
    (finding,) = verify(copy, serial).findings
    assert (finding.file, finding.changed) == (path.name, False)
    assert finding.what.startswith("row 11 ")


def test_within_the_tolerance_numbers_may_differ(copy) -> None:
    edit(copy / f"{NAME}.parquet", nudge(20, "position_y_ped", 1e-3))
    (finding,) = verify(copy, serial, tolerance=1e-2).findings
    assert finding.what.endswith("its numbers are as simulated")
    (finding,) = verify(copy, serial, tolerance=1e-4).findings
    assert finding.what.startswith("row 20 ")


def test_rows_that_are_missing_or_too_many_are_named(copy) -> None:
    edit(copy / f"{NAME}.parquet", lambda rows: rows[:-1])
    edit(copy / "rejected" / f"{NAME}.parquet", lambda rows: pl.concat([rows, rows[-1:]]))
    kept, rejected = sorted(verify(copy, serial).findings, key=lambda finding: finding.file)
    assert kept.what.startswith("missing row (count ")
    assert rejected.what.endswith("should not be there")


def test_damaged_bytes_are_named_with_the_file(copy) -> None:
    path = copy / f"{NAME}.parquet"
    data = bytearray(path.read_bytes())
    data[200:5000] = bytes(4800)
    path.write_bytes(data)
    (finding,) = verify(copy, serial).findings
    assert finding.file == path.name
    assert "not readable as such from row 0 on" in finding.what or finding.what.startswith("row ")


def test_a_dataset_of_csv_alone_is_read_and_verified_as_well(make, made, tmp_path) -> None:
    make(tmp_path / "d", formats=["csv"])
    assert Dataset(tmp_path / "d").rows(NAME).equals(Dataset(made).rows(NAME))
    assert verify(tmp_path / "d", serial).findings == []
    path = tmp_path / "d" / f"{NAME}.csv"
    lines = path.read_text().splitlines()
    cells = lines[41].split(",")
    cells[12] = "99.0"
    lines[41] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    (finding,) = verify(tmp_path / "d", serial).findings
    assert (finding.file, finding.changed) == (path.name, True)
    assert finding.what.startswith("row 40 ")
    assert "distance is 99.0" in finding.what


def test_an_edited_cell_of_the_index_is_found(copy) -> None:
    index = pl.read_parquet(copy / "episodes.parquet")
    changed = index.with_columns(pl.when(pl.int_range(pl.len()) == 2).then(7).otherwise("frames").alias("frames"))
    changed.cast(index.schema).write_parquet(copy / "episodes.parquet")
    (finding,) = verify(copy, serial).findings
    assert finding.what.startswith("row 2 (count 2): frames is 7")


def test_other_weights_are_refused(copy) -> None:
    (path,) = copy.glob("weights-*.safetensors")
    data = bytearray(path.read_bytes())
    weights = load_weights(path)
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match="damaged file"):
        verify(copy, serial)
    name = next(iter(weights.tensors))
    weights.tensors[name] += 1.0
    save_weights(path, weights)  # whole, and another's
    with pytest.raises(InvalidInput, match="the dataset was made with"):
        verify(copy, serial)


def test_a_dataset_of_a_bag_is_refused(made, copy) -> None:
    description = json.loads((copy / "dataset.json").read_text())
    del description["scenario_files"]
    (copy / "dataset.json").write_text(json.dumps(description))
    with pytest.raises(InvalidInput, match="expected a dataset of `vpsci generate`"):
        verify(copy, serial)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda given: given.update(first_episode=-1), "expected first_episode and simulated from 0 to"),
        (lambda given: given.update(first_episode=2**63), "expected first_episode and simulated from 0 to"),
        (lambda given: given["scenarios"][NAME].update(simulated=-5), "expected first_episode and simulated from 0 to"),
        (lambda given: given["scenarios"].update(elsewhere=given["scenarios"].pop(NAME)), f"expected {NAME}, as conf"),
        (lambda given: given["weights"]["vehicle"].update(sha256=7), "the dataset was made with 7"),
    ],
)
def test_an_edited_description_is_refused(copy, change, said) -> None:
    description = json.loads((copy / "dataset.json").read_text())
    change(description)
    (copy / "dataset.json").write_text(json.dumps(description))
    with pytest.raises(InvalidInput, match=said):
        verify(copy, serial)


def test_a_recorded_parameter_is_read_back_or_refused_by_name(copy) -> None:
    description = json.loads((copy / "dataset.json").read_text())
    policy = description["configuration"]["vehicle_policy"]
    policy["noise.start"] = 2.0 * policy["noise.start"]
    (copy / "dataset.json").write_text(json.dumps(description))
    assert job_of(Dataset(copy)).policies["vehicle"].config.noise.start == policy["noise.start"]
    policy["noise_start"] = 0.3
    (copy / "dataset.json").write_text(json.dumps(description))
    with pytest.raises(InvalidInput, match=r"dataset\.json, vehicle_policy: unknown parameter 'noise_start'"):
        job_of(Dataset(copy))
