"""Datasets merged and selected: nothing is simulated, and what comes out verifies."""

import shutil
from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.combine import merge, select
from vpsci_ros.generate.generate_dataset import simulators
from vpsci_ros.generate.verify import verify
from vpsci_ros.report.summary import print_info

NAMES = {1: "LocationA_PedCross_S-N", 6: "LocationB_PedCross_N-S"}


def rows(folder: Path) -> dict[str, pl.DataFrame]:
    """Return the tables of a dataset by file name, with the index."""
    data = Dataset(folder)
    return {name: pl.read_parquet(folder / name) for name in data.description["files"] if name.endswith(".parquet")}


def test_scenarios_taken_apart_and_merged_are_the_dataset_again_and_verify(made: Path, tmp_path: Path) -> None:
    for number in NAMES:
        select(made, tmp_path / str(number), scenarios=[number])
    merge([tmp_path / "6", tmp_path / "1"], tmp_path / "both")
    found, whole = rows(tmp_path / "both"), rows(made)
    assert found.keys() == whole.keys()
    assert all(found[name].equals(whole[name]) for name in whole)
    assert Dataset(tmp_path / "both").scenarios == Dataset(made).scenarios
    result = verify(tmp_path / "both", lambda job: simulators(job, 40, 1))
    assert (result.findings, result.episodes) == ([], whole["episodes.parquet"].height)


def test_a_selection_has_the_chosen_episodes_alone_and_says_where_they_come_from(made: Path, tmp_path: Path) -> None:
    index = Dataset(made).index()
    kept = index.filter(pl.col("reason") == "kept", pl.col("scenario") == 6)
    last = int(kept["count"][2])
    description = select(made, tmp_path / "some", episodes=f"6:0-{last}", curvttc_below=60.0)
    assert list(description["scenarios"]) == [NAMES[6]]
    assert description["scenarios"][NAMES[6]]["kept"] == 3
    assert description["selected"]["episodes"] == f"6:0-{last}"
    assert [one.number for one in Dataset(tmp_path / "some").listed()] == kept["count"][:3].to_list()
    with pytest.raises(InvalidInput, match="no kept episode is as chosen"):
        select(made, tmp_path / "none", curvttc_below=-1.0)


def test_an_episode_in_two_datasets_is_refused(made: Path, tmp_path: Path) -> None:
    select(made, tmp_path / "one", scenarios=[1])
    with pytest.raises(InvalidInput, match=r"episode 1:0 is in .*made.* and .*one; `vpsci dataset select`"):
        merge([made, tmp_path / "one"], tmp_path / "both")


def test_tables_that_changed_are_noticed_and_neither_merged_nor_selected(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rich.console import Console

    folder = shutil.copytree(made, tmp_path / "d")
    table = pl.read_parquet(folder / f"{NAMES[1]}.parquet")
    table.filter(pl.col("count") < 5).write_parquet(folder / f"{NAMES[1]}.parquet")
    print_info(folder, Console())
    assert f"changed since it was written, so dataset.json differs: {NAMES[1]}.parquet" in capsys.readouterr().out
    with pytest.raises(InvalidInput, match=f"{NAMES[1]}.parquet changed since it was written"):
        select(folder, tmp_path / "e", scenarios=[1])
