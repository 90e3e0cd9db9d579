"""The synthetic sample is reproducible, honest about its source, and moves as people and cars can."""

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.synthetic import synthetic_near_misses
from vpsci_ros.errors import InvalidInput


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    return synthetic_near_misses().table


def test_the_sample_has_sixty_near_misses_that_say_they_are_synthetic(table: pl.DataFrame) -> None:
    least = table.group_by("interaction").agg(pl.col("curvttc").min())["curvttc"]
    assert len(least) == 60
    assert least.max() < 5.0
    assert least.min() > 0.0
    assert table["source"].unique().to_list() == ["synthetic"]
    assert table["clip"].n_unique() == 60


def test_the_same_seed_gives_the_same_rows_and_a_longer_sample_begins_with_them(table: pl.DataFrame) -> None:
    assert synthetic_near_misses(10).table.equals(table.filter(pl.col("interaction") < 10))
    assert not synthetic_near_misses(10, seed=1).table.equals(synthetic_near_misses(10).table)


def test_velocities_are_the_rates_of_change_of_positions(table: pl.DataFrame) -> None:
    inside = table["interaction"].diff().fill_null(1).to_numpy()[1:] == 0
    for agent in ("veh", "ped"):
        for axis in "xy":
            moved = np.diff(table[f"{agent}_{axis}"].to_numpy())[inside] / 0.1
            velocity = table[f"{agent}_v{axis}"].to_numpy()
            assert np.abs(moved - 0.5 * (velocity[1:] + velocity[:-1])[inside]).max() < 0.05


def test_accelerations_stay_within_what_cars_and_people_do(table: pl.DataFrame) -> None:
    inside = table["interaction"].diff().fill_null(1).to_numpy()[1:] == 0
    along = np.diff(table["veh_speed"].to_numpy())[inside] / 0.1
    assert along.min() > -8.0
    assert along.max() < 3.0
    walk = np.hypot(table["ped_vx"].to_numpy(), table["ped_vy"].to_numpy())
    assert np.abs(np.diff(walk)[inside] / 0.1).max() < 3.0
    assert walk.max() < 3.0


def test_both_agents_yield_in_a_fair_part_of_the_sample(table: pl.DataFrame) -> None:
    walk = (pl.col("ped_vx") ** 2 + pl.col("ped_vy") ** 2).sqrt()
    slowest = table.group_by("interaction").agg(
        (pl.col("veh_speed").min() / pl.col("veh_speed").max()).alias("vehicle"),
        (walk.min() / walk.max()).alias("pedestrian"),
    )
    assert (slowest["vehicle"] < 0.6).sum() >= 12
    assert (slowest["pedestrian"] < 0.6).sum() >= 12


@pytest.mark.parametrize(("interactions", "seed"), [(0, 0), (10_001, 0), (5, -1)])
def test_impossible_requests_are_refused(interactions: int, seed: int) -> None:
    with pytest.raises(InvalidInput, match=f"got {interactions}, {seed}"):
        synthetic_near_misses(interactions, seed)
