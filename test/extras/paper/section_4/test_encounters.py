"""Onsets, initial conditions and outcomes are those of hand-made interactions, generated or recorded alike."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import NEAR_MISS_COLUMNS
from vpsci_ros.extras.paper.section_4.encounters import SCHEMA, generated_encounters, recorded_encounters


def near_miss(interaction: int, least: float, source: str = "mine", braking: float = 0.0) -> pl.DataFrame:
    """A car along y = 0 at 5 m/s that brakes from the start; a pedestrian up x = 20 m; critical after 0.5 s."""
    t = np.arange(60) * 0.1
    speed = np.maximum(5.0 - braking * t, 0.0)
    x, y = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.1)]), -4.5 + 1.4 * t
    values = {name: np.zeros(60) for name, column in NEAR_MISS_COLUMNS.items() if column.dtype == pl.Float64}
    values |= {"time": t, "veh_x": x, "veh_speed": speed, "veh_vx": speed, "ped_x": np.full(60, 20.0), "ped_y": y}
    values |= {"ped_vy": np.full(60, 1.4), "distance": np.hypot(x - 20.0, y)}
    values["curvttc"] = np.where((t > 0.45) & (t < 2.05), np.where(t > 1.0, least, 4.5), np.inf)
    values["curvttc_causal"] = values["curvttc"]
    table = pl.DataFrame(values | {"step": np.arange(60)})
    named = {"interaction": interaction, "source": source, "clip": "one", "veh_id": 0, "ped_id": 0}
    named |= {"standing": False, "begins_critical": False, "contact": False, "apart": False}
    named |= {
        "group": interaction,
        "veh_name": "0",
        "ped_name": "0",
        "veh_length": 4.5,
        "veh_width": 1.8,
        "kind": "walker",
    }
    return table.with_columns(**{k: pl.lit(v) for k, v in named.items()}).select(list(NEAR_MISS_COLUMNS))


def test_a_generated_episode_is_described_at_its_first_critical_frame(dataset: Path) -> None:
    """CurvTTC is below 5 s from t = 1.55 s: 7.75 m at 5 m/s lie behind the car, 2.17 m at 1.4 m/s behind the walker."""
    found = generated_encounters(Dataset(dataset)).filter(pl.col("group") == "LocationA_PedCross_S-N")
    assert found.schema == SCHEMA
    assert found["least_curvttc"].to_list() == pytest.approx([1.0, 2.0, 3.0, 4.0])
    assert found["onset_curvttc"].to_list() == pytest.approx([1.0, 2.0, 3.0, 4.0])
    assert found["distance"].to_list() == pytest.approx([float(np.hypot(12.25, 2.33))] * 4)
    assert found["vehicle_speed"].to_list() == pytest.approx([5.0] * 4)
    assert found["pedestrian_speed"].to_list() == pytest.approx([1.4] * 4)
    assert found["conflict"].to_list() == [True, False, False, False]  # 2 s is not below 2 s
    assert found["vehicle_yields"].all()
    assert not found["pedestrian_yields"].any()


def test_a_recorded_near_miss_is_described_by_the_same_columns(tmp_path: Path) -> None:
    found = recorded_encounters(pl.concat([near_miss(0, 1.5, braking=1.0), near_miss(1, 2.5)]))
    assert found.schema == SCHEMA
    assert found["group"].to_list() == ["mine/one 0", "mine/one 1"], "of one clip the groups are resampled"
    assert found["onset_curvttc"].to_list() == [4.5, 4.5]
    assert found["least_curvttc"].to_list() == [1.5, 2.5]
    assert found["conflict"].to_list() == [True, False]
    assert found["vehicle_speed"].to_list() == pytest.approx([4.5, 5.0])
    assert found["vehicle_acceleration"].to_list() == pytest.approx([-1.0, 0.0])
    assert found["vehicle_yields"].to_list() == [True, False]
