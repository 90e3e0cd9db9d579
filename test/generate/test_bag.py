"""Chosen episodes as a bag hold what the dataset holds, and read as any bag of a graph does."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bags.collected import collected

from vpsci_ros.bags.episodes import read_bag_episodes
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import arrow_rows
from vpsci_ros.data.parquet import as_polars
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.bag import record_episodes
from vpsci_ros.generate.verify import first_difference

MOTION = ("x", "y", "heading", "speed", "curvature", "ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc", "distance")
NAMES = {1: "LocationA_PedCross_S-N", 6: "LocationB_PedCross_N-S"}


def test_an_episode_of_a_dataset_and_of_its_bag_agree_in_heading_curvature_and_who_controls(made, tmp_path) -> None:
    data = Dataset(made)
    number = int(data.rows(NAMES[6])["count"][0])
    record_episodes(made, [(6, number)], tmp_path / "bag")
    (found,), (stored,) = read_bag_episodes(tmp_path / "bag"), data.read([f"6:{number}"])
    for name in MOTION:
        np.testing.assert_array_equal(getattr(stored, name), getattr(found, name).astype(np.float32), name)
    np.testing.assert_array_equal(stored.controlled, found.controlled)
    assert stored.controlled.any(), "the page says that the policies act"
    assert stored.seen.all()


def test_a_bag_of_chosen_episodes_holds_the_rows_of_the_dataset(made, tmp_path: Path) -> None:
    data = Dataset(made)
    chosen = [(6, int(data.rows(NAMES[6])["count"][-1])), (1, int(data.rows(NAMES[1])["count"][0]))]
    record_episodes(made, chosen, tmp_path / "bag")
    batches = collected(tmp_path / "bag")
    assert [tuple(b.records[["scenario", "count"]][0].tolist()) for b in batches] == chosen
    for batch, (scenario, number) in zip(batches, chosen, strict=True):
        expected = data.rows(NAMES[scenario]).filter(pl.col("count") == number)
        found = as_polars(arrow_rows(batch)).with_row_index("row")
        assert first_difference(expected, found, 0.0) is None


def test_a_scenario_or_an_episode_that_the_dataset_lacks_is_refused(made, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no scenario 2; it has 1, 6"):
        record_episodes(made, [(2, 0)], tmp_path / "bag")
    behind = int(Dataset(made).index().filter(pl.col("scenario") == 6)["count"].max()) + 1
    with pytest.raises(InvalidInput, match=f"no episode 6:{behind}; episodes.parquet lists those that it has"):
        record_episodes(made, [(6, behind)], tmp_path / "bag")
    assert not (tmp_path / "bag").exists()
